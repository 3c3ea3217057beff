# Generated from the source by `python -m cext.stubs`. Do not edit.
from typing import Any
from cext.schedule.live import LiveTable

class Devices:
    reports: Any
    def __init__(self, schedule: Any, ends: Any, memory: Any, live: LiveTable) -> None: ...
