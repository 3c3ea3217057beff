# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import Literal, NamedTuple
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.signal import Operand, Signal
from typing import Any
from graph import Input, Memory, Output, Param, StreamDevice

BIASES: tuple[Any, ...]
class GpioLine:
    chip: Any
    pin: Any
    active_low: Any
    bias: Any
    debounce: Any
    parameters: dict[str, Param[Any]]
    line: str
    hardware: tuple[Any, ...]
    def opening(self) -> dict[str, float | str]: ...
class GpioInput(GpioLine, StreamDevice):
    bias: Param[Literal['as_is', 'disabled', 'pull_up', 'pull_down']]
    debounce: Param[float]
    on: Output
    known: Output
    rises: Output
    falls: Output
    rise_time: Output
    fall_time: Output
    missed: Output
    age: Output
    state: Memory
    def __init__(
        self,
        chip: str = '/dev/gpiochip0',
        pin: str = '',
        active_low: bool = False,
        bias: Literal['as_is', 'disabled', 'pull_up', 'pull_down'] = 'as_is',
        debounce: float = 0.0,
        bus: str = '',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    class Outputs(NamedTuple):
        on: Signal
        known: Signal
        rises: Signal
        falls: Signal
        rise_time: Signal
        fall_time: Signal
        missed: Signal
        age: Signal
    def __call__(self) -> Outputs: ...
    def emulator(self, **parameters: Any) -> Any: ...
class SyncIn(GpioInput):
    def __init__(
        self,
        chip: str = '/dev/gpiochip0',
        pin: str = '',
        active_low: bool = False,
        bias: Literal['as_is', 'disabled', 'pull_up', 'pull_down'] = 'as_is',
        debounce: float = 0.0,
        bus: str = '',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    class Outputs(NamedTuple):
        on: Signal
        known: Signal
        rises: Signal
        falls: Signal
        rise_time: Signal
        fall_time: Signal
        missed: Signal
        age: Signal
    def __call__(self) -> Outputs: ...
class EStopSwitch(GpioLine, StreamDevice):
    active_low: Param[bool]
    bias: Param[Literal['as_is', 'disabled', 'pull_up', 'pull_down']]
    debounce: Param[float]
    pressed: Output
    known: Output
    age: Output
    state: Memory
    def __init__(
        self,
        chip: str = '/dev/gpiochip0',
        pin: str = '',
        active_low: bool = True,
        bias: Literal['as_is', 'disabled', 'pull_up', 'pull_down'] = 'pull_up',
        debounce: float = 0.0,
        bus: str = '',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    class Outputs(NamedTuple):
        pressed: Signal
        known: Signal
        age: Signal
    def __call__(self) -> Outputs: ...
    def emulator(self, **parameters: Any) -> Any: ...
class SyncOut(GpioLine, StreamDevice):
    duration: Param[float]
    pulse: Input
    high: Output
    state: Memory
    def __init__(
        self,
        chip: str = '/dev/gpiochip0',
        pin: str = '',
        active_low: bool = False,
        duration: float = 0.1,
        bus: str = '',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, pulse: Operand = ...) -> Signal: ...
    def emulator(self, **parameters: Any) -> Any: ...
class EmulatedGpio(StreamDevice):
    rest: Param[bool]
    level: Input
    lost: Input
    on: Output
    state: Memory
    def __init__(self, rest: bool = False, bus: str = '', **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, level: Operand = ..., lost: Operand = ...) -> Signal: ...
