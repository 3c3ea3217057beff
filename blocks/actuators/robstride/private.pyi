# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import Literal
from collections.abc import Sequence
from typing_extensions import Unpack
import numpy as np
from graph.block import BlockOptions
from graph.declarations import Live
from graph.signal import Operand, Signal
from graph.device import DampedStop
from typing import Any, TYPE_CHECKING as TYPE_CHECKING
from blocks.actuators.joint import Joint
from blocks.actuators.robstride.emulator import EmulatedRobStride
from graph import Actuator, CommandReplies, Deviation, Interval, Memory, Motion, Output, Param, StopReply, TorqueBound

RUN_MODES: dict[Any, Any]
POSITION_MODES: tuple[Any, ...]
COMMANDS: dict[Any, Any]
SENT: dict[Any, Any]
class RobStride(Joint, Actuator):
    can_id: Param[int]
    host_id: Param[int]
    can_timeout: Param[float]
    active_reporting: Param[bool]
    velocity_limit: Param[float]
    acceleration: Param[float]
    mode: Param[Literal['operation', 'position', 'velocity', 'current', 'csp']]
    warning: Output
    state: Memory
    written: Memory
    settings: Memory
    read_back: Memory
    arrival: Memory
    unique: Memory
    motor_torque: Any
    current_limit: Any
    command_name: Any
    sent_name: Any
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
        active_reporting: bool = False,
        velocity_limit: float = 2.0,
        acceleration: float = 10.0,
        mode: Literal['operation', 'position', 'velocity', 'current', 'csp'] = 'operation',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __getattr__(self, name: str) -> Signal: ...
    def __call__(self, *signals: Operand, **named: Operand) -> Any: ...
    def take_one_command(self) -> None: ...
    def command_replies(self) -> CommandReplies: ...
    def motion(self) -> Motion: ...
    def command_limits(self) -> dict[str, Interval]: ...
    def rating(self) -> str: ...
    def torque_bound(self, commands: dict[str, Interval], period: float) -> TorqueBound: ...
    def deviations(self) -> list[Deviation]: ...
    def addresses(self) -> list[tuple[int, bool]]: ...
    def acceptance_filters(self) -> list[tuple[int, int, bool]]: ...
    def feedback_frames(self, kind: int) -> tuple[tuple[int, int, bool, bytes], ...]: ...
    def stop_reply(self) -> StopReply: ...
    def traffic(self) -> list[tuple[int, bool]]: ...
    def write(self, index: int, value: float) -> tuple[int, bool, bytes]: ...
    def command(self, kind: int) -> tuple[int, bool, bytes]: ...
    def written_settings(self) -> list[tuple[int, float]]: ...
    def ask_frames(self) -> list[tuple[int, bool, bytes]]: ...
    def set_up_frames(self) -> list[tuple[int, bool, bytes]]: ...
    def read_frames(self) -> list[tuple[int, bool, bytes]]: ...
    def enable_frames(self) -> list[tuple[int, bool, bytes]]: ...
    def set_zero_frame(self) -> tuple[int, bool, bytes]: ...
    def zero_frames(self) -> list[tuple[int, bool, bytes]]: ...
    def disable_frames(self) -> list[tuple[int, bool, bytes]]: ...
    def damped_stop(self) -> DampedStop | None: ...
    def damping_frames(self, damping: float) -> list[tuple[int, bool, bytes]]: ...
    def fault_in_words(self, code: int) -> str: ...
    def warnings_in_words(self) -> tuple[str, ...]: ...
    def remedy(self) -> str: ...
    def unready_in_words(self) -> str: ...
    def emulator(self, **parameters: Any) -> EmulatedRobStride: ...
