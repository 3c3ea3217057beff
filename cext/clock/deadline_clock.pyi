# Generated from the source by `python -m cext.stubs`. Do not edit.
from cext.clock.signals import Signals

class DeadlineClock:
    rate: float
    sleeps: int
    spins: int
    def __init__(self, rate: float, signals: Signals, *, spin: int = 0) -> None: ...
    def grid(self, tick: int) -> int: ...
    def newest(self, ns: int) -> int: ...
