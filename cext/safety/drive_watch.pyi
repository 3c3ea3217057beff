# Generated from the source by `python -m cext.stubs`. Do not edit.
from typing import Any

MODES: dict[Any, Any]
ABOUT: dict[Any, Any]
class DriveWatch:
    def __init__(self, schedule: Any) -> None: ...
    @property
    def found(self) -> list[dict[str, Any]]: ...
