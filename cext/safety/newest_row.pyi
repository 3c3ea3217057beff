# Generated from the source by `python -m cext.stubs`. Do not edit.
from typing import Any
from cext.safety.shared_state import SharedState

class NewestRow:
    values: Any
    tick: int
    def __init__(self, page: SharedState, columns: int) -> None: ...
    def look(self) -> bool: ...
