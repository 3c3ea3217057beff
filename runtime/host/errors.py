"""Errors of the command line, and its exit codes."""

from typing import Any

OK, CHECK_FAILED, BAD_INPUT, FAULT, NOT_RECORDED = 0, 1, 2, 3, 4


class BadInput(Exception):
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
