# Generated from the source by `python -m cext.stubs`. Do not edit.
from typing import Any
from cext.bus.memory_bus import BusEnd
from cext.schedule.program import Program

def time_of_ticks(end: BusEnd, own: int, other: int, frames: int, rounds: int) -> tuple[list[int], list[int]]: ...
def time_of_control(control: Program, other: BusEnd, answers: Any, rounds: int, rate: float = 1000.0) -> list[int]: ...
