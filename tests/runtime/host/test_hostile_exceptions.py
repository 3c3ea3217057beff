"""Exceptions whose text is hostile: `__str__` raises, never returns, or catches whatever interrupts it."""

import re
import time

import pytest

from cext.user_text import TEXT_LIMIT, last_lines, name_and_text, text_of
from runtime.record.recorder.report import reason
from tests.runtime.runs import finished, line_of, write
from tests.soaking import crossed, soaked

pytestmark = pytest.mark.paced

ROBOT = '''
import time

from graph import Block, Diagram, Output


class Broken(Exception):
    def __str__(self):
        {text}

    __repr__ = __str__


class Law(Block):
    """Raises an exception that has no text."""

    y = Output("1")

    def step(self, tick):
        if {when}:
            open("raised", "w").write(str(time.monotonic()))
            raise Broken
        return 1.0


with Diagram("broken", rate=100) as diagram:
    Law({options}name="law")
    {more}
'''
TRIES = 5  # until one is in time: another process may have the processor in the others

RAISES = "raise ValueError('no text')"
HANGS = "time.sleep(3600)"
CATCHES = """while True:
            try:
                time.sleep(3600)
            except BaseException:
                pass"""


class Text(str):
    def __format__(self, spec):
        raise ValueError

    __str__ = __len__ = __bool__ = __format__


def broken(form):
    return type("Broken", (Exception,), {"__str__": lambda self: form()})()


def fail():
    raise SystemExit("of a text")


def test_a_text_equals_the_result_of_str():
    assert text_of(ValueError("no such gain")) == "no such gain"
    assert (
        name_and_text(ValueError("no such gain")) == "ValueError: no such gain"
        and name_and_text(ValueError()) == "ValueError"
    )
    assert last_lines(KeyError("gain")) == ["KeyError: 'gain'"]


def test_a_text_of_a_hostile_subclass_of_str_becomes_a_plain_one():
    text = text_of(broken(lambda: Text("a text")))
    assert text == "a text" and type(text) is str


@pytest.mark.parametrize(
    "form, why",
    [
        (lambda: 1, "it raised TypeError"),
        (fail, "it raised SystemExit"),
        (lambda: time.sleep(2), f"within {TEXT_LIMIT * 1e3:.0f} ms"),
    ],
)
def test_a_text_that_cannot_be_formed_is_replaced_by_the_reason_in_time(form, why):
    took = []
    for _ in range(TRIES):
        began = time.monotonic()
        text = name_and_text(broken(form))
        took.append(time.monotonic() - began)
        assert text.startswith("Broken: (no text") and why in text and type(text) is str
    assert min(took) < 2 * TEXT_LIMIT


def test_the_recorder_forms_the_text_of_a_service_in_time():
    assert reason(broken(lambda: time.sleep(2))) == f"Broken: (no text within {TEXT_LIMIT * 1e3:.0f} ms)"


@pytest.mark.parametrize("text", soaked([RAISES, HANGS, CATCHES], but=[1, 2]), ids=["raises", "hangs", "catches"])
def test_exception_without_text_ends_in_fault_and_summary(tmp_path, text):
    path = write(tmp_path, ROBOT.format(text=text, when="tick >= 20", options="", more=""))
    process = finished(path, "--duration", "5", "--no-record", cwd=tmp_path, timeout=20)
    ended = time.monotonic()
    lines = [line for line in process.stderr.splitlines() if "TW020" not in line]
    assert process.returncode == 3
    assert re.fullmatch(r"FAULT at law, tick 2\d \(0\.2\d* s\): its step raised an exception", lines[0])
    assert lines[1].startswith(f"  robot.py:{line_of(path, 'raise Broken')} in step:")
    assert lines[2].startswith(("  Broken: (no text", "  robot.Broken: <exception str() failed>"))
    assert "Traceback" not in process.stderr and process.stdout.startswith("broken: ")
    assert ended - float((tmp_path / "raised").read_text()) < 1.0  # with the end of the interpreter and of the recorder


def test_held_exceptions_without_a_text_are_counted_in_the_summary(tmp_path):
    more = "Law(hold_exceptions=3, name='other')"
    path = write(tmp_path, ROBOT.format(text=CATCHES, when="tick == 20", options="hold_exceptions=3, ", more=more))
    began = time.monotonic()
    process = finished(path, "--duration", "0.5", "--fast", "--no-record", cwd=tmp_path, timeout=20)
    assert process.returncode == 0 and "Traceback" not in process.stderr
    assert (
        "law held 1 exception" in process.stdout
        and "other held 1 exception" in process.stdout
        and "(no text within" in process.stdout
    )
    assert time.monotonic() - began < 10.0


def test_file_that_raises_exception_without_text_is_refused_at_its_line(tmp_path):
    path = write(
        tmp_path, "class Broken(BaseException):\n    def __str__(self):\n        raise ValueError\n\n\nraise Broken\n"
    )
    process = finished(path, cwd=tmp_path, timeout=20)
    assert process.returncode == 2 and "Traceback" not in process.stderr
    assert process.stderr.splitlines()[0] == "tickwork: robot.py:6: Broken: (no text: it raised ValueError)"


@pytest.mark.parametrize("function, text", crossed(["build", "plant"], [RAISES, HANGS]))
def test_the_text_of_a_wrong_return_value_has_a_time_limit(tmp_path, text, function):
    more = "class Other:\n    def __repr__(self):\n        {text}\n\n\ndef {function}(*robot):\n    return Other()\n"
    body = ROBOT.format(text="pass", when="False", options="", more="pass")
    path = write(tmp_path, body + "\n" + more.format(text=text, function=function))
    process = finished(path, "--fast", "--duration", "1", "--no-record", cwd=tmp_path)
    assert process.returncode == 2 and "Traceback" not in process.stderr
    assert f"{function}() returned (no text" in process.stderr and "must return a Diagram" in process.stderr
