# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import Literal
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.declarations import Live
from graph.signal import Operand, Signal
from graph import Block, Input, Memory, Output, Param

class Compare(Block):
    relation: Param[Literal['<', '<=', '>', '>=', '==', '!=']]
    a: Input
    b: Input
    y: Output
    def __init__(
        self,
        relation: Literal['<', '<=', '>', '>=', '==', '!='] = '>',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, a: Operand = ..., b: Operand = ...) -> Signal: ...
class And(Block):
    count: Param[int]
    y: Output
    def __init__(self, count: int = 2, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, *signals: Operand, **named: Operand) -> Signal: ...
class Or(Block):
    count: Param[int]
    y: Output
    def __init__(self, count: int = 2, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, *signals: Operand, **named: Operand) -> Signal: ...
class Xor(Block):
    count: Param[int]
    y: Output
    def __init__(self, count: int = 2, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, *signals: Operand, **named: Operand) -> Signal: ...
class Not(Block):
    u: Input
    y: Output
    def __init__(self, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, u: Operand = ...) -> Signal: ...
class Edge(Block):
    kind: Param[Literal['rising', 'falling', 'both']]
    u: Input
    y: Output
    previous: Memory
    def __init__(
        self,
        kind: Literal['rising', 'falling', 'both'] = 'rising',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, u: Operand = ...) -> Signal: ...
class Latch(Block):
    initial: Param[bool]
    on: Input
    off: Input
    y: Output
    held: Memory
    def __init__(self, initial: bool = False, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, on: Operand = ..., off: Operand = ...) -> Signal: ...
class Debounce(Block):
    time: Param[float]
    u: Input
    y: Output
    held: Memory
    since: Memory
    def __init__(self, time: float | Live = 0.02, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, u: Operand = ...) -> Signal: ...
class Counter(Block):
    u: Input
    clear: Input
    count: Output
    previous: Memory
    total: Memory
    def __init__(self, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, u: Operand = ..., clear: Operand = ...) -> Signal: ...
class Timer(Block):
    restart: Input
    elapsed: Output
    since: Memory
    def __init__(self, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, restart: Operand = ...) -> Signal: ...
class Switch(Block):
    condition: Input
    a: Input
    b: Input
    y: Output
    def __init__(self, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, condition: Operand = ..., a: Operand = ..., b: Operand = ...) -> Signal: ...
class Selector(Block):
    count: Param[int]
    index: Input
    y: Output
    def __init__(self, count: int = 2, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, *signals: Operand, **named: Operand) -> Signal: ...
