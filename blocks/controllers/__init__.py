"""Controllers: joint control laws, PID and its variants, gait phase and torque profiles."""

from blocks.controllers.gait import GaitPhase, TorqueProfile
from blocks.controllers.joint import Admittance, DisturbanceObserver, FeedForward, GravityCompensation, Impedance
from blocks.controllers.learning import IterativeLearning
from blocks.controllers.pid import PD, PI, PID, P

__all__ = [
    "Admittance",
    "DisturbanceObserver",
    "FeedForward",
    "GaitPhase",
    "GravityCompensation",
    "Impedance",
    "IterativeLearning",
    "P",
    "PD",
    "PI",
    "PID",
    "TorqueProfile",
]
