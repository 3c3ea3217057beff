# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import Literal
from collections.abc import Sequence
from typing_extensions import Unpack
import numpy as np
from graph.block import BlockOptions
from graph.signal import Operand, Signal
from pathlib import Path
from typing import Any
from graph import Block, Memory, Output, Param

LAYOUTS: tuple[Any, ...]
RATE_TOLERANCE: float
FLOATS_PER_DOUBLE: int
class OnnxModel(Block):
    file: Param[str]
    channels: Param[Sequence[Any] | np.ndarray]
    results: Param[Sequence[Any] | np.ndarray]
    rate: Param[float]
    layout: Param[Literal['channels, time', 'time, channels']]
    provider: Param[Literal['cpu', 'cuda', 'tensorrt']]
    valid: Output
    age: Output
    overruns: Output
    model: Memory
    plan: Memory
    channel_scales: Memory
    output_scales: Memory
    operands: Memory
    computed: Memory
    count: Memory
    _every: Any
    description: Any
    def __init__(
        self,
        file: str,
        channels: Sequence[Any] | np.ndarray = ...,
        results: Sequence[Any] | np.ndarray = ...,
        rate: float = 0.0,
        layout: Literal['channels, time', 'time, channels'] = 'channels, time',
        provider: Literal['cpu', 'cuda', 'tensorrt'] = 'cpu',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __getattr__(self, name: str) -> Signal: ...
    def __call__(self, *signals: Operand, **named: Operand) -> Any: ...
    def path_of_file(self) -> Path: ...
    def place(self, loaded: Any, samples: int, *, streaming: bool) -> None: ...
    def set_rate(self) -> None: ...
_RESERVED_NAMES: Any
