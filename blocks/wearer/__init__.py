"""Walking adult: the wearer of a robot in simulation."""

from blocks.wearer.sensors import SegmentIMU
from blocks.wearer.walker import Walker

__all__ = ["SegmentIMU", "Walker"]
