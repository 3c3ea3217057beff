"""Command lines of every page: the command exists, and its help lists each option."""

import re
import shlex

import pytest

from runtime.cli.main import COMMANDS, main
from tests.checkout import ROOT
from tests.docs.pages import NAMES

LINE = re.compile(r"python -m runtime ([^`\n]*)")
PLACEHOLDERS = ("FILE", "...")  # of a diagram file
PARTS = {"stream": ("actuator", "imu", "openimu", "i2c"), "bench": ("gait",)}  # words with a help of their own


def words(line):
    """Return the words of a command line up to its end, a pipe or a comment."""
    line = re.split(r"\s(?:\||>|#|&&|;)|\s{3,}", line.rstrip("\\"))[0]
    try:
        return shlex.split(line)
    except ValueError:  # a quotation that goes on in the next line
        return line.split()


@pytest.fixture(scope="module")
def help_of():
    """Return a function of a command, which returns the text of its help."""
    texts = {}

    def text(command, capsys):
        if command not in texts:
            with pytest.raises(SystemExit):
                main([*command, "--help"])
            texts[command] = capsys.readouterr().out
        return texts[command]

    return text


@pytest.mark.parametrize("page", NAMES)
def test_help_lists_the_options_of_every_command_of_the_page(page, help_of, capsys):
    for line in LINE.findall((ROOT / page).read_text()):
        first, *rest = words(line) or [""]
        if first in COMMANDS:
            command = (first, rest[0]) if rest and rest[0] in PARTS.get(first, ()) else (first,)
        else:
            assert not first or first.startswith("-") or first in PLACEHOLDERS or first.endswith(".py"), line
            command = ("run",)
        for option in (word.partition("=")[0] for word in [first, *rest] if word.startswith("--")):
            assert option in help_of(command, capsys), f"{line}: {option}"
