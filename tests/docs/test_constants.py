"""Constants that pages print are those of the code."""

import re

import pytest

from blocks.sinks import PlotJuggler, Rerun
from cext.schedule.mailbox_writer import CHANGE_LIMIT
from graph.conformance import check_block
from graph.declarations import RAMP_TIME
from runtime.base import errors
from tests.checkout import ROOT

PORT = PlotJuggler.parameters["port"].default
PRINTED = [  # page, pattern whose groups are numbers, and their values
    ("how_to/plotjuggler", r"Enter port (\d+)", PORT),
    ("how_to/plotjuggler", r"address that the block sends to, port (\d+)", PORT),
    ("how_to/plotjuggler", r"`\[::1\]:(\d+)`", PORT),
    ("how_to/rerun", r"listens on port (\d+)", Rerun.parameters["port"].default),
    ("how_to/tuning", r"settings of one command, up to (\d+),", CHANGE_LIMIT),
    ("reference/sensors", r"--plotjuggler 127.0.0.1:(\d+)", PORT),
    ("reference/tools", r"--plotjuggler 127.0.0.1:(\d+)", PORT),
]


@pytest.mark.parametrize("page, pattern, value", PRINTED)
def test_a_printed_number_is_that_of_the_code(page, pattern, value):
    found = re.findall(pattern, (ROOT / "docs" / f"{page}.md").read_text())
    assert found and all(float(number) == value for number in found)


@pytest.mark.parametrize("page", ["how_to/blocks", "how_to/tuning"])
def test_the_pages_state_the_time_of_a_ramp(page):
    assert RAMP_TIME == 1.0 and re.search(r"range in\s+one\s+second", (ROOT / "docs" / f"{page}.md").read_text())


def test_the_page_of_running_lists_the_exit_codes_of_the_code():
    text = (ROOT / "docs" / "reference" / "running.md").read_text()
    codes = {int(code) for code in re.findall(r"^\| (\d+) \|", text[text.index("| exit code |") :], re.MULTILINE)}
    own = {value for name, value in vars(errors).items() if name.isupper() and type(value) is int}
    assert own <= codes, own - codes


def test_the_docstring_of_the_conformance_test_numbers_its_checks():
    assert len(re.findall(r"^ +\d+\. ", check_block.__doc__, re.MULTILINE)) == 10
