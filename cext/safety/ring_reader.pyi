# Generated from the source by `python -m cext.stubs`. Do not edit.
from typing import Any
from cext.safety.shared_state import SharedState

def take(page: SharedState, columns: int) -> Any: ...
