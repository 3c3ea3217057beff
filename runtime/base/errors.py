"""Errors of the command line, and its exit codes."""

OK, CHECK_FAILED, BAD_INPUT, FAULT = 0, 1, 2, 3


class BadInput(Exception):
    """Unusable input of the user. The text states what is wrong, where, and what to do.

    diagnostics : list of graph.Diagnostic, if the language rejected a diagram
    """

    code = BAD_INPUT
    diagnostics: tuple = ()
