# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import Literal, NamedTuple
from collections.abc import Sequence
from typing_extensions import Unpack
import numpy as np
from graph.block import BlockOptions
from graph.declarations import Live
from graph.signal import Operand, Signal
from blocks.actuators.robstride.models import Model
from typing import Any, TYPE_CHECKING as TYPE_CHECKING
from blocks.actuators.emulated import Emulated
from blocks.actuators.joint import Joint
from blocks.actuators.mit_frames import StopInMitMode
from graph import Actuator, CommandReplies, Device, Memory, Param

CLEAR_FAULT: bytes
FAULTS: bytes
READ_AGAIN: float
READ: int
WRITE: int
OPERATION: bytes
def find(name: str) -> Model: ...
class RobStrideMIT(StopInMitMode, Joint, Actuator):
    can_id: Param[int]
    host_id: Param[int]
    can_timeout: Param[float]
    talk: Memory
    settings: Memory
    arrival: Memory
    def __init__(
        self,
        model: str,
        bus: str = 'can',
        can_id: int = 127,
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
        host_id: int = 253,
        can_timeout: float = 0.1,
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
    def written_settings(self) -> list[tuple[int, float]]: ...
    def addresses(self) -> list[tuple[int, bool]]: ...
    def acceptance_filters(self) -> list[tuple[int, int, bool]]: ...
    def reply_frames(self) -> list[tuple[int, int, bool, bytes]]: ...
    def command_replies(self) -> CommandReplies: ...
    def set_up_frames(self) -> list[tuple[int, bool, bytes]]: ...
    def write_frames(self) -> list[tuple[int, bool, bytes]]: ...
    def read_frames(self) -> list[tuple[int, bool, bytes]]: ...
    def enable_frames(self) -> list[tuple[int, bool, bytes]]: ...
    def fault_in_words(self, code: float) -> str: ...
    def unready_in_words(self) -> str: ...
    def remedy(self) -> str: ...
    def emulator(self, **parameters: Any) -> EmulatedRobStrideMIT: ...
class EmulatedRobStrideMIT(Emulated, Device):
    can_id: Param[int]
    host_id: Param[int]
    parameters_known: Param[bool]
    left_velocity: Param[float]
    ignores: Param[Sequence[Any] | np.ndarray]
    registers: Memory
    ignored: Memory
    latched: Memory
    too_old: Memory
    def __init__(
        self,
        model: str,
        bus: str = 'can',
        can_id: int = 127,
        invert: bool = False,
        offset: float = 0.0,
        gear_ratio: float = 1.0,
        peak: float | None = None,
        wake_shift: float | None = None,
        turns: int = 0,
        trip_temperature: float = ...,
        wire_position: float = 0.0,
        wire_velocity: float = 0.0,
        wire_stiffness: float = 0.0,
        wire_damping: float = 0.0,
        wire_torque: float = 0.0,
        host_id: int = 253,
        parameters_known: bool = True,
        left_velocity: float = 0.0,
        ignores: Sequence[Any] | np.ndarray = ...,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    class Outputs(NamedTuple):
        torque: Signal
        enabled: Signal
    def __call__(
        self,
        position: Operand = ...,
        velocity: Operand = ...,
        temperature: Operand = ...,
        fault: Operand = ...,
        silent: Operand = ...,
        dropped: Operand = ...,
        wrong_id: Operand = ...,
        stuck_encoder: Operand = ...,
        delay: Operand = ...,
        power_lost: Operand = ...,
        stray_torque: Operand = ...,
    ) -> Outputs: ...
    def addresses(self) -> list[tuple[int, bool]]: ...
