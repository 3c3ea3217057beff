# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import Literal
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.declarations import Live
from graph.signal import Operand, Signal
from typing import Any
from graph import Block, Input, Memory, Output, Param

class _Controller(Block):
    kp: Param[float]
    reference: Input
    measurement: Input
    command: Output
    unit: Any
def in_unit(port: Any, unit: str) -> Any: ...
class P(_Controller):
    unit: Param[str]
    def __init__(self, kp: float | Live = 1.0, unit: str = 'any', **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, *signals: Operand, **named: Operand) -> Signal: ...
class PD(_Controller):
    kd: Param[float]
    filter_time: Param[float]
    b: Param[float]
    c: Param[float]
    unit: Param[str]
    follower: Memory
    def __init__(
        self,
        kp: float | Live = 1.0,
        kd: float | Live = 0.0,
        filter_time: float | Live = 0.0,
        b: float | Live = 1.0,
        c: float | Live = 0.0,
        unit: str = 'any',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, *signals: Operand, **named: Operand) -> Signal: ...
class PID(_Controller):
    ki: Param[float]
    kd: Param[float]
    filter_time: Param[float]
    b: Param[float]
    c: Param[float]
    lower: Param[float]
    upper: Param[float]
    anti_windup: Param[Literal['clamping', 'back-calculation']]
    tracking_time: Param[float | None]
    unit: Param[str]
    manual: Input
    manual_command: Input
    clamps: Memory
    integral: Memory
    follower: Memory
    def __init__(
        self,
        kp: float | Live = 1.0,
        ki: float | Live = 0.0,
        kd: float | Live = 0.0,
        filter_time: float | Live = 0.0,
        b: float | Live = 1.0,
        c: float | Live = 0.0,
        lower: float | Live = ...,
        upper: float | Live = ...,
        anti_windup: Literal['clamping', 'back-calculation'] = 'clamping',
        tracking_time: float | None | Live = None,
        unit: str = 'any',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, *signals: Operand, **named: Operand) -> Signal: ...
class PI(PID):
    tracking_time: Param[float | None]
    def __init__(
        self,
        kp: float | Live = 1.0,
        ki: float | Live = 0.0,
        b: float | Live = 1.0,
        lower: float | Live = ...,
        upper: float | Live = ...,
        anti_windup: Literal['clamping', 'back-calculation'] = 'clamping',
        tracking_time: float | None | Live = None,
        unit: str = 'any',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, *signals: Operand, **named: Operand) -> Signal: ...
