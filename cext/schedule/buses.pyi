# Generated from the source by `python -m cext.stubs`. Do not edit.
from typing import Any

class Buses:
    def __init__(self, schedule: Any, ends: Any) -> None: ...
