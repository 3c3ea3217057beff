# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import NamedTuple
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.signal import Signal
from graph import Block, Output

class Clock(Block):
    time: Output
    wake: Output
    lateness: Output
    elapsed: Output
    def __init__(self, **options: Unpack[BlockOptions]) -> None: ...
    class Outputs(NamedTuple):
        time: Signal
        wake: Signal
        lateness: Signal
        elapsed: Signal
    def __call__(self) -> Outputs: ...
