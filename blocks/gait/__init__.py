"""Gait: events, phase."""

from blocks.gait.events import ContactEvents, GyroEvents, KneeEvents, ThighEvents
from blocks.gait.oscillators import AdaptiveOscillator, PhaseKalmanFilter
from blocks.gait.phase import PhasePortrait, StridePhase

__all__ = [
    "AdaptiveOscillator",
    "ContactEvents",
    "GyroEvents",
    "KneeEvents",
    "PhaseKalmanFilter",
    "PhasePortrait",
    "StridePhase",
    "ThighEvents",
]
