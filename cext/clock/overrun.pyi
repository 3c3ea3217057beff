# Generated from the source by `python -m cext.stubs`. Do not edit.

NUMBER_LIMIT: int
POLICIES: str
class Overrun:
    catch_up: int
    in_a_row: int
    in_window: int
    window: int
    fault: bool
    def __init__(self, words: str = "skip") -> None: ...
    def reset(self) -> None: ...
    def decide(self, tick: int, newest: int) -> int: ...
