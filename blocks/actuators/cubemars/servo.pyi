# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import Literal
from collections.abc import Sequence
from typing_extensions import Unpack
import numpy as np
from graph.block import BlockOptions
from graph.declarations import Live
from graph.signal import Operand, Signal
from typing import Any
from blocks.actuators.cubemars.emulator_v3 import EmulatedCubeMarsServo
from blocks.actuators.cubemars.v3 import ExtendedFrames
from graph import Actuator, DampedStop, Deviation, Input, Interval, Memory, Motion, Output, Param, TorqueBound, Winding

KINDS: dict[Any, Any]
CURRENTS: tuple[Any, ...]
POSITIONS: tuple[Any, ...]
CURRENT: float
SPEED: float
POSITION: float
WORD: int
LONG: int
COMMANDS: dict[Any, Any]
class CubeMarsServo(ExtendedFrames, Actuator):
    model: Param[str]
    bus: Param[str]
    can_id: Param[int]
    limit: Param[Any]
    invert: Param[bool]
    offset: Param[float]
    timeout: Param[float]
    gear_ratio: Param[float]
    range: Param[Sequence[Any] | np.ndarray]
    max_velocity: Param[float]
    wake_shift: Param[float | None]
    known_pose: Param[Sequence[Any] | np.ndarray]
    reference: Param[str]
    mode: Param[Literal['duty', 'current', 'current_brake', 'velocity', 'position', 'position_velocity']]
    velocity_limit: Param[float]
    acceleration: Param[float]
    duty_limit: Param[float]
    torque_constant: Param[float]
    report_rate: Param[float]
    restart_time: Param[float]
    safe_stop: Param[Literal['disable', 'brake']]
    stop_current: Param[float]
    stop_time: Param[float]
    rms_mode: Param[Literal['silent', 'warn', 'saturate', 'throttle', 'disable']]
    rms_window: Param[float]
    warning_temperature: Param[float]
    derating_temperature: Param[float]
    fault_temperature: Param[float]
    zero_at_arming: Param[bool]
    disabled: Param[bool]
    current_command: Input
    zero: Input
    disable: Input
    active: Output
    position: Output
    velocity: Output
    torque: Output
    current: Output
    temperature: Output
    fault: Output
    age: Output
    rms_torque: Output
    current_sent: Output
    scales: Memory
    notice: Memory
    limits: Memory
    written: Memory
    check_pose: Any
    max_transit: Any
    find: Any
    reports_a_tick: Any
    find_limit: Any
    given_limit: Any
    rated_torque: Any
    check_reports: Any
    feedback_range: Any
    check_temperatures: Any
    fastest: Any
    check_zero: Any
    torque_accuracy: Any
    motion_of_any_mode: Any
    feedback_ends: Any
    wire: Any
    torque_limit: Any
    current_limit: Any
    law_limit: Any
    damp_time: Any
    command_name: Any
    sent_name: Any
    def __init__(
        self,
        model: str,
        bus: str = 'can',
        can_id: int = 1,
        limit: Any = 'rated',
        invert: bool = False,
        offset: float = 0.0,
        timeout: float = 0.1,
        gear_ratio: float = 1.0,
        range: Sequence[Any] | np.ndarray = ...,
        max_velocity: float = 0.0,
        wake_shift: float | None = None,
        known_pose: Sequence[Any] | np.ndarray = ...,
        reference: str = '',
        mode: Literal['duty', 'current', 'current_brake', 'velocity', 'position', 'position_velocity'] = 'current',
        velocity_limit: float = 2.0,
        acceleration: float = 10.0,
        duty_limit: float = 0.1,
        torque_constant: float = 0.0,
        report_rate: float = 100.0,
        restart_time: float = 0.012,
        safe_stop: Literal['disable', 'brake'] = 'disable',
        stop_current: float = 1.0,
        stop_time: float = 1.0,
        rms_mode: Literal['silent', 'warn', 'saturate', 'throttle', 'disable'] = 'disable',
        rms_window: float = 20.0,
        warning_temperature: float = 70.0,
        derating_temperature: float = 80.0,
        fault_temperature: float = 100.0,
        zero_at_arming: bool = False,
        disabled: bool | Live = False,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __getattr__(self, name: str) -> Signal: ...
    def __call__(self, *signals: Operand, **named: Operand) -> Any: ...
    def take_one_command(self) -> None: ...
    def speeds(self) -> tuple[float, float]: ...
    def motion(self) -> Motion: ...
    def command_limits(self) -> dict[str, Interval]: ...
    def rating(self) -> str: ...
    def winding(self) -> Winding: ...
    def torque_bound(self, commands: dict[str, Interval], period: float) -> TorqueBound: ...
    def deviations(self) -> list[Deviation]: ...
    def traffic(self) -> list[tuple[int, bool]]: ...
    def zero_frames(self) -> list[tuple[int, bool, bytes]]: ...
    def ask_frames(self) -> list[tuple[int, bool, bytes]]: ...
    def disable_frames(self) -> list[tuple[int, bool, bytes]]: ...
    def damped_stop(self) -> DampedStop | None: ...
    def emulator(self, **parameters: Any) -> EmulatedCubeMarsServo: ...
