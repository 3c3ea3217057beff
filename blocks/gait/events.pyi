# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import Any, NamedTuple
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.declarations import Live
from graph.signal import Operand, Signal
from graph import Block, Input, Memory, Output, Param

class _Events:
    shortest: Any
    strike: Any
    strides: Any
    elapsed: Any
    timing: Any
class ContactEvents(_Events, Block):
    rising: Param[float]
    falling: Param[float]
    smallest: Param[float]
    force: Input
    contact: Output
    load: Output
    recent: Memory
    window: Memory
    state: Memory
    def __init__(
        self,
        shortest: float | Live = 0.5,
        rising: float | Live = 0.1,
        falling: float | Live = 0.06,
        smallest: float | Live = 20.0,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    class Outputs(NamedTuple):
        strike: Signal
        strides: Signal
        elapsed: Signal
        contact: Signal
        load: Signal
    def __call__(self, force: Operand = ...) -> Outputs: ...
class GyroEvents(_Events, Block):
    lead: Param[float]
    smallest: Param[float]
    velocity: Input
    peak: Memory
    latest: Memory
    def __init__(
        self,
        shortest: float | Live = 0.5,
        lead: float | Live = 0.028,
        smallest: float | Live = 1.0,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    class Outputs(NamedTuple):
        strike: Signal
        strides: Signal
        elapsed: Signal
    def __call__(self, velocity: Operand = ...) -> Outputs: ...
class ThighEvents(_Events, Block):
    lead: Param[float]
    smallest: Param[float]
    angle: Input
    extremes: Memory
    latest: Memory
    def __init__(
        self,
        shortest: float | Live = 0.5,
        lead: float | Live = 0.272,
        smallest: float | Live = 0.15,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    class Outputs(NamedTuple):
        strike: Signal
        strides: Signal
        elapsed: Signal
    def __call__(self, angle: Operand = ...) -> Outputs: ...
class KneeEvents(_Events, Block):
    lead: Param[float]
    smallest: Param[float]
    angle: Input
    velocity: Input
    turns: Memory
    extension: Memory
    latest: Memory
    def __init__(
        self,
        shortest: float | Live = 0.5,
        lead: float | Live = 0.055,
        smallest: float | Live = 0.2,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    class Outputs(NamedTuple):
        strike: Signal
        strides: Signal
        elapsed: Signal
    def __call__(self, angle: Operand = ..., velocity: Operand = ...) -> Outputs: ...
