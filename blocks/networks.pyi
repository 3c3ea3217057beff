# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import Literal
from collections.abc import Sequence
from typing_extensions import Unpack
import numpy as np
from graph.block import BlockOptions
from graph.signal import Operand, Signal
from pathlib import Path
from typing import Any
from cext.kernels.networks.inference import tick
from cext.kernels.networks.model import Model
from graph import Block, Memory, Output, Param

LAYOUTS: tuple[Any, ...]
RATE_TOLERANCE: float
FLOATS_PER_DOUBLE: int
BACKLOG: float
class OnnxModel(Block):
    file: Param[str]
    channels: Param[Sequence[Any] | np.ndarray]
    results: Param[Sequence[Any] | np.ndarray]
    rate: Param[float]
    layout: Param[Literal['channels, time', 'time, channels']]
    run: Param[Literal['tick', 'worker']]
    inference_time: Param[float]
    latency: Param[float]
    stale: Param[float]
    when_stale: Param[Literal['fade', 'fault']]
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
    ring: Memory
    delay: Memory
    stale_is_fault: Memory
    scope_every: Any
    streaming: Any
    worker: Any
    loaded: Any
    description: Any
    def __init__(
        self,
        file: str,
        channels: Sequence[Any] | np.ndarray = ...,
        results: Sequence[Any] | np.ndarray = ...,
        rate: float = 0.0,
        layout: Literal['channels, time', 'time, channels'] = 'channels, time',
        run: Literal['tick', 'worker'] = 'tick',
        inference_time: float = 0.02,
        latency: float = 0.0,
        stale: float = 0.1,
        when_stale: Literal['fade', 'fault'] = 'fade',
        provider: Literal['cpu', 'cuda', 'tensorrt'] = 'cpu',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __getattr__(self, name: str) -> Signal: ...
    def __call__(self, *signals: Operand, **named: Operand) -> Any: ...
    def load(self) -> Model: ...
    @property
    def inference_times(self) -> dict[str, float]: ...
    def path_of_file(self) -> Path: ...
    def place(self, loaded: Any, samples: int) -> None: ...
    def set_rate(self) -> None: ...
_RESERVED_NAMES: Any
