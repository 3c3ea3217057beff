"""Diagnostics are data first and text last."""

import re
from pathlib import Path

import graph
from graph.diagnostics import CODES, Diagnostic, DiagramError, Location
from tests.checkout import python


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


def test_a_script_and_a_notebook_show_an_error_without_traceback_and_any_other_as_python_does(tmp_path):
    wrong = "from graph import Diagram, Sink\nwith Diagram('robot', rate=200):\n    Sink(name='log', evry=2)\n"
    (tmp_path / "robot.py").write_text(wrong)
    (tmp_path / "other.py").write_text("try:\n    import robot\nexcept ValueError:\n    pass\n")
    place = f"{tmp_path / 'robot.py'}:3"
    for file in ("robot.py", "other.py"):
        process = python(file, cwd=tmp_path)
        lines = f"{place}: error TW010 wrong parameter: Sink: has no parameter 'evry'\n    it has none\n"
        assert (process.returncode, process.stderr) == (1, lines)
    caught = "import sys\nexec(open('robot.py').read().replace('log', 'a/b'))"
    assert python("-c", caught, cwd=tmp_path).stderr.startswith("<string>:3: error TW")
    after = "try:\n    import robot\nexcept Exception as error:\n    print(error._render_traceback_())\n1 / 0\n"
    (tmp_path / "after.py").write_text(after)
    process = python("after.py", cwd=tmp_path)
    assert process.stdout == f"{lines.splitlines()}\n" and process.stderr.startswith("Traceback")
    assert process.stderr.endswith("ZeroDivisionError: division by zero\n")


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
