"""Errors of the command line, and its exit codes."""

from pathlib import Path
from typing import Any

OK, CHECK_FAILED, BAD_INPUT, FAULT, NOT_RECORDED = 0, 1, 2, 3, 4


OWN = tuple(f"{Path(__file__).parents[2] / package}/" for package in ("runtime", "blocks", "graph", "cext"))


class ShownInCell(Exception):
    """Base class of errors that a notebook shows as the user's line and their text, instead of a traceback."""

    def _render_traceback_(self) -> list[str]:
        import traceback

        frames = traceback.extract_tb(self.__traceback__)
        entry = next((place for place, frame in enumerate(frames) if frame.filename.startswith(OWN)), len(frames))
        where = [f"line {frames[entry - 1].lineno}: {frames[entry - 1].line}"] if entry else []
        return [*where, *f"{type(self).__name__}: {self.args[0] if self.args else ''}".splitlines()]


class UnknownName(ShownInCell, KeyError):
    """A signal or parameter that a recording or a run does not have. hint : what to do instead, if known"""

    def __init__(self, text: str, hint: str = "") -> None:
        super().__init__(f"{text}: {hint}" if hint else text)
        self.hint = hint


class BadInput(ShownInCell):
    """Unusable input of the user. The text states what is wrong, where, and what to do.

    diagnostics : list of graph.Diagnostic, if the language rejected a diagram
    """

    code = BAD_INPUT
    diagnostics: tuple[Any, ...] = ()


class RunFault(RuntimeError):
    """A fault in a run that a program advances or follows.

    fault : dict with `status`, `culprit`, `tick` and `report`, as in Trial.fault
    """

    def __init__(self, fault: dict[str, Any]) -> None:
        super().__init__("\n".join(fault["report"]) or fault["status"])
        self.fault = fault
