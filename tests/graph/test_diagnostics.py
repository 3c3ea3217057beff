"""Diagnostics are data first and text last."""

import re
from pathlib import Path

import graph
from graph.diagnostics import CODES, Diagnostic, DiagramError, Location


def test_a_diagnostic_prints_one_line_and_its_remedy():
    found = Diagnostic(
        "TW002", "expected rad, got N·m from left/sum.y", "left/gain", "u", Location("knee.py", 12), "convert it first"
    )
    assert str(found) == (
        "knee.py:12: error TW002 unit mismatch: left/gain.u: expected rad, got N·m from left/sum.y\n    convert it "
        "first"
    )
    assert found.title == "unit mismatch"


def test_a_diagnostic_without_location_block_and_remedy_prints_one_line():
    assert str(Diagnostic("TW010", "the rate must be above 0 Hz")) == (
        "error TW010 wrong parameter: the rate must be above 0 Hz"
    )
    unused = Diagnostic("TW020", "its outputs are not connected", "g", severity="warning")
    assert str(unused) == "warning TW020 unused outputs: g: its outputs are not connected"


def test_an_error_carries_and_prints_all_of_them():
    first, second = Diagnostic("TW001", "one", "a"), Diagnostic("TW002", "two", "b")
    error = DiagramError([first, second])
    assert error.diagnostics == [first, second] and str(error) == f"{first}\n{second}"
    assert DiagramError(first).diagnostics == [first]


def test_every_code_is_used_and_every_use_is_a_code():
    used = set()
    for file in Path(graph.__file__).parent.glob("*.py"):
        if file.name != "diagnostics.py":
            used |= set(re.findall(r'"(TW\d{3})"', file.read_text()))
    assert used == set(CODES)


def test_every_code_has_a_test_that_provokes_it():
    tested = set()
    for file in Path(__file__).parents[1].rglob("test_*.py"):
        if file != Path(__file__):
            tested |= set(re.findall(r'"(TW0\d{2})"', file.read_text()))
    assert tested == set(CODES)
