# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import Literal, NamedTuple
from collections.abc import Sequence
from typing_extensions import Unpack
import numpy as np
from graph.block import BlockOptions
from graph.declarations import Live
from graph.signal import Operand, Signal
from graph.device import DampedStop, Motion
from typing import Any, TYPE_CHECKING as TYPE_CHECKING
from blocks.actuators.cubemars.emulator_v3 import EmulatedCubeMarsV3
from blocks.actuators.joint import Joint
from graph import Actuator, CommandReplies, Deviation, Interval, Memory, Output, Param, StopReply

NOTHING: bytes
class Reporting:
    report_rate: Any
    restart_time: Any
    torque: Any
    current: Any
    scales: Any
    notice: Any
    reports_a_tick: int
    timeout: Any
    offset: Any
    max_transit: Any
    def check_reports(self) -> None: ...
    def command_replies(self) -> CommandReplies: ...
    def prepare(self, dt: float) -> None: ...
    def feedback_range(self) -> dict[str, Interval]: ...
class ExtendedFrames:
    can_id: Any
    spec: Any
    scales: Any
    rest_torque: Any
    def fault_in_words(self, code: int) -> str: ...
    def addresses(self) -> list[tuple[int, bool]]: ...
    def acceptance_filters(self) -> list[tuple[int, int, bool]]: ...
    def set_zero_frame(self) -> tuple[int, bool, bytes]: ...
    def stop_reply(self) -> StopReply: ...
class CubeMarsV3(ExtendedFrames, Joint, Actuator):
    report_rate: Param[float]
    restart_time: Param[float]
    enter: Param[bool]
    torque: Output
    current: Output
    scales: Memory
    notice: Memory
    reports_a_tick: Any
    check_reports: Any
    feedback_range: Any
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
        report_rate: float = 0.0,
        restart_time: float = 0.012,
        enter: bool = False,
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
        current: Signal
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
    def deviations(self) -> list[Deviation]: ...
    def motion(self) -> Motion: ...
    def feedback_ends(self) -> tuple[float, float]: ...
    def traffic(self) -> list[tuple[int, bool]]: ...
    def ask_frames(self) -> list[tuple[int, bool, bytes]]: ...
    def enable_frames(self) -> list[tuple[int, bool, bytes]]: ...
    def zero_frames(self) -> list[tuple[int, bool, bytes]]: ...
    def disable_frames(self) -> list[tuple[int, bool, bytes]]: ...
    def damped_stop(self) -> DampedStop | None: ...
    def damping_frames(self, damping: float) -> list[tuple[int, bool, bytes]]: ...
    def emulator(self, **parameters: Any) -> EmulatedCubeMarsV3: ...
