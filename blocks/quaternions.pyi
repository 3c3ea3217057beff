# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import Any, NamedTuple
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.signal import Operand, Signal
from graph import Block, Input, Output

HALF_TURN: tuple[Any, ...]
QUARTER_TURN: tuple[Any, ...]
class QuaternionMultiply(Block):
    p: Input
    q: Input
    y: Output
    def __init__(self, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, p: Operand = ..., q: Operand = ...) -> Signal: ...
class QuaternionConjugate(Block):
    q: Input
    y: Output
    def __init__(self, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, q: Operand = ...) -> Signal: ...
class RotateVector(Block):
    q: Input
    v: Input
    y: Output
    def __init__(self, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, q: Operand = ..., v: Operand = ...) -> Signal: ...
class QuaternionFromEuler(Block):
    yaw: Input
    pitch: Input
    roll: Input
    q: Output
    def __init__(self, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, yaw: Operand = ..., pitch: Operand = ..., roll: Operand = ...) -> Signal: ...
class QuaternionToEuler(Block):
    q: Input
    yaw: Output
    pitch: Output
    roll: Output
    def __init__(self, **options: Unpack[BlockOptions]) -> None: ...
    class Outputs(NamedTuple):
        yaw: Signal
        pitch: Signal
        roll: Signal
    def __call__(self, q: Operand = ...) -> Outputs: ...
