# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.declarations import Live
from graph.signal import Operand, Signal
from graph import Block, Input, Memory, Output, Param

class Saturation(Block):
    lower: Param[float]
    upper: Param[float]
    u: Input
    y: Output
    def __init__(
        self,
        lower: float | Live = -1.0,
        upper: float | Live = 1.0,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, u: Operand = ...) -> Signal: ...
class SlewRate(Block):
    rate: Param[float]
    u: Input
    y: Output
    previous: Memory
    def __init__(self, rate: float | Live = 1.0, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, u: Operand = ...) -> Signal: ...
class TorqueLimiter(Block):
    limit: Param[float]
    slew: Param[float | None]
    torque: Input
    limited: Output
    previous: Memory
    def __init__(
        self,
        limit: float | Live,
        slew: float | None | Live = None,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, torque: Operand = ...) -> Signal: ...
class DeadZone(Block):
    lower: Param[float]
    upper: Param[float]
    u: Input
    y: Output
    def __init__(
        self,
        lower: float | Live = -1.0,
        upper: float | Live = 1.0,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, u: Operand = ...) -> Signal: ...
def beyond(u: float, lower: float, upper: float) -> float: ...
class PowerLimiter(Block):
    power: Param[float]
    torque: Input
    velocity: Input
    limited: Output
    def __init__(self, power: float | Live = 100.0, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, torque: Operand = ..., velocity: Operand = ...) -> Signal: ...
class SoftStop(Block):
    lower: Param[float]
    upper: Param[float]
    stiffness: Param[float]
    damping: Param[float]
    torque: Input
    position: Input
    velocity: Input
    stopped: Output
    def __init__(
        self,
        lower: float | Live = -1.0,
        upper: float | Live = 1.0,
        stiffness: float | Live = 100.0,
        damping: float | Live = 1.0,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, torque: Operand = ..., position: Operand = ..., velocity: Operand = ...) -> Signal: ...
class RMSTorqueLimiter(Block):
    limit: Param[float]
    window: Param[float]
    fade: Param[float]
    torque: Input
    limited: Output
    squares: Memory
    sums: Memory
    place: Memory
    ticks: Memory
    def __init__(
        self,
        limit: float | Live,
        window: float = 20.0,
        fade: float = 1.0,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, torque: Operand = ...) -> Signal: ...
    def design(self, dt: float) -> tuple[int, float]: ...
class TemperatureDerating(Block):
    full: Param[float]
    none: Param[float]
    torque: Input
    temperature: Input
    derated: Output
    def __init__(
        self,
        full: float | Live = 80.0,
        none: float | Live = 100.0,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, torque: Operand = ..., temperature: Operand = ...) -> Signal: ...
class SoftStart(Block):
    duration: Param[float]
    u: Input
    enable: Input
    y: Output
    elapsed: Memory
    def __init__(self, duration: float | Live = 1.0, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, u: Operand = ..., enable: Operand = ...) -> Signal: ...
