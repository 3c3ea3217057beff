# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import Any, Literal, NamedTuple
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.declarations import Live
from graph.signal import Operand, Signal
from blocks.wearer.recording import samples
from graph import Block, Input, Memory, Output, Param

SIDES: tuple[Any, ...]
JOINTS: dict[Any, Any]
SEGMENTS: dict[Any, Any]
MOTION: str
MUSCLES: tuple[Any, ...]
GAIN_DEVIATIONS: tuple[Any, ...]
OFFSET_DEVIATIONS: tuple[Any, ...]
STRIDE_TIME_DEVIATION: float
class Walker(Block):
    speed: Param[Any]
    motion: Param[Literal['walk', 'on_toes', 'on_heels', 'stairs_up', 'stairs_down']]
    mass: Param[float]
    height: Param[float]
    person: Param[Any]
    start: Param[float]
    variability: Param[float]
    seed: Param[int]
    strength: Param[float]
    adaptation: Param[float]
    reflex_delay: Param[float]
    recording: Param[str]
    left_hip_assistance: Input
    left_knee_assistance: Input
    left_ankle_assistance: Input
    right_hip_assistance: Input
    right_knee_assistance: Input
    right_ankle_assistance: Input
    left_hip_angle: Output
    left_hip_velocity: Output
    left_hip_acceleration: Output
    left_hip_torque: Output
    left_hip_power: Output
    left_knee_angle: Output
    left_knee_velocity: Output
    left_knee_acceleration: Output
    left_knee_torque: Output
    left_knee_power: Output
    left_ankle_angle: Output
    left_ankle_velocity: Output
    left_ankle_acceleration: Output
    left_ankle_torque: Output
    left_ankle_power: Output
    left_thigh_pitch: Output
    left_shank_pitch: Output
    left_foot_pitch: Output
    left_thigh_motion: Output
    left_shank_motion: Output
    left_foot_motion: Output
    left_ground_force: Output
    left_centre_of_pressure: Output
    left_contact: Output
    left_phase: Output
    right_hip_angle: Output
    right_hip_velocity: Output
    right_hip_acceleration: Output
    right_hip_torque: Output
    right_hip_power: Output
    right_knee_angle: Output
    right_knee_velocity: Output
    right_knee_acceleration: Output
    right_knee_torque: Output
    right_knee_power: Output
    right_ankle_angle: Output
    right_ankle_velocity: Output
    right_ankle_acceleration: Output
    right_ankle_torque: Output
    right_ankle_power: Output
    right_thigh_pitch: Output
    right_shank_pitch: Output
    right_foot_pitch: Output
    right_thigh_motion: Output
    right_shank_motion: Output
    right_foot_motion: Output
    right_ground_force: Output
    right_centre_of_pressure: Output
    right_contact: Output
    right_phase: Output
    pelvis_motion: Output
    walking_speed: Output
    body: Memory
    muscles: Memory
    variation: Memory
    pieces: Memory
    knots: Memory
    table: Memory
    samples: Memory
    history: Memory
    state: Memory
    def __init__(
        self,
        speed: Any = 1.2,
        motion: Literal['walk', 'on_toes', 'on_heels', 'stairs_up', 'stairs_down'] = 'walk',
        mass: float = 70.0,
        height: float = 1.7,
        person: Any = 0,
        start: float = 0.0,
        variability: float = 1.0,
        seed: int = 0,
        strength: float = 1.0,
        adaptation: float | Live = 0.8,
        reflex_delay: float = 0.05,
        recording: str = '',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    class Outputs(NamedTuple):
        left_hip_angle: Signal
        left_hip_velocity: Signal
        left_hip_acceleration: Signal
        left_hip_torque: Signal
        left_hip_power: Signal
        left_knee_angle: Signal
        left_knee_velocity: Signal
        left_knee_acceleration: Signal
        left_knee_torque: Signal
        left_knee_power: Signal
        left_ankle_angle: Signal
        left_ankle_velocity: Signal
        left_ankle_acceleration: Signal
        left_ankle_torque: Signal
        left_ankle_power: Signal
        left_thigh_pitch: Signal
        left_shank_pitch: Signal
        left_foot_pitch: Signal
        left_thigh_motion: Signal
        left_shank_motion: Signal
        left_foot_motion: Signal
        left_ground_force: Signal
        left_centre_of_pressure: Signal
        left_contact: Signal
        left_phase: Signal
        right_hip_angle: Signal
        right_hip_velocity: Signal
        right_hip_acceleration: Signal
        right_hip_torque: Signal
        right_hip_power: Signal
        right_knee_angle: Signal
        right_knee_velocity: Signal
        right_knee_acceleration: Signal
        right_knee_torque: Signal
        right_knee_power: Signal
        right_ankle_angle: Signal
        right_ankle_velocity: Signal
        right_ankle_acceleration: Signal
        right_ankle_torque: Signal
        right_ankle_power: Signal
        right_thigh_pitch: Signal
        right_shank_pitch: Signal
        right_foot_pitch: Signal
        right_thigh_motion: Signal
        right_shank_motion: Signal
        right_foot_motion: Signal
        right_ground_force: Signal
        right_centre_of_pressure: Signal
        right_contact: Signal
        right_phase: Signal
        pelvis_motion: Signal
        walking_speed: Signal
    def __call__(
        self,
        left_hip_assistance: Operand = ...,
        left_knee_assistance: Operand = ...,
        left_ankle_assistance: Operand = ...,
        right_hip_assistance: Operand = ...,
        right_knee_assistance: Operand = ...,
        right_ankle_assistance: Operand = ...,
    ) -> Outputs: ...
