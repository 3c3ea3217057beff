# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import NamedTuple
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.signal import Operand, Signal
from blocks.actuators.cubemars.models import Motor
from typing import Any, TYPE_CHECKING as TYPE_CHECKING
from blocks.actuators.emulated import Emulated
from graph import Device, Memory, Param

class Boards:
    report_rate: Any
    torque_constant: Any
    pole_pairs: Any
    scales: Any
    board: Any
    motion: Any
def with_pole_pairs(spec: Any, pole_pairs: int) -> Motor: ...
class EmulatedCubeMarsV3(Emulated, Device):
    report_rate: Param[float]
    enter: Param[bool]
    torque_constant: Param[float]
    pole_pairs: Param[int]
    scales: Memory
    board: Memory
    motion: Memory
    spec: Any
    def __init__(
        self,
        model: str,
        bus: str = 'can',
        can_id: int = 1,
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
        report_rate: float = 0.0,
        enter: bool = False,
        torque_constant: float = 0.0,
        pole_pairs: int = 0,
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
class EmulatedCubeMarsServo(Emulated, Device):
    report_rate: Param[float]
    torque_constant: Param[float]
    pole_pairs: Param[int]
    scales: Memory
    board: Memory
    motion: Memory
    spec: Any
    def __init__(
        self,
        model: str,
        bus: str = 'can',
        can_id: int = 1,
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
        report_rate: float = 100.0,
        torque_constant: float = 0.0,
        pole_pairs: int = 0,
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
    @classmethod
    def of(cls, actuator: Any, **parameters: Any) -> EmulatedCubeMarsServo: ...
    def addresses(self) -> list[tuple[int, bool]]: ...
