"""Command lines of every page, which the parser of their command accepts, and the defaults of options."""

import re

import pytest

from runtime.cli.main import COMMANDS
from tests.checkout import ROOT
from tests.docs.command_lines import LINE, parser_of, refusal, words
from tests.docs.pages import NAMES

PARTS = [["stream", "imu"], ["stream", "i2c"], ["stream", "openimu"]]
PARTS += [["bench", part] for part in ("start", "clock", "bus", "can", "deaths", "sensors", "views", "gait")]


@pytest.mark.parametrize("page", NAMES)
def test_every_command_line_of_the_page_is_accepted(page):
    for line in LINE.findall((ROOT / page).read_text()):
        assert not refusal(words(line)), line


def test_a_wrong_option_is_refused():
    assert "--rat" in refusal(["stream", "imu", "--rat", "100"])


@pytest.mark.parametrize("command", [[name] for name in COMMANDS] + PARTS, ids=" ".join)
def test_the_help_states_the_defaults_of_the_options(command):
    for action in parser_of(command)._actions:
        found = re.search(r"default: (-?[\d.e]+)\b", (action.help or "").replace(" million", "e6"))
        if found and isinstance(action.default, (int, float)):
            assert float(found[1].rstrip(".")) == action.default, action.option_strings


def test_the_page_of_the_tools_states_the_defaults_of_move():
    page = (ROOT / "docs" / "reference" / "tools.md").read_text()
    parser = parser_of(["move", "3"])
    for option, pattern in (
        ("rise", r"rises within ([\d.]+) s \(`--rise`\)"),
        ("speed", r"position at ([\d.]+) rad/s \(`--speed`\)"),
        ("duration", r"The run lasts ([\d.]+) s \(`--duration`\)"),
        ("fastest", r"faster than ([\d.]+) rad/s \(`--fastest`\)"),
    ):
        assert float(re.search(pattern, page)[1]) == parser.get_default(option), option
