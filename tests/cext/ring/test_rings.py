"""Lines: buses that another process owns, frame by frame through shared memory."""

import errno
import os
import subprocess
import sys

import pytest

from cext.ring.rings import Line, Lines

STANDARD, EXTENDED = 0x123, 0x80000456
ROOM = 512


@pytest.fixture
def lines():
    return Lines(2)


def test_frames_pass_ring_in_order(lines):
    line = Line(lines, 1)
    line.begin(1_000)
    for number in range(3):
        assert line.end.send(STANDARD, bytes([number]))
    assert line.end.send(0x456, b"", extended=True)
    assert lines.take(1) == [(STANDARD, b"\0", 0), (STANDARD, b"\1", 0), (STANDARD, b"\2", 0), (EXTENDED, b"", 0)]
    assert lines.take(1) == [] and lines.take(0) == []
    lines.give(1, EXTENDED, bytes(range(64)), 5_000, 4)
    lines.give(1, STANDARD, b"abc", 6_000)
    assert line.end.receive() == [(0x456, True, bytes(range(64)), 4_000), (STANDARD, False, b"abc", 5_000)]
    assert Line(lines, 0).end.receive() == []


def test_rings_wrap_around_repeatedly(lines):
    line = Line(lines, 0)
    for start in range(0, 10 * ROOM, 100):
        for number in range(start, start + 100):
            lines.give(0, number, number.to_bytes(8, "little"), number)
        assert line.end.receive() == [
            (number, False, number.to_bytes(8, "little"), number) for number in range(start, start + 100)
        ]


def test_full_ring_refuses_frames_and_fails_if_not_drained(lines):
    line = Line(lines, 0)
    assert all(line.end.send(STANDARD, b"") for _ in range(ROOM))
    assert not any(line.end.send(STANDARD, b"") for _ in range(10)) and line.trouble == "full"
    assert line.counts["refused"] == 10
    assert len(lines.take(0)) == ROOM
    assert not line.end.send(STANDARD, b"") and line.counts["refused"] == 10  # told once
    assert line.end.send(STANDARD, b"")  # the safe stop goes on trying


def test_dropped_return_frames_are_counted(lines):
    line = Line(lines, 0)
    for number in range(ROOM + 3):
        lines.give(0, number, b"", number)
    assert [frame[0] for frame in line.end.receive(ROOM + 3)] == list(range(ROOM))
    assert line.counts["overflows"] == 3


def test_failed_bus_keeps_its_reason_until_next_run(lines):
    line = Line(lines, 0)
    lines.fail(0, errno.ENODEV)
    assert not line.end.send(STANDARD, b"") and line.trouble == errno.ENODEV
    assert line.end.send(STANDARD, b"")
    for kind in ("refused", "echoes", "corrupt", "errors", "withheld"):
        lines.count_up(0, kind, 2)
    assert line.counts == {"refused": 2, "echoes": 2, "corrupt": 2, "errors": 2, "overflows": 0, "withheld": 2}


def test_run_discards_earlier_frames(lines):
    line = Line(lines, 0)
    lines.give(0, STANDARD, b"old", 1)
    line.begin(0)
    lines.give(0, STANDARD, b"new", 2)
    assert line.end.receive() == [(STANDARD, False, b"new", 2)]


def test_frame_received_before_run_start_has_time_zero(lines):
    line = Line(lines, 0)
    line.begin(1_000)
    lines.give(0, STANDARD, b"early", 400)
    assert line.end.receive() == [(STANDARD, False, b"early", 0)]


def test_each_send_signals_the_eventfd(lines):
    bell = os.eventfd(0, os.EFD_NONBLOCK)
    line = Line(lines, 0, bell)
    line.end.send(STANDARD, b"1")
    line.end.send(STANDARD, b"2")
    assert os.eventfd_read(bell) == 2
    line.end.receive()
    with pytest.raises(BlockingIOError):
        os.eventfd_read(bell)
    os.close(bell)


def test_two_processes_share_the_lines(lines):
    line = Line(lines, 1)
    for number in range(300):
        line.end.send(number, bytes(8))
    owner = (
        "import sys; from cext.ring.rings import Lines; lines = Lines(fd=int(sys.argv[1]))\n"
        "for identifier, data, _ in lines.take(1): lines.give(1, identifier + 1, data, 7)"
    )
    subprocess.run([sys.executable, "-c", owner, str(lines.fd)], pass_fds=[lines.fd], check=True, timeout=30)
    assert [frame[0] for frame in line.end.receive()] == list(range(1, 301))


def test_invalid_arguments_are_refused(lines, tmp_path):
    for wrong in (-1, 2):
        with pytest.raises(IndexError):
            lines.take(wrong)
        with pytest.raises(IndexError):
            Line(lines, wrong)
    with pytest.raises(ValueError, match="at most 64 bytes"):
        lines.give(0, 1, bytes(65), 0)
    with pytest.raises(KeyError):
        lines.count_up(0, "others")
    with open(tmp_path / "page", "w+b") as file:
        file.write(bytes(1000))
        file.flush()
        with pytest.raises(ValueError, match="has no rings"):
            Lines(fd=file.fileno())
