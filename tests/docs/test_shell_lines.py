"""Shell lines of the documentation: the shell can parse each, and each names what exists.

A line that sets a computer up is one that the program itself prints or writes, by `doctor`, its script or an error.
"""

import re
import shlex
import shutil
import subprocess

import pytest

from tests.checkout import ROOT
from tests.docs.shell_lines import shell_lines
from tests.test_packaging import PYPROJECT

EXTRAS = PYPROJECT["project"]["optional-dependencies"]
TARGETS = set(re.search(r"^\.PHONY: (.*)", (ROOT / "Makefile").read_text(), re.MULTILINE)[1].split())
SOURCES = "\n".join(path.read_text() for room in ("runtime", "blocks") for path in (ROOT / room).rglob("*.py"))
PLAIN = re.sub(r"\s+", " ", re.sub(r"[\"',]", " ", SOURCES))  # words of a list of arguments follow each other, too
# Lines that set a computer up and that the program does not print: why.
READERS_CHOICE = {
    "sudo setcap": "realtime.md advises against it",
    "sudo raspi-config nonint do_wifi_country": "the reader's country",
    "sudo apt install git make gcc": "before anything of the program is there; the Makefile prints what is missing",
    "sudo apt install gcc python3-dev": "to compile from source without make",
    "sudo apt install qemu-user": "for wheels of another processor",
    "sudo apt install clang-19": "for `make soak` and `make sanitize`",
    "sudo apt install libfaketime": "for the ten minutes with LabRecorder in `make soak`",
    "sudo systemctl enable --now knee": "the reader's service, start_at_boot.md",
    "sudo chgrp lab": "the reader's recordings",
    "sudo sh fix.sh": "runs the script",
}
SET_UP = sorted({line for _, line in shell_lines() if line.startswith("sudo ")})


def test_shell_lines_are_found():
    assert len(shell_lines()) > 80 and len(SET_UP) > 15


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def test_the_shell_can_parse_every_line():
    for page, line in shell_lines():
        text = re.sub(r"<(\w[\w ]*)>", r"\1", line)  # `<your fork>`
        done = subprocess.run(["bash", "-n", "-c", text], capture_output=True, text=True)
        assert not done.returncode, (page, line, done.stderr)


def test_every_target_of_make_exists():
    for page, line in shell_lines():
        for words in re.findall(r"(?:^|&& )make ([^&;]*)", line):
            target = shlex.split(words)[0]
            assert target in TARGETS, (page, line)


def test_every_extra_of_pip_exists():
    named = [(page, name) for page, line in shell_lines() for name in re.findall(r"(?:tickwork|\.)\[([\w,]+)\]", line)]
    assert len(named) > 10
    for page, names in named:
        assert set(names.split(",")) <= EXTRAS.keys(), (page, names)


def prints(line):
    """Return whether the program's text contains each command of a line, with any name in place of its own."""
    for command in re.split(r" && ", line.removesuffix(" && log out")):
        words = [r"\S+" if re.fullmatch(r"v?can\d|\d{2,}|\$\w+", word) else re.escape(word) for word in command.split()]
        if not re.search(r"\s".join(words), PLAIN) and not re.search(r"\s".join(words[words[0] == "sudo" :]), PLAIN):
            return False
    return True


@pytest.mark.parametrize("line", SET_UP)
def test_a_line_that_sets_a_computer_up_is_one_that_the_program_prints(line):
    assert line.startswith(tuple(READERS_CHOICE)) or prints(line)


def test_no_exception_is_left_over():
    for start in READERS_CHOICE:
        assert any(line.startswith(start) and not prints(line) for line in SET_UP), start


@pytest.mark.skipif(shutil.which("ip") is None, reason="needs iproute2")
def test_the_words_of_ip_for_can_are_those_of_its_help():
    usage = "".join(
        done.stdout + done.stderr
        for done in (
            subprocess.run(["ip", *words, "help"], capture_output=True, text=True, stdin=subprocess.DEVNULL)
            for words in (["link"], ["address"], ["link", "add", "type", "can"])
        )
    )
    known = set(re.findall(r"[a-z][a-z-]+", usage))
    for page, line in shell_lines():
        for words in re.findall(r"\bip (?:-details )?((?:link|address) [^&`]*)", line):
            options = [word for word in words.split() if not re.search(r"\d", word)]
            assert set(options) <= known | {"link", "address"}, (page, words)
