# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import NamedTuple
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.signal import Operand, Signal
from graph.device import Sequence
from typing import Any, TYPE_CHECKING as TYPE_CHECKING
from graph import Block, Device, Input, Memory, Output, Param

class EmergencyStop(Block):
    pressed: Input
    def __init__(self, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, pressed: Operand = ...) -> EmergencyStop: ...
class Rearm(Block):
    request: Input
    def __init__(self, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, request: Operand = ...) -> Rearm: ...
class EStopHeartbeat(Device):
    bus: Param[str]
    can_id: Param[int]
    timeout: Param[float]
    pressed: Output
    age: Output
    count: Output
    state: Memory
    def __init__(
        self,
        bus: str = 'estop',
        can_id: int = 256,
        timeout: float = 0.1,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    class Outputs(NamedTuple):
        pressed: Signal
        age: Signal
        count: Signal  # type: ignore[assignment]
    def __call__(self) -> Outputs: ...
    def addresses(self) -> Sequence[tuple[Any, bool]]: ...
    def acceptance_filters(self) -> list[tuple[int, int, bool]]: ...
    def traffic(self) -> Sequence[tuple[int, bool]]: ...
    def emulator(self, **parameters: Any) -> Any: ...
class EmulatedEStop(Device):
    bus: Param[str]
    can_id: Param[int]
    period: Param[float]
    pressed: Input
    silent: Input
    state: Memory
    def __init__(
        self,
        bus: str = 'estop',
        can_id: int = 256,
        period: float = 0.02,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, pressed: Operand = ..., silent: Operand = ...) -> EmulatedEStop: ...
    @classmethod
    def of(cls, button: Any, **parameters: Any) -> Any: ...
    def addresses(self) -> Sequence[tuple[Any, bool]]: ...
