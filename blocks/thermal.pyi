# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import NamedTuple
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.declarations import Live
from graph.signal import Operand, Signal
from typing import Any
from graph import Block, Input, Memory, Output, Param

COPPER: float
RISE: float
class ThermalModel(Block):
    actuator: Param[str]
    rated: Param[float | None]
    loss: Param[float | None]
    winding_capacity: Param[float]
    winding_resistance: Param[float]
    case_capacity: Param[float]
    case_resistance: Param[float]
    start: Param[float | None]
    torque: Input
    ambient: Input
    winding: Output
    case: Output
    heat: Memory
    held: Memory
    state: Memory
    begun: Memory
    def __init__(
        self,
        actuator: str = '',
        rated: float | None = None,
        loss: float | None = None,
        winding_capacity: float | Live = 16.3,
        winding_resistance: float = 1.07,
        case_capacity: float | Live = 512.0,
        case_resistance: float = 1.94,
        start: float | None = None,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    class Outputs(NamedTuple):
        winding: Signal
        case: Signal
    def __call__(self, torque: Operand = ..., ambient: Operand = ...) -> Outputs: ...
def loss_of_rating(rated: Any, resistance: Any) -> float: ...
