# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import Literal, NamedTuple
from collections.abc import Sequence
from typing_extensions import Unpack
import numpy as np
from graph.block import BlockOptions
from graph.declarations import Live
from graph.signal import Operand, Signal
from typing import Any
from blocks.actuators.cubemars.emulator import EmulatedCubeMars
from blocks.actuators.joint import Joint
from blocks.actuators.mit_frames import StopInMitMode
from graph import Actuator, Param

class CubeMars(StopInMitMode, Joint, Actuator):
    reply: Param[int]
    def __init__(
        self,
        model: str,
        bus: str = 'can',
        can_id: int = 1,
        limit: Any = 'rated',
        invert: bool = False,
        offset: float = 0.0,
        range: Sequence[Any] | np.ndarray = ...,
        wake_shift: float | None = None,
        known_pose: Sequence[Any] | np.ndarray = ...,
        reference: str = '',
        timeout: float = 0.1,
        safe_stop: Literal['disable', 'damp'] = 'disable',
        rms_mode: Literal['silent', 'warn', 'saturate', 'throttle', 'disable'] = 'saturate',
        rms_window: float = 20.0,
        warning_temperature: float = 70.0,
        derating_temperature: float = 80.0,
        fault_temperature: float = 100.0,
        stop_damping: float = 1.0,
        stop_time: float = 1.0,
        gear_ratio: float = 1.0,
        wire_position: float = 0.0,
        wire_velocity: float = 0.0,
        wire_stiffness: float = 0.0,
        wire_damping: float = 0.0,
        wire_torque: float = 0.0,
        max_acceleration: float = 500.0,
        max_transit: float = 0.005,
        max_velocity: float = 0.0,
        zero_at_arming: bool = False,
        disabled: bool | Live = False,
        reply: int = 8,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    class Outputs(NamedTuple):
        position: Signal
        velocity: Signal
        torque: Signal
        temperature: Signal
        fault: Signal
        age: Signal
        rms_torque: Signal
        active: Signal
        torque_sent: Signal
        limited: Signal
    def __call__(
        self,
        position_command: Operand = ...,
        velocity_command: Operand = ...,
        torque_command: Operand = ...,
        stiffness_command: Operand = ...,
        damping_command: Operand = ...,
        zero: Operand = ...,
        disable: Operand = ...,
    ) -> Outputs: ...
    def fault_in_words(self, code: int) -> str: ...
    def malformed_in_words(self, lengths: dict[int, int], first_byte: int) -> str: ...
    def rejected_in_words(self, length: int, frames: int, first_byte: int) -> str: ...
    def traffic(self) -> list[tuple[int, bool]]: ...
    def addresses(self) -> list[tuple[int, bool]]: ...
    def acceptance_filters(self) -> list[tuple[int, int, bool]]: ...
    def reply_frames(self) -> list[tuple[int, int, bool, bytes]]: ...
    def enable_frames(self) -> list[tuple[int, bool, bytes]]: ...
    def emulator(self, **parameters: Any) -> EmulatedCubeMars: ...
