"""Text on a terminal and in a pipe."""

from runtime.host.console.styles import Console, count, length


def test_long_text_has_hanging_indent():
    lines = Console(width=40).hang("  name  ", "one two three four five six seven eight nine ten")
    assert lines == ["  name  one two three four five six", "        seven eight nine ten"]


def test_hanging_indent_can_be_set():
    lines = Console(width=30).hang("name: ", "one two three four five six seven eight", indent=2)
    assert lines == ["name: one two three four five", "  six seven eight"]


def test_text_moves_to_next_line_if_space_is_short():
    lines = Console(width=40).hang("  a head that takes most of the line  ", "one two three four five six seven")
    assert lines == ["  a head that takes most of the line", "        one two three four five six", "        seven"]


def test_in_a_pipe_nothing_is_wrapped_or_cut_or_coloured():
    pipe = Console()
    assert (
        pipe.hang("a ", "b " * 500) == ["a " + "b " * 500]
        and pipe.cut("x" * 500) == "x" * 500
        and pipe.error("x") == "x"
    )


def test_colour_codes_have_no_width():
    screen = Console(width=30, colour=True)
    assert length(screen.bold("name")) == 4
    lines = screen.hang(screen.bold("name") + "  ", "one two three four five six", screen.faint)
    assert lines == ["\x1b[1mname\x1b[0m  \x1b[2mone two three four five\x1b[0m", "      \x1b[2msix\x1b[0m"]


def test_a_path_without_a_blank_is_not_broken():
    assert Console(width=20).hang("", "a left/very/long/path/that/is/wide b") == [
        "a",
        "left/very/long/path/that/is/wide",
        "b",
    ]


def test_an_empty_text_keeps_the_heading():
    assert Console(width=4).hang("long head", "") == ["long head"]


def test_overlong_text_is_truncated():
    assert Console(width=8).cut("abcdefghij") == "abcdefg…" and Console(width=10).cut("abcdefghij") == "abcdefghij"


def test_counts_have_singular_and_plural():
    assert count(1, "block") == "1 block" and count(2, "block") == "2 blocks" and count(0, "error") == "0 errors"


def test_a_line_wider_than_the_terminal_is_wrapped_below_its_second_column():
    console = Console(40)
    assert console.fold("  safe stop   zero torque, then disable: confirmed by left/knee") == [
        "  safe stop   zero torque, then disable:",
        "              confirmed by left/knee",
    ]
    assert console.fold(" " * 14 + "out/knee_12.mcap  (779 ticks of 46 signals)") == [
        " " * 14 + "out/knee_12.mcap  (779",
        " " * 14 + "ticks of 46 signals)",
    ]
    assert console.fold("FAULT at knee, tick 148 (0.74 s): it is outside") == [
        "FAULT at knee, tick 148 (0.74 s): it",
        "    is outside",
    ]
    assert console.fold("  short") == ["  short"] and Console().fold("x " * 99) == ["x " * 99]
