# Generated from the source by `python -m cext.stubs`. Do not edit.
from cext.clock.deadline_clock import DeadlineClock
from cext.clock.stopwatch import Stopwatch
from cext.schedule.program import Program
from cext.schedule.publisher import Publisher

class Tick:
    watch: Stopwatch
    plant_watch: Stopwatch
    def __init__(self, control: Program, plant: Program, substeps: int, pace: DeadlineClock, journal: Publisher, real_time: bool, profile: bool) -> None: ...
    def spin(self, ticks: int) -> tuple[int, int]: ...
