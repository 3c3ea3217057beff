# Generated from the source by `python -m cext.stubs`. Do not edit.
from typing import Any
from cext.clock.signals import Signals
from cext.schedule.program import Program
from cext.schedule.publisher import Publisher

class Watchdog:
    def __init__(self, program: Program, journal: Publisher, signals: Signals, period: int, wanted: bool, processors: Any) -> None: ...
