"""Gait: heel strikes, phase, state, and assistance torques."""

from blocks.controllers.gait import GaitPhase, TorqueProfile
from blocks.gait.events import ContactEvents, GyroEvents, KneeEvents, ThighEvents
from blocks.gait.oscillators import AdaptiveOscillator, PhaseKalmanFilter
from blocks.gait.phase import CirclePhase, PhasePortrait, StridePhase
from blocks.gait.placement import SegmentOrder, SegmentPosture, SensorPlacement
from blocks.gait.state import GaitState, StrideEnvelope, TorqueGate
from blocks.gait.torque import BiologicalTorque, DelayedOutputFeedback, PeakProfile, SplineProfile, StanceSwingImpedance

__all__ = [
    "AdaptiveOscillator",
    "BiologicalTorque",
    "CirclePhase",
    "ContactEvents",
    "DelayedOutputFeedback",
    "GaitPhase",
    "GaitState",
    "GyroEvents",
    "KneeEvents",
    "PeakProfile",
    "PhaseKalmanFilter",
    "PhasePortrait",
    "SegmentOrder",
    "SegmentPosture",
    "SensorPlacement",
    "SplineProfile",
    "StanceSwingImpedance",
    "StrideEnvelope",
    "StridePhase",
    "ThighEvents",
    "TorqueGate",
    "TorqueProfile",
]
