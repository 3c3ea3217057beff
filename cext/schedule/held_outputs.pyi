# Generated from the source by `python -m cext.stubs`. Do not edit.
from typing import Any

class HeldOutputs:
    def __init__(self, entries: Any) -> None: ...
