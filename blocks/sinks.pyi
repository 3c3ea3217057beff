# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import Literal
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.signal import Operand
from graph import Param, Sink

class PlotJuggler(Sink):
    host: Param[str]
    port: Param[int]
    signals: Param[str]
    decimation: Param[int]
    time: Param[Literal['device', 'relative']]
    batch: Param[int]
    virtual_time: Param[bool]
    def __init__(
        self,
        host: str = '127.0.0.1',
        port: int = 9870,
        signals: str = '',
        decimation: int = 1,
        time: Literal['device', 'relative'] = 'device',
        batch: int = 1,
        virtual_time: bool = False,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, *signals: Operand, **named: Operand) -> PlotJuggler: ...
    def is_active(self, virtual: bool) -> bool: ...
class Rerun(Sink):
    target: Param[str]
    port: Param[int]
    web_port: Param[int]
    def __init__(
        self,
        target: str = '',
        port: int = 9876,
        web_port: int = 9090,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, *signals: Operand, **named: Operand) -> Rerun: ...
