# Generated from the source by `python -m cext.stubs`. Do not edit.
from typing import Any
from cext.bus.memory_bus import BusEnd

class ReplayBus:
    host: BusEnd
    def __init__(self, drains: Any) -> None: ...
class ReplayClock:
    simulated: bool
    def __init__(self, ticks: Any, late: Any, simulated: bool, drained: Any = ...) -> None: ...
