# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import Literal, NamedTuple
from collections.abc import Sequence
from typing_extensions import Unpack
import numpy as np
from graph.block import BlockOptions
from graph.declarations import Live
from graph.signal import Operand, Signal
from typing import Any
from graph import Block, Input, Memory, Output, Param, StreamDevice

SIDES: dict[Any, Any]
CELL_PRESSURE_LIMIT: float
def plan_of(block: Any) -> tuple[float, ...]: ...
def frame_bytes(block: Any) -> int: ...
def frame_doubles(block: Any) -> int: ...
class Insole(StreamDevice):
    side: Param[Literal['left', 'right']]
    transport: Param[Literal['udp', 'tcp']]
    address: Param[str]
    rows: Param[int]
    columns: Param[int]
    length: Param[float]
    breadth: Param[float]
    regions_at: Param[Sequence[Any] | np.ndarray]
    least: Param[float]
    clock: Param[bool]
    timeout: Param[float]
    force: Output
    centre: Output
    regions: Output
    age: Output
    received: Output
    lost: Output
    late: Output
    corrupt: Output
    dead: Output
    sample_time: Output
    clock_drift: Output
    plan: Memory
    bounds: Memory
    parsed: Memory
    sequence: Memory
    buffer: Memory
    mapped: Memory
    def __init__(
        self,
        side: Literal['left', 'right'] = 'left',
        transport: Literal['udp', 'tcp'] = 'udp',
        address: str = '127.0.0.1:5005',
        rows: int = 31,
        columns: int = 9,
        length: float = 0.27,
        breadth: float = 0.09,
        regions_at: Sequence[Any] | np.ndarray = ...,
        least: float = 20.0,
        clock: bool = False,
        timeout: float = 0.1,
        bus: str = '',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __getattr__(self, name: str) -> Signal: ...
    def __call__(self) -> Any: ...
    def opening(self) -> dict[str, Any]: ...
    def emulator(self, **parameters: Any) -> Any: ...
class EmulatedInsole(StreamDevice):
    side: Param[Literal['left', 'right']]
    rows: Param[int]
    columns: Param[int]
    length: Param[float]
    breadth: Param[float]
    period: Param[float]
    force: Input
    centre: Input
    silent: Input
    dropped: Input
    broken: Input
    plan: Memory
    state: Memory
    waiting: Memory
    name: Any
    def __init__(
        self,
        side: Literal['left', 'right'] = 'left',
        rows: int = 31,
        columns: int = 9,
        length: float = 0.27,
        breadth: float = 0.09,
        period: float = 0.01,
        bus: str = '',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(
        self,
        force: Operand = ...,
        centre: Operand = ...,
        silent: Operand = ...,
        dropped: Operand = ...,
        broken: Operand = ...,
    ) -> EmulatedInsole: ...
    @classmethod
    def of(cls, insole: Insole, **parameters: Any) -> EmulatedInsole: ...
class FootContact(Block):
    press: Param[float]
    release: Param[float]
    heel_share: Param[float]
    shortest: Param[float]
    force: Input
    heel: Input
    contact: Output
    heel_strike: Output
    toe_off: Output
    state: Memory
    def __init__(
        self,
        press: float | Live = 50.0,
        release: float | Live = 30.0,
        heel_share: float | Live = 0.5,
        shortest: float | Live = 0.1,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    class Outputs(NamedTuple):
        contact: Signal
        heel_strike: Signal
        toe_off: Signal
    def __call__(self, force: Operand = ..., heel: Operand = ...) -> Outputs: ...
