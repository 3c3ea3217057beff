# Generated from the source by `python -m cext.stubs`. Do not edit.
from typing import Any

class SpeedBands:
    count: int
    round: int
    transit: int
    def __init__(self, bands: Any, round: int, acceleration: float, velocity: Any = None, transit: int = 0) -> None: ...
    def note_frame(self, identifier: int, data: bytes, now: int) -> bool: ...
    def frames(self, now: int) -> list[tuple[int, bytes]]: ...
