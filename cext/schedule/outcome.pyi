# Generated from the source by `python -m cext.stubs`. Do not edit.
from typing import Any
from dataclasses import dataclass

STATUS: dict[Any, Any]
def name_of(status: int) -> str: ...
@dataclass(frozen=True)
class Outcome:
    status: str
    culprit: str | None
    tick: int
    signal: int
    error: BaseException | None
    unconfirmed: tuple
    unanswered: tuple
    stopped: str = ...
    hung: float = ...
    faults: tuple = ...
    late: tuple = ...
    @property
    def faulted(self) -> bool: ...
