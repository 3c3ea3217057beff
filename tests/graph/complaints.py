"""What tests of errors share: every diagnostic of a compile, and the line that a diagnostic must name."""

import sys

import pytest

from graph import DiagramError, compile
from graph.diagnostics import Location


def here(offset=0):
    """The caller's own line, or one `offset` lines from it, as a diagnostic gives it."""
    frame = sys._getframe(1)
    return Location(frame.f_code.co_filename, frame.f_lineno + offset)


def complaints(diagram):
    """Every diagnostic of a diagram that does not compile."""
    with pytest.raises(DiagramError) as caught:
        compile(diagram)
    return caught.value.diagnostics


def complaint(diagram):
    """The one diagnostic of a diagram with one mistake."""
    (found,) = complaints(diagram)
    return found


def refusal(call, *arguments, **named):
    """The one diagnostic of what is refused on the spot."""
    with pytest.raises(DiagramError) as caught:
        call(*arguments, **named)
    (found,) = caught.value.diagnostics
    return found
