# Generated from the source by `python -m cext.stubs`. Do not edit.
from typing import Any
from cext.bus.memory_bus import BusEnd

class ReplayBus:
    host: BusEnd
    def __init__(self) -> None: ...
    def give(self, frames: Any, drains: Any) -> Any: ...
class ReplayClock:
    error: Any
    simulated: bool
    confirmed: int
    def __init__(self, refill: Any, simulated: bool, drained: Any = ..., confirmed: Any = -1) -> None: ...
    def give(self, ticks: Any, late: Any) -> Any: ...
