# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import Any, Literal
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.signal import Operand
from graph import Input, Param, Sink

SEPARATORS: dict[Any, Any]
class CsvRecorder(Sink):
    record: Param[str]
    delimiter: Param[str]
    names: Param[dict[Any, Any]]
    text: Param[bool]
    flush_rows: Param[int]
    time: Param[Literal['relative', 'device']]
    overwrite: Param[bool]
    during: Param[str]
    file: Param[str]
    def __init__(
        self,
        record: str = '',
        delimiter: str = ',',
        names: dict[Any, Any] = ...,
        text: bool = False,
        flush_rows: int = 200,
        time: Literal['relative', 'device'] = 'relative',
        overwrite: bool = False,
        during: str = '',
        file: str = '',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, *signals: Operand, **named: Operand) -> CsvRecorder: ...
class StrideReport(Sink):
    title: Param[str]
    positive: Param[str]
    phase: Input
    walking: Input
    angle: Input
    velocity: Input
    torque: Input
    def __init__(self, title: str = '', positive: str = '', **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, *signals: Operand, **named: Operand) -> StrideReport: ...
