"""Messages reach the reader on any terminal or file encoding."""

import io
import os
import pty
import select
import tty

import pytest

from runtime.host.console.status_layout import COLOURS, RESET
from runtime.host.console.stderr import Terminal
from runtime.host.console.styles import Console
from runtime.host.console.terminal import harmless, one_line, print_lines, print_to_stderr, write

LINE = "late by 61 µs at −4.5 N·m, 30° … ━╌ 漢"


@pytest.mark.parametrize(
    "encoding, expected",
    [
        ("utf-8", LINE),
        ("ascii", "late by 61 us at -4.5 N*m, 30 deg ... #. ?"),
        ("latin-1", "late by 61 µs at -4.5 N·m, 30° ... #. ?"),
    ],
)
def test_units_stay_readable_in_an_encoding_without_them(encoding, expected):
    file = io.TextIOWrapper(io.BytesIO(), encoding)
    write([LINE], file)
    assert file.buffer.getvalue().decode(encoding) == expected + "\n"


NASTY = "knee\x1b]0;title\x07 \x1b[2J\x1b[8m \x9b31m \x7f\r \u202e end\tµ\n"
SHOWN = "knee\\x1b]0;title\\x07 \\x1b[2J\\x1b[8m \\x9b31m \\x7f\\r \\u202e end\tµ\n"


def test_control_characters_are_escaped_and_styles_kept():
    assert harmless(NASTY, True) == harmless(NASTY, False) == SHOWN
    styled = Console(80, True)
    ours = " ".join(
        (
            styled.bold("a"),
            styled.faint("b"),
            styled.ok("c"),
            styled.error("d"),
            styled.warn("e"),
            *COLOURS.values(),
            RESET,
        )
    )
    assert harmless(ours, True) == ours
    assert "\x1b" not in harmless(ours, False)


def test_no_line_for_a_pipe_holds_a_control_character(capsys):
    print_lines([NASTY])
    print_to_stderr([NASTY])
    out, err = capsys.readouterr()
    assert out == err == SHOWN + "\n"


def test_neither_a_status_line_nor_a_line_that_stays_holds_one():
    master, slave = pty.openpty()
    tty.setraw(slave)
    shown = Terminal(slave, {"TERM": "xterm", "LANG": "C.UTF-8"})
    shown.draw(f"\x1b[32mrunning\x1b[0m {NASTY[:-1]}")
    shown.say(NASTY[:-1])
    drawn = f"\r\x1b[?7l\x1b[32mrunning\x1b[0m {SHOWN[:-1]}\x1b[?7h\x1b[J\r"
    expected, seen = f"{drawn}\r\x1b[J{SHOWN[:-1]}\n".encode(), b""
    # a terminal may pass on what it has got in pieces
    while len(seen) < len(expected) and select.select([master], [], [], 2.0)[0]:
        seen += os.read(master, 4096)
    os.close(master)
    os.close(slave)
    assert seen == expected


def test_a_line_break_in_a_name_cannot_start_another_line():
    assert one_line("left/knee\nFAULT at right/knee\t\x1b[31m") == "left/knee\\nFAULT at right/knee\\t\\x1b[31m"
