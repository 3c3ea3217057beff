# Generated from the source by `python -m cext.stubs`. Do not edit.
from typing import Any
from cext.clock.signals import Signals
from cext.safety.shared_state import SharedState
from cext.schedule.program import Program

class Publisher:
    error: Any
    def __init__(self, page: SharedState, program: Program, virtual: bool, reader: int, signals: Signals, guard: int = 0, rows: Any = None, drain: Any = None, plant: Program | None = None) -> None: ...
    def newest(self) -> list[tuple]: ...
