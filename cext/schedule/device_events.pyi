# Generated from the source by `python -m cext.stubs`. Do not edit.
from typing import Any

EVENTS: dict[Any, Any]
class DeviceEvents:
    def __init__(self, devices: Any) -> None: ...
