# Generated from the source by `python -m cext.stubs`. Do not edit.
from typing import Any

class DeviceTable:
    def __init__(self, schedule: Any, memory: Any) -> None: ...
