"""Walking adult: the wearer of a robot in simulation."""

from blocks.wearer.sensors import SegmentIMU
from blocks.wearer.tables import walking_speed
from blocks.wearer.walker import Walker

__all__ = ["SegmentIMU", "Walker", "walking_speed"]
