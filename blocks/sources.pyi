# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import Literal
from collections.abc import Sequence
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.declarations import Live
from graph.signal import Signal
from typing import Any
import numpy as np
from blocks._plumbing.ports import UnitOfOutput
from graph import Block, Memory, Output, Param

class Constant(UnitOfOutput, Block):
    value: Param[float]
    unit: Param[str]
    y: Output
    def __init__(self, value: float | Live = 0.0, unit: str = 'any', **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self) -> Signal: ...
class StepSource(UnitOfOutput, Block):
    before: Param[float]
    after: Param[float]
    time: Param[float]
    unit: Param[str]
    y: Output
    def __init__(
        self,
        before: float | Live = 0.0,
        after: float | Live = 1.0,
        time: float | Live = 1.0,
        unit: str = 'any',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self) -> Signal: ...
class Ramp(UnitOfOutput, Block):
    slope: Param[float]
    time: Param[float]
    initial: Param[float]
    duration: Param[float]
    unit: Param[str]
    y: Output
    def __init__(
        self,
        slope: float | Live = 1.0,
        time: float | Live = 0.0,
        initial: float | Live = 0.0,
        duration: float | Live = ...,
        unit: str = 'any',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self) -> Signal: ...
class Sine(UnitOfOutput, Block):
    amplitude: Param[float]
    frequency: Param[float]
    phase: Param[float]
    bias: Param[float]
    unit: Param[str]
    y: Output
    def __init__(
        self,
        amplitude: float | Live = 1.0,
        frequency: float | Live = 1.0,
        phase: float | Live = 0.0,
        bias: float | Live = 0.0,
        unit: str = 'any',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self) -> Signal: ...
class Chirp(UnitOfOutput, Block):
    amplitude: Param[float]
    start: Param[float]
    stop: Param[float]
    duration: Param[float]
    method: Param[Literal['linear', 'logarithmic']]
    phase: Param[float]
    bias: Param[float]
    unit: Param[str]
    y: Output
    def __init__(
        self,
        amplitude: float | Live = 1.0,
        start: float | Live = 0.1,
        stop: float | Live = 10.0,
        duration: float | Live = 10.0,
        method: Literal['linear', 'logarithmic'] = 'linear',
        phase: float | Live = 0.0,
        bias: float | Live = 0.0,
        unit: str = 'any',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self) -> Signal: ...
class Pulse(UnitOfOutput, Block):
    low: Param[float]
    high: Param[float]
    period: Param[float]
    duty: Param[float]
    delay: Param[float]
    unit: Param[str]
    y: Output
    def __init__(
        self,
        low: float | Live = 0.0,
        high: float | Live = 1.0,
        period: float | Live = 1.0,
        duty: float | Live = 0.5,
        delay: float | Live = 0.0,
        unit: str = 'any',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self) -> Signal: ...
class _OverTime(UnitOfOutput):
    kernel: Any
    interpolation: Any
    instants: Any
    samples: Any
    def take(self, times, samples): ...
    def output_range(self): ...
class TimeTable(_OverTime, Block):
    times: Param[Sequence[Any] | np.ndarray]
    values: Param[Sequence[Any] | np.ndarray]
    interpolation: Param[Literal['linear', 'previous']]
    repeat: Param[bool]
    unit: Param[str]
    y: Output
    instants: Memory
    samples: Memory
    def __init__(
        self,
        times: Sequence[Any] | np.ndarray = ...,
        values: Sequence[Any] | np.ndarray = ...,
        interpolation: Literal['linear', 'previous'] = 'linear',
        repeat: bool | Live = False,
        unit: str = 'any',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self) -> Signal: ...
class Playback(_OverTime, Block):
    file: Param[str]
    column: Param[str]
    time: Param[str]
    interpolation: Param[Literal['linear', 'previous']]
    repeat: Param[bool]
    unit: Param[str]
    y: Output
    instants: Memory
    samples: Memory
    of_column: Any
    def __init__(
        self,
        file: str,
        column: str,
        time: str = 'time',
        interpolation: Literal['linear', 'previous'] = 'linear',
        repeat: bool | Live = False,
        unit: str = '',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self) -> Signal: ...
class GaussianNoise(UnitOfOutput, Block):
    mean: Param[float]
    deviation: Param[float]
    seed: Param[int]
    unit: Param[str]
    y: Output
    def __init__(
        self,
        mean: float | Live = 0.0,
        deviation: float | Live = 1.0,
        seed: int | Live = 0,
        unit: str = 'any',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self) -> Signal: ...
class UniformNoise(UnitOfOutput, Block):
    lower: Param[float]
    upper: Param[float]
    seed: Param[int]
    unit: Param[str]
    y: Output
    def __init__(
        self,
        lower: float | Live = 0.0,
        upper: float | Live = 1.0,
        seed: int | Live = 0,
        unit: str = 'any',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self) -> Signal: ...
