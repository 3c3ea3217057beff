# Generated from the source by `python -m cext.stubs`. Do not edit.
from typing import Any

class LiveRules:
    entries: list
    def __init__(self, entries: Any, count: int) -> None: ...
    def check(self, targets: Any) -> None: ...
