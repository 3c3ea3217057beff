"""The status line: its content, its width, and where it is not shown."""

import fcntl
import os
import pty
import re
import select
import shutil
import signal
import subprocess
import sys
import termios
from pathlib import Path

import pytest

from runtime.host.console.progress import Progress, rounds
from runtime.host.console.status_layout import compose, fit, part
from runtime.host.console.stderr import Terminal
from runtime.record.recorder.status import (
    WIDENING_DELAY,
    StatusLine,
    describe,
    rates,
    recording_part,
    strides_of,
    strides_part,
    temperature_part,
    torque_part,
)
from tests.runtime.record.recorder.running import plan
from tests.runtime.runs import KNEE_EXO, finished
from tests.runtime.terminals import WIDE, patient
from tests.runtime.terminals import Terminal as PseudoTerminal
from tests.soaking import soaked

ROOT = Path(__file__).parents[4]
STATISTICS = {
    "ticks": 1061,
    "last_tick": 1060,
    "missed": 0,
    "dropped": 0,
    "frames": {"sent": 4000, "received": 4000},
    "busy": 0.1,
    "lateness": {"count": 1061, "p50": 61e-6, "p99": 240e-6, "p99.9": 2e-3, "max": 3e-3},
}


def line(
    width=200,
    unicode=True,
    coloured=False,
    state="running",
    statistics=STATISTICS,
    speeds=(199.97, 0.031, 1600.0),
    **changed,
):
    settings = {"duration": 10.0, "virtual": False, "buses": ["legs"], **changed}
    return fit(describe(plan(None, **settings), state, statistics, speeds, unicode), width, coloured, unicode)[0]


def test_status_shows_state_progress_rate_lateness_load_and_frames():
    assert line() == (
        "running ━━━━╌╌╌╌ 5.3/10 s · 200.0 Hz · late 61/240 µs · load 3.1 % · 1600 frames/s · missed 0 · dropped 0"
    )


def test_status_shows_speed_in_virtual_time():
    assert line(virtual=True, speeds=(40_000.0, 0.9, 1e5)) == (
        "running ━━━━╌╌╌╌ 5.3/10 s · 200 times real time · 100000 frames/s · missed 0 · dropped 0"
    )


def test_the_status_line_omits_bar_and_traffic_without_duration_and_buses():
    assert line(duration=None, buses=[]) == (
        "running 5.3 s · 200.0 Hz · late 61/240 µs · load 3.1 % · missed 0 · dropped 0"
    )


@pytest.mark.parametrize("width", range(1, 140))
def test_status_line_fits_any_width_and_keeps_important_fields(width):
    text = line(width)
    assert len(text) <= width
    assert text.startswith("running"[:width])
    if width >= 30:
        assert "5.3/10 s" in text


def test_missed_ticks_remain_visible_on_a_narrow_terminal():
    text = line(40, statistics={**STATISTICS, "missed": 12})
    assert text == "running 5.3/10 s · 200.0 Hz · missed 12"


def test_a_terminal_without_unicode_gets_ascii():
    text = line(unicode=False)
    assert text.isascii() and "running ####.... 5.3/10 s | " in text and "late 61/240 us" in text


def test_colours_mark_problems_and_state():
    assert "\x1b[32mrunning\x1b[0m" in line(coloured=True) and "\x1b[31m" not in line(coloured=True)
    assert "\x1b[31mdropped 3\x1b[0m" in line(coloured=True, statistics={**STATISTICS, "dropped": 3})
    assert "\x1b" not in line()


EXOSKELETON = plan(None, duration=10.0, virtual=False, buses=["legs"], bitrates={"legs": 1e6})
TORQUES = [("left/knee", 2, 18.0, 4), ("right/knee", 3, 10.0, None)]


def exoskeleton(width, unicode=True, load=0.031, row=(7, 0.0, -9.1, 2.0, 0.55)):
    parts = describe(EXOSKELETON, "running", STATISTICS, (199.97, load, 800.0, 800.0, 0.21e6), unicode) + torque_part(
        TORQUES, row, unicode
    )
    return fit(parts, width, False, unicode)[0]


def test_the_page_shows_the_status_line_of_a_wide_and_of_a_narrow_terminal():
    hint = [
        part(8.9, "space stops"),
        part(1, "? lists the keys", "? keys"),
        recording_part({"folder": "", "stem": "exo"}),
    ]
    parts = describe(EXOSKELETON, "running", STATISTICS, (199.97, 0.031, 800.0, 800.0, 0.21e6), True, hint)
    row = (7, 0.0, -4.5, 1.0, 0.54, 41.3, float("nan"), 4.0, 5.0)
    parts += (
        strides_part([7, 8], row)
        + temperature_part([5, 6], row)
        + torque_part([("left/knee", 2, 9.0, 4), ("right/knee", 3, 9.0, 4)], row, True)
    )
    page = (ROOT / "docs" / "reference" / "running.md").read_text()
    shown = re.findall(r"^    (running .*)$", page, re.MULTILINE)
    assert shown == [fit(parts, width, False, True)[0] for width in (200, 79)]


@pytest.mark.parametrize(
    "width, unicode, expected",
    [
        (
            200,
            True,
            "running ━━━━╌╌╌╌ 5.3/10 s · 200.0 Hz · late 61/240 µs · load 3.1 % · legs 21 % full · missed 0 · "
            "dropped 0 · left/knee ━━╌╌  −9.1 N·m 32° · right/knee ━╌╌╌   2.0 N·m",
        ),
        (
            120,
            True,
            "running 5.3/10 s · 200.0 Hz · late 61/240 µs · load 3.1 % · legs 21 % full · lost 0 · left/knee −9.1, "
            "right/knee 2.0 N·m",
        ),
        (99, True, "running 5.3/10 s · 200.0 Hz · late 61/240 µs · load 3.1 % · legs 21 % · lost 0 · τ −9.1 2.0 N·m"),
        (79, True, "running 5.3/10 s · 200 Hz · late 61/240 µs · load 3 % · lost 0 · τ −9.1 2.0 N·m"),
        (60, True, "running 5.3/10 s  200.0 Hz  load 3 %  lost 0  τ −9.1 2.0 N·m"),
        (40, True, "running 5.3/10 s  200 Hz  τ −9.1 2.0 N·m"),
        (79, False, "running 5.3/10 s  200.0 Hz  late 61/240 us  load 3 %  lost 0  tau -9.1 2.0 N*m"),
    ],
)
def test_status_fits_80_columns_and_drops_least_important_first(width, unicode, expected):
    assert exoskeleton(width, unicode) == expected


def test_a_high_load_remains_visible_on_a_narrow_terminal():
    assert "load 91" in exoskeleton(50, load=0.91) and "load" not in exoskeleton(50)


def test_torque_and_the_key_that_stops_remain_at_45_columns_while_a_parameter_changes():
    keys = [part(8.9, "space stops"), part(8.5, "*/profile.scale 0.55"), part(4.5, "(0 to 1)", joined=True)]
    parts = describe(EXOSKELETON, "running", STATISTICS, (199.97, 0.031, 800.0, 800.0, 0.21e6), True, keys)
    shown = fit(parts + torque_part(TORQUES, (7, 0.0, -9.1, 2.0, 0.55), True), 60, False, True)[0]
    assert shown == "running  space stops  */profile.scale 0.55  τ −9.1 2.0 N·m"


def test_a_torque_that_is_not_a_number_is_marked():
    assert "τ ! 2.0 N·m" in exoskeleton(79, row=(7, 0.0, float("nan"), 2.0, 0.55))


def test_an_angle_or_torque_that_rounds_to_zero_has_no_sign():
    assert "╌╌╌╌   0.0 N·m 0° ·" in exoskeleton(200, row=(7, 0.0, -0.01, 2.0, -0.004))


def test_the_hottest_drive_is_shown_and_a_run_without_a_recording():
    assert temperature_part([2, 3, 4], (7, 0.0, 30.2, float("nan"), 41.7)[:]) == [part(5, "42 °C")]
    assert temperature_part([2], (7, 0.0, float("nan"))) == []
    assert recording_part({"folder": None, "stem": "exo_12"}).forms == ("not recorded",)


def test_strides_are_those_of_the_first_block_of_each_side():
    names = ("left/events.strides", "left/phase.strides", "right/events.strides", "own.stridesx", "trunk.strides")
    places = strides_of({"signals": [{"path": name} for name in names]})
    assert places == [2, 4, 6]
    assert strides_part(places, (0, 0.0, 12.0, 13.0, 11.0, 0.0, 12.0)) == [part(4.9, "strides 12/11/12")]
    assert strides_part([], (0, 0.0)) == []


class Sheet:
    """A terminal of so many columns, which keeps the newest line."""

    interactive, unicode, coloured, line = True, True, False, ""

    def draw(self, line):
        self.line = line

    def erase(self):
        self.line = ""


def test_the_status_line_keeps_its_form_for_three_seconds():
    """Ten times a second from one form to the other and back: that would flicker."""
    sheet, shared = Sheet(), Still()
    sheet.columns = 1 + len("running ━━━━━━━━ 9.9/10 s · not recorded · missed 0 · dropped 0")
    status = StatusLine(sheet, plan(None, status_line=True, virtual=False, duration=10.0, rate=200.0), shared)
    now = 0.0

    def drawn(tick):
        nonlocal now
        now += 0.1
        shared.told = {**STATISTICS, "last_tick": tick}
        status.history.clear()  # no rate
        status.update(now)
        return sheet.line

    long, short = (
        f"running {time} · not recorded · missed 0 · dropped 0" for time in ("━━━━━━━━ 9.9/10 s", "10.0/10 s")
    )
    assert drawn(1979) == long and drawn(1999) == short
    assert [drawn(1979) for _ in range(WIDENING_DELAY + 1)] == [short.replace("10.0/", "9.9/")] * (
        WIDENING_DELAY - 1
    ) + [long] * 2
    drawn(1999)
    sheet.columns += 20  # the person makes it wider: at once
    assert drawn(1979) == long


def test_the_answer_to_a_key_returns_to_a_narrow_status_line_as_soon_as_it_fits():
    """While a parameter ramps, its value and target together may be too long."""
    sheet, shared, panel = Sheet(), Still(), Still()
    sheet.columns, shared.told = 40, {**STATISTICS, "last_tick": 199}
    status = StatusLine(sheet, plan(None, status_line=True, virtual=False, duration=None, rate=200.0), shared, panel)
    lines = []
    for now, value in enumerate(("6 N·m", "6.05 N·m > 6.2 N·m", "6.2 N·m"), 1):
        panel.parts = lambda now, value=value: [part(8.5, f"profile.peak {value}")]
        status.history.clear()  # no rate
        status.update(float(now))
        lines.append(sheet.line)
    assert lines == ["running 1.0 s · profile.peak 6 N·m", "running 1.0 s", "running 1.0 s · profile.peak 6.2 N·m"]


@pytest.mark.parametrize(
    "unconfirmed, columns, shown",
    [
        ([], 80, "safe, stop confirmed · completing the files"),
        ([], 20, "safe"),
        (["left/knee"], 80, "NOT STOPPED, as far as known: left/knee · completing the files"),
        (["left/knee"], 20, "NOT STOPPED"),
    ],
)
def test_the_end_is_shown_while_the_files_are_completed(unconfirmed, columns, shown):
    sheet = Sheet()
    sheet.columns = columns
    limits = {"left/knee.torque": [-9.0, 9.0]}
    signals = [{"path": "left/knee.torque", "unit": "N·m"}]
    status = StatusLine(sheet, plan("here", status_line=True, limits=limits, signals=signals), Still())
    status.complete({"unconfirmed": unconfirmed})
    assert sheet.line == shown
    sheet.line = "as before"
    status.complete(None)
    assert sheet.line == "as before"


def test_milliseconds_of_lateness_are_shown_in_milliseconds():
    assert "late 0.06/1.24 ms" in line(
        statistics={**STATISTICS, "lateness": {**STATISTICS["lateness"], "p99": 1.24e-3}}
    )


def test_rates_are_taken_over_the_window():
    assert rates([(10.0, 100, 1.0, 50), (10.5, 200, 1.25, 450)]) == (200.0, 0.5, 800.0)
    assert rates([(10.0, 100, 1.0, 50)]) is None


def test_rates_of_arming_do_not_count_in_the_run():
    sheet, shared, recording = Sheet(), Still(), Heard([0], None, [0])
    sheet.columns = 200
    status = StatusLine(
        sheet,
        plan(None, status_line=True, virtual=False, rate=200.0, buses=["legs"], bitrates={"legs": 1e6}),
        shared,
        None,
        recording,
    )
    now = 0.0

    def drawn(state, bits):
        nonlocal now
        now += 0.1
        shared.state, recording.bits = state, [recording.bits[0] + bits]
        status.update(now)
        return sheet.line

    assert "legs 1 % full" in [drawn("arming", 1_000) for _ in range(5)][-1]
    assert "legs" not in drawn("running", 50_000)
    assert "legs 10 % full" in drawn("running", 10_000)


@pytest.fixture
def screen():
    """(what the recorder writes to, a function that reads what the person sees)"""
    master, slave = pty.openpty()

    def seen(until=None):
        """Until a pattern is there, else until nothing more comes."""
        data = b""
        while not (until and re.search(until, data.decode(errors="replace"))):
            if not select.select([master], [], [], 60.0 if until else 0.2)[0]:  # the kernel takes its time
                break
            data += os.read(master, 1 << 16)
        return data.decode(errors="replace")

    yield slave, seen
    os.close(master)
    os.close(slave)


def terminal(descriptor, **environment):
    return Terminal(descriptor, {"TERM": "xterm", "LANG": "C.UTF-8", **environment})


class Still:
    """Shared state that does not change."""

    state, told = "running", STATISTICS

    def statistics(self):
        return self.told


def test_status_line_refreshes_in_place_ten_times_per_second_and_is_erased(screen):
    slave, seen = screen
    status = StatusLine(terminal(slave), plan(None, status_line=True), Still())
    for millisecond in range(1000):
        status.update(5.0 + millisecond * 1e-3)
    drawn = seen()
    assert 10 <= drawn.count("\x1b[J\r") <= 11 and drawn.count("\r") == 2 * drawn.count("\x1b[J") and "\n" not in drawn
    status.erase()
    assert seen() == "\r\x1b[J"


def test_status_stays_readable_without_unicode(screen):
    terminal(screen[0], LANG="C").say("left/knee: −4.5 N·m for 61 µs")
    assert screen[1]() == "left/knee: -4.5 N*m for 61 us\r\n"


def test_a_permanent_line_replaces_the_status_line(screen):
    slave, seen = screen
    shown = terminal(slave)
    shown.draw("status")
    shown.say("a problem")
    assert seen() == "\r\x1b[?7lstatus\x1b[?7h\x1b[J\r\r\x1b[Ja problem\r\n"


@pytest.mark.parametrize(
    "environment, interactive, coloured",
    [
        ({}, True, True),
        ({"NO_COLOR": "1"}, True, False),
        ({"NO_COLOR": ""}, True, True),
        ({"TERM": "dumb"}, False, False),
    ],
)
def test_terminal_capabilities_follow_the_environment(screen, environment, interactive, coloured):
    shown = terminal(screen[0], **environment)
    assert (shown.interactive, shown.coloured) == (interactive, coloured)


def test_a_pipe_gets_no_status_line():
    reader, writer = os.pipe()
    status = StatusLine(terminal(writer), plan(None, status_line=True), Still())
    status.update(1.0)
    status.erase()
    os.close(writer)
    assert os.read(reader, 100) == b""
    os.close(reader)


def test_blocked_terminal_does_not_block_run():
    reader, writer = os.pipe()
    shown = terminal(writer)
    for _ in range(3000):
        shown.say("x" * 99)  # far more than a pipe holds
    assert 1000 < len(os.read(reader, 1 << 20)) <= 1 << 16
    os.close(reader)
    shown.say("nobody listens")  # a broken pipe
    os.close(writer)
    shown.say("nor is there anything to write to")


@pytest.mark.paced
@pytest.mark.parametrize("on_terminal", soaked([True, False], but=[0]))
def test_the_recorder_process_draws_on_a_terminal_and_is_silent_in_a_pipe(screen, tmp_path, on_terminal):
    slave, seen = screen
    fcntl.ioctl(slave, termios.TIOCSWINSZ, WIDE)  # a line with long numbers has no bar on a narrow one
    script = (
        "import sys; from tests.runtime.record.recorder.running import run, counting\n"
        "ticks = int(sys.argv[2])\n"
        "outcome, *_ = run(counting(), sys.argv[1], ticks, virtual=False, status_line=True, duration=ticks / 200.0)\n"
        "assert outcome.status == 'ok', outcome\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", script, str(tmp_path), "12000" if on_terminal else "600"],
        cwd=ROOT,
        stdin=subprocess.DEVNULL,
        stderr=slave if on_terminal else subprocess.PIPE,
        env={**os.environ, "TERM": "xterm", "LANG": "C.UTF-8", "LC_ALL": "C.UTF-8"},
    )
    if on_terminal:
        running = r"\r\x1b\[\?7l\x1b\[32mrunning\x1b\[0m [━╌]{8} \d+\.\d/60 s"
        drawn = seen(until=running)
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 0 and re.search(running, drawn), drawn
        assert seen().endswith("\r\x1b[J")
    else:
        assert process.communicate(timeout=60)[1] == b"" and process.returncode == 0


class Heard:
    """Latest counters and events of a recording."""

    def __init__(self, traffic, newest, bits=()):
        self.traffic, self.newest, self.bits = traffic, newest, bits


def test_each_torque_has_a_bar_of_its_limit(screen):
    slave, seen = screen
    units = {"left/knee.position": "rad", "left/knee.torque": "N·m", "right/knee.torque": "N·m"}
    signals = [{"path": path, "unit": unit} for path, unit in units.items()]
    limits = {"left/knee.torque": [-18.0, 18.0], "right/knee.torque": [-10.0, 10.0], "left/knee.position": [0.0, 2.0]}
    status = StatusLine(
        terminal(slave),
        plan(None, status_line=True, signals=signals, limits=limits),
        Still(),
        None,
        Heard([], (7, 0.0, 0.4, -9.1, 9.9)),
    )
    [part] = torque_part(status.torques, status.recording.newest, True)
    assert part.pieces(0)[::2] == [("left/knee ━━╌╌  −9.1 N·m 23°", None), ("right/knee ━━━━   9.9 N·m", "red")]
    assert part.pieces(2) == [("τ", None), (" ", None), ("−9.1", None), (" ", None), ("9.9", "red"), (" N·m", None)]
    [ascii_part] = torque_part(status.torques, (7, 0.0, 0.4, float("nan"), -5.0), False)
    assert (
        ascii_part.pieces(0)[::2] == [("left/knee !!!! ! N·m 23°", "red"), ("right/knee ##..  -5.0 N·m", None)]
        and "".join(text for text, _ in compose([ascii_part], [], False)).isascii()
    )
    assert "".join(text for text, _ in ascii_part.pieces(2)) == "tau ! -5.0 N·m"


def test_status_shows_bus_load_or_frame_rate(screen):
    fcntl.ioctl(screen[0], termios.TIOCSWINSZ, WIDE)
    heard = Heard([0, 0], None, [0, 0])
    order = plan(None, status_line=True, virtual=False, buses=["legs", "imus"], bitrates={"legs": 1e6})
    status = StatusLine(terminal(screen[0]), order, Still(), None, heard)
    status.update(5.0)
    heard.traffic, heard.bits = [160, 40], [18_000, 999]
    status.update(5.2)
    assert "legs 9 % full · imus 200 frames/s" in screen[1]()


def test_a_bus_that_is_nearly_full_is_red_and_in_virtual_time_its_time_counts():
    speeds = (2000.0, 0.9, 1e5, 1e5, 8.1e6)  # ten times real time
    assert "\x1b[31mlegs 81 % full\x1b[0m" in line(coloured=True, virtual=True, speeds=speeds, bitrates={"legs": 1e6})
    assert "\x1b[31m" not in line(coloured=True, virtual=True, speeds=(*speeds[:4], 7.9e6), bitrates={"legs": 1e6})


@pytest.mark.paced
def test_a_run_shows_the_torque_of_its_drives_and_how_full_its_bus_is(tmp_path):
    """2 drives at 200 Hz, a command of 8 bytes and an answer each: 800 frames a second of 111 bits, and up to 24
    stuffed ones.
    """
    with PseudoTerminal() as shown:
        shown.run(KNEE_EXO, "--duration", "20", "--no-record", cwd=tmp_path)
        full = int(shown.wait_for(r"running .* legs (\d+) % .* (?:τ −?[0-9.]+ −?[0-9.]+ N·m|left/knee)")[1])
        # the window is short, the machine may be busy
        assert 0.85 * 800 * 111 / 1e6 < 0.01 * full < 1.15 * 800 * 135 / 1e6
        shown.press(b" ")
        assert shown.end() == 0


@pytest.mark.soak
def test_replay_shows_progress_without_key_hints(tmp_path):
    done = finished(KNEE_EXO, "--fast", "--duration", "1800", "--record", "out", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    [recording] = (tmp_path / "out").glob("*.mcap")
    with PseudoTerminal() as shown:
        shown.run("replay", recording, cwd=tmp_path)
        shown.wait_for(r"(running|safe) [━╌]{8} \d+(\.\d)?/1800 s")
        assert not shown.takes_keys and shown.end(60) == 0
        assert "the same, bit for bit" in shown.look()


def test_long_task_shows_progress(screen):
    slave, seen = screen
    now = 0.0
    with Progress("converting walk.mcap", terminal(slave), lambda: now) as progress:
        half = progress.part(0.0, 0.5)
        for step in range(24):
            now = 0.125 * step
            half(step / 30)
    drawn = seen()
    assert "converting walk.mcap ━━━━━╌╌╌╌╌╌╌╌╌╌╌╌╌╌╌ 25 %, 6 s left" in drawn and drawn.endswith("\r\x1b[J")
    assert drawn.count("converting") == 16  # not in the first second


@pytest.mark.parametrize(
    "columns, expected",
    [
        (100, "converting walking_S03_2026-11-22.mcap ━━━━━━━━━━╌╌╌╌╌╌╌╌╌╌ 50 %, 6 s left"),
        (69, "converting walking_S03_2026-11-22.mcap ━━━━━╌╌╌╌╌ 50 %, 6 s left"),
        (45, "converting walk… ━━━━╌╌╌╌ 50 %, 6 s left"),
    ],
)
def test_progress_is_shown_for_names_of_any_length(columns, expected):
    sheet, now = Sheet(), 0.0
    sheet.columns = columns
    with Progress("converting walking_S03_2026-11-22.mcap", sheet, lambda: now) as progress:
        now = 6.0
        progress(0.5)
        assert sheet.line == expected and len(expected) < columns
    assert sheet.line == ""


def test_loop_shows_progress_and_clears_it_on_failure(screen, monkeypatch):
    monkeypatch.setattr("runtime.host.console.progress.Terminal", lambda: terminal(screen[0]))
    monkeypatch.setattr("runtime.host.console.progress.SHOW_DELAY", 0.0)
    with pytest.raises(ZeroDivisionError):
        for number in rounds("measuring", 4):
            1 / (2 - number)
    drawn = screen[1]()
    assert "measuring ╌╌╌╌╌╌╌╌╌╌╌╌╌╌╌╌╌╌╌╌ 0 %" in drawn and drawn.endswith("\r\x1b[J")


def test_progress_is_not_shown_in_a_pipe_or_for_short_tasks(screen):
    reader, writer = os.pipe()
    with Progress("converting", terminal(writer), iter(range(100)).__next__) as progress:
        progress(0.5)
    os.close(writer)
    assert os.read(reader, 100) == b""
    os.close(reader)
    with Progress("converting", terminal(screen[0])) as progress:
        progress(0.5)
    assert screen[1]() == ""


@pytest.mark.skipif(shutil.which("tmux") is None, reason="needs tmux")
def test_a_narrower_window_keeps_nothing_of_the_line(tmp_path):
    """A terminal breaks a line for which it has become too narrow."""
    program = (
        "import time; from runtime.host.console.stderr import Terminal; shown = Terminal(); print('above')\n"
        "for second in range(200): shown.draw(f'status {second} '.ljust(shown.columns - 1, '=')); time.sleep(0.05)"
    )
    environment = {**os.environ, "TERM": "xterm-256color", "PYTHONPATH": str(ROOT), "TMUX_TMPDIR": str(tmp_path)}

    def tmux(*words):
        command = ["tmux", "-f", "/dev/null", "-L", "narrow", *words]
        return subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout

    tmux("new-session", "-d", "-x", "120", "-y", "20", "-s", "window", sys.executable, "-c", program)
    try:
        for width in (120, 70):  # tmux itself moves the cursor of a line that it breaks twice
            tmux("resize-window", "-t", "window", "-x", f"{width}")
            shown = patient(lambda width=width: _lines_of(tmux, width))
            assert shown == ["above", shown[-1]] and shown[-1].startswith("status"), shown
    finally:
        tmux("kill-server")


def _lines_of(tmux, width):
    """The lines of a window and of what has left it, once the last of them has its width; else None."""
    lines = tmux("capture-pane", "-p", "-S", "-50", "-t", "window").split("\n")
    lines = [line for line in lines if line.strip()]
    return lines if lines and len(lines[-1]) == width - 1 else None
