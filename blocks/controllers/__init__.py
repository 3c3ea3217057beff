"""Controllers: laws of a joint, PID and its parts, and what the stride says."""

from blocks.controllers.gait import GaitPhase, TorqueProfile
from blocks.controllers.joint import Admittance, FeedForward, GravityCompensation, Impedance
from blocks.controllers.pid import PD, PI, PID, P

__all__ = [
    "Admittance",
    "FeedForward",
    "GaitPhase",
    "GravityCompensation",
    "Impedance",
    "P",
    "PD",
    "PI",
    "PID",
    "TorqueProfile",
]
