"""docs/reference/tools.md: its scan output matches the command, and its options exist."""

import re

import pytest

from runtime.cli.main import COMMANDS, GROUPS
from runtime.host.errors import OK
from tests.runtime.runs import ROOT
from tests.runtime.setup.commissioning.nodes import Mit, Nodes, OpenImu, Private
from tests.runtime.test_documents import shown_after

PAGE = (ROOT / "docs" / "reference" / "tools.md").read_text()
TOOLS = ("scan", "configure", "move", "stream")


def without_rates(lines):
    return [re.sub(r"\d+ Hz", "# Hz", line) for line in lines]


def test_scan_output_of_the_page_matches_the_command(command_line):
    with Nodes(90, Mit(3, position=0.5), Private(9), OpenImu()) as nodes:
        code, out, err = command_line("scan", *nodes.words, "--listen", "0.1")
    shown = [line for line in shown_after(PAGE, "## Scanning a bus") if line and not line.startswith("python")]
    printed = out.replace(f"bus can  udp_multicast {nodes.channel}", "bus can0  socketcan can0").splitlines()
    assert (code, err) == (OK, "") and without_rates(printed) == without_rates(shown)


@pytest.mark.parametrize("tool", TOOLS)
def test_help_lists_every_option_of_the_page(command_line, tool):
    with pytest.raises(SystemExit) as ended:
        command_line(tool, "--help")
    help_text = command_line.capsys.readouterr().out
    assert ended.value.code == OK and tool in COMMANDS and tool in PAGE
    for line in re.findall(rf"^    python -m runtime {tool} (.*)$", PAGE, re.MULTILINE):
        assert all(option in help_text for option in re.findall(r"--[\w-]+", line)), line
    assert "{" not in help_text.split("options:")[0].replace("{off,try,require}", "")


def test_device_commands_are_in_one_group_of_the_help():
    assert any(set(TOOLS) <= set(group) for group in GROUPS.values())
