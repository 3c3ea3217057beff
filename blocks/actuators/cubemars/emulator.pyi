# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import NamedTuple
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.signal import Operand, Signal
from typing import Any
from blocks.actuators.emulated import Emulated
from graph import Device, Param

class EmulatedCubeMars(Emulated, Device):
    reply: Param[int]
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
        reply: int = 8,
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
    def of(cls, actuator: Any, **parameters: Any) -> EmulatedCubeMars: ...
    def addresses(self) -> list[tuple[int, bool]]: ...
