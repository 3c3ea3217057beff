"""Walking adult: the wearer of a robot in simulation."""

from blocks.wearer.cuffs import Cuff
from blocks.wearer.sensors import SegmentIMU, SoleForce
from blocks.wearer.tables import walking_speed
from blocks.wearer.walker import Walker

__all__ = ["Cuff", "SegmentIMU", "SoleForce", "Walker", "walking_speed"]
