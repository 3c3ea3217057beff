"""What the command line says when something is wrong: one clear line, and an exit code."""

OK, CHECK_FAILED, BAD_INPUT, FAULT = 0, 1, 2, 3


class BadInput(Exception):
    """Something the user typed or wrote cannot be used. Its text says what, where and what to do.

    diagnostics : graph.Diagnostic of what the language has refused, if it was that
    """

    code = BAD_INPUT
    diagnostics = ()
