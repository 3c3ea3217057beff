"""docs/tools.md: its scan is what a scan prints, its commands are taken, and it has every option that it should tell
of.
"""

import re

import pytest

from runtime.base.errors import OK
from runtime.cli.main import COMMANDS
from tests.runtime.commissioning.nodes import Mit, Nodes, OpenImu, Private
from tests.runtime.runs import ROOT
from tests.runtime.test_documents import shown_after

PAGE = (ROOT / "docs" / "tools.md").read_text()
TOOLS = ("scan", "configure", "move", "stream")


def without_rates(lines):
    return [re.sub(r"\d+ Hz", "# Hz", line) for line in lines]


def test_the_scan_of_the_page_is_what_a_scan_prints(command_line):
    with Nodes(90, Mit(3, position=0.5), Private(9), OpenImu()) as nodes:
        code, out, err = command_line("scan", *nodes.words, "--listen", "0.1")
    shown = [line for line in shown_after(PAGE, "## Scanning a bus") if line and not line.startswith("python")]
    told = out.replace(f"bus can  udp_multicast {nodes.channel}", "bus can0  socketcan can0").splitlines()
    assert (code, err) == (OK, "") and without_rates(told) == without_rates(shown)


@pytest.mark.parametrize("tool", TOOLS)
def test_help_tells_every_option_of_the_page(command_line, tool):
    with pytest.raises(SystemExit) as ended:
        command_line(tool, "--help")
    help_text = command_line.capsys.readouterr().out
    assert ended.value.code == OK and tool in COMMANDS and tool in PAGE
    for line in re.findall(rf"^    python -m runtime {tool} (.*)$", PAGE, re.MULTILINE):
        assert all(option in help_text for option in re.findall(r"--[\w-]+", line)), line
    assert "{" not in help_text.split("options:")[0].replace("{off,try,require}", "")


def test_the_tools_stand_together_in_the_table_of_commands():
    names = list(COMMANDS)
    assert names[names.index("scan") : names.index("scan") + 4] == list(TOOLS)


def test_links_lead_somewhere():
    for target in re.findall(r"\]\((?!https?:)([^)#]+)", PAGE):
        assert (ROOT / "docs" / target).exists(), target
