# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import NamedTuple
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.declarations import Live
from graph.signal import Operand, Signal
from typing import Any
from graph import Block, Input, Memory, Output, Param

class LoadCell(Block):
    capacity: Param[float]
    at_capacity: Param[float]
    tare_at_start: Param[bool]
    tare_time: Param[float]
    zero: Param[float]
    signal: Input
    tare: Input
    force: Output
    taring: Memory
    def __init__(
        self,
        capacity: float | Live = 100.0,
        at_capacity: float = 1.0,
        tare_at_start: bool = True,
        tare_time: float = 0.5,
        zero: float = 0.0,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, signal: Operand = ..., tare: Operand = ...) -> Signal: ...
    def emulator(self, **parameters: Any) -> EmulatedLoadCell: ...
class EmulatedLoadCell(Block):
    capacity: Param[float]
    at_capacity: Param[float]
    zero: Param[float]
    force: Input
    signal: Output
    def __init__(
        self,
        capacity: float | Live = 100.0,
        at_capacity: float = 1.0,
        zero: float = 0.0,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, force: Operand = ...) -> Signal: ...
    @classmethod
    def of(cls, cell: LoadCell, **parameters: Any) -> EmulatedLoadCell: ...
class FSR(Block):
    supply: Param[float]
    resistor: Param[float]
    sensitivity: Param[float]
    most: Param[float]
    press: Param[float]
    release: Param[float]
    voltage: Input
    force: Output
    pressed: Output
    def __init__(
        self,
        supply: float | Live = 3.3,
        resistor: float | Live = 10000.0,
        sensitivity: float | Live = 25000.0,
        most: float | Live = 100.0,
        press: float | Live = 5.0,
        release: float | Live = 3.0,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    class Outputs(NamedTuple):
        force: Signal
        pressed: Signal
    def __call__(self, voltage: Operand = ...) -> Outputs: ...
    def emulator(self, **parameters: Any) -> EmulatedFSR: ...
class EmulatedFSR(Block):
    supply: Param[float]
    resistor: Param[float]
    sensitivity: Param[float]
    force: Input
    voltage: Output
    name: Any
    def __init__(
        self,
        supply: float | Live = 3.3,
        resistor: float | Live = 10000.0,
        sensitivity: float | Live = 25000.0,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, force: Operand = ...) -> Signal: ...
    @classmethod
    def of(cls, fsr: FSR, **parameters: Any) -> EmulatedFSR: ...
