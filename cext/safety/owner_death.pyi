# Generated from the source by `python -m cext.stubs`. Do not edit.
from cext.safety.shared_state import SharedState

class OwnerDeathWatcher:
    fd: int
    def __init__(self, page: SharedState, priority: int = 0) -> None: ...
