"""Walking adult: the wearer of a robot in simulation."""

from blocks.wearer.walker import Walker

__all__ = ["Walker"]
