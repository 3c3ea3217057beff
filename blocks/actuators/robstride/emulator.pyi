# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import NamedTuple
from collections.abc import Sequence
from typing_extensions import Unpack
import numpy as np
from graph.block import BlockOptions
from graph.signal import Operand, Signal
from collections.abc import Iterable
from typing import Any
from blocks.actuators.emulated import Emulated
from graph import Device, Memory, Param

LOC_KP: int
SPD_KP: int
VBUS: int
POSITION_GAIN: float
VELOCITY_GAIN: float
def ignored_of(names: Iterable[str]) -> tuple[float, ...]: ...
class EmulatedRobStride(Emulated, Device):
    can_id: Param[int]
    trip_temperature: Param[float | None]
    unique: Param[str]
    firmware: Param[str]
    gains: Param[Sequence[Any] | np.ndarray]
    left_velocity: Param[float]
    ignores: Param[Sequence[Any] | np.ndarray]
    registers: Memory
    defaults: Memory
    ignored: Memory
    memory_of_drive: Memory
    identity: Memory
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
        trip_temperature: float | None = None,
        wire_position: float = 0.0,
        wire_velocity: float = 0.0,
        wire_stiffness: float = 0.0,
        wire_damping: float = 0.0,
        wire_torque: float = 0.0,
        unique: str = '',
        firmware: str = '',
        gains: Sequence[Any] | np.ndarray = ...,
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
    def own_gains(self, is_cybergear: bool) -> dict[Any, Any]: ...
    def unique_bytes(self) -> tuple[float, ...]: ...
    def firmware_bytes(self) -> tuple[float, ...]: ...
    def addresses(self) -> list[tuple[int, bool]]: ...
