"""The keys on the run's terminal: real terminals, real processes, and recordings of the keys pressed."""

import os
import signal
import termios

import numpy as np
import psutil
import pytest

from runtime.host.console.keys import KEY, key_name
from runtime.host.console.status_layout import fit, part
from runtime.host.live.running import shared_state_of
from runtime.host.live.table import Parameter, nice
from runtime.record.analysis.trial import Trial
from runtime.record.recorder.status import describe
from tests.runtime.record.recorder.running import plan
from tests.runtime.record.recorder.test_status import STATISTICS
from tests.runtime.runs import Files, finished, writer_of
from tests.runtime.terminals import Terminal, live_diagram, patient

UP, DOWN, RIGHT, LEFT, TAB, SHIFT_TAB = b"\x1b[A", b"\x1b[B", b"\x1b[C", b"\x1b[D", b"\t", b"\x1b[Z"


@pytest.fixture
def terminal():
    with Terminal() as found:
        yield found


def recorder_of(terminal):
    """The process that writes the recording, once it records."""
    return psutil.Process(patient(lambda: writer_of(terminal.process.pid)))


def around(table, header, tick):
    """A column's values in the row before a tick, and in its own."""
    row = list(table["tick"]).index(tick)
    return tuple(table[header][row - 1 : row + 1])


def test_keys_change_mark_save_and_stop_and_the_recording_has_each_with_its_tick(tmp_path, terminal):
    live_diagram(tmp_path)
    terminal.run("springs.py", "--duration", "60", cwd=tmp_path)
    terminal.wait_for(r"running .* \? lists the keys")
    assert terminal.takes_keys and not terminal.attributes[3] & termios.ECHO and terminal.attributes[3] & termios.ISIG
    terminal.press(UP)
    terminal.wait_for("select a parameter first with Tab")
    terminal.press(TAB)
    terminal.wait_for(r"spring\.stiffness 30 N·m/rad \(0 to 150 N·m/rad\)")
    terminal.press(b"\r")
    terminal.wait_for("up and down change it")
    terminal.press(UP + UP + RIGHT)
    terminal.wait_for(r"spring\.stiffness 40\.5 N·m/rad ")
    terminal.press(b"m")
    terminal.wait_for(r"mark 1 at tick \d+")
    terminal.press(SHIFT_TAB + DOWN)
    terminal.wait_for(r"wave\.on false \(false or true\)")
    terminal.press(SHIFT_TAB + UP + b"?")
    terminal.wait_for(r"tickwork: space: stop; Tab, .*\r\n")
    terminal.press(b"s")
    saved = terminal.wait_for(r"tickwork: saved (recordings/springs_\S+\.set); --set @")[1]
    terminal.press(TAB + TAB + b"0")
    terminal.wait_for(r"spring\.stiffness 30 N·m/rad")
    terminal.press(b" ")
    assert terminal.end() == 0 and terminal.attributes == terminal.before
    shown = terminal.look().replace("\x1b[J", "")
    assert "\rstopped by the space bar\r\n" in shown
    assert "6 changes of live parameters, 1 mark" in shown

    files = Files(tmp_path / "recordings")
    sidecar, table = files.sidecar, files.table
    assert sidecar["ended"] == "stopped by the space bar" and sidecar["events_left_out"] == 0
    told = [(event["event"], event.get("path", event.get("number")), event.get("value")) for event in sidecar["events"]]
    assert told == [
        ("set", "spring.stiffness", 35.0),
        ("set", "spring.stiffness", 40.0),
        ("set", "spring.stiffness", 40.5),
        ("mark", 1, None),
        ("set", "wave.on", False),
        ("set", "wave.count", 4),
        ("set", "spring.stiffness", 30.0),
        ("stop", None, None),
    ]
    assert {event["by"] for event in sidecar["events"]} == {"keys"}
    up, off, count, back, stop = (sidecar["events"][index] for index in (0, 4, 5, 6, 7))
    assert up["slew"] == 200.0 and "slew" not in off and back["from"] == 40.5
    stiffness, wave = "spring.torque [N*m]", "wave.y"
    row = list(table["tick"]).index(up["tick"])
    passed = table["tick"][row : row + 5] - table["tick"][row - 1]
    np.testing.assert_allclose(table[stiffness][row : row + 5], -30.0 - passed, rtol=0, atol=1e-9)  # 1 N·m/rad a tick
    before, after = around(table, stiffness, back["tick"])
    assert table[stiffness][row - 1] == -30.0 and before == -40.5 < after
    assert around(table, wave, off["tick"]) == (1030.5, 30.5) and around(table, wave, count["tick"]) == (30.5, 40.5)
    assert table["tick"][-1] < stop["tick"] == sidecar["end"]["tick"]  # ticks before the stop may have been missed
    assert saved in [file["path"] for file in sidecar["files"]]
    trial = Trial(files.one(".mcap"))
    assert [event for event in trial.events if event["event"] in ("set", "mark", "stop")] == sidecar["events"]
    assert trial.end["end"] == sidecar["end"]

    again = finished(
        "springs.py", "--duration", "0.05", "--fast", "--record", "again", "--set", f"@{saved}", cwd=tmp_path
    )
    assert again.returncode == 0, again.stderr
    table = Files(tmp_path / "again").table
    assert set(table[stiffness]) == {-40.5} and set(table[wave]) == {40.5}


def test_ctrl_c_still_interrupts_and_the_terminal_is_as_it_was(tmp_path, terminal):
    live_diagram(tmp_path)
    terminal.run("springs.py", "--no-record", cwd=tmp_path)
    terminal.wait_for("lists the keys")
    terminal.press(b"\x03")
    assert terminal.end() == 130 and terminal.attributes == terminal.before


def test_in_virtual_time_the_space_bar_stops_the_run(tmp_path, terminal):
    live_diagram(tmp_path)
    terminal.run("springs.py", "--fast", "--duration", "1000000", "--no-record", cwd=tmp_path)
    terminal.wait_for("times real time")
    patient(lambda: terminal.takes_keys)
    terminal.press(TAB + UP)
    terminal.wait_for(r"spring\.stiffness 35")
    terminal.press(b" ")
    assert terminal.end() == 0 and terminal.attributes == terminal.before
    assert "stopped by the space bar" in terminal.look() and "1 change of live" in terminal.look()


@pytest.mark.parametrize(
    "victim",
    ["control", pytest.param("recorder", marks=pytest.mark.soak), pytest.param("both", marks=pytest.mark.soak)],
)
def test_after_kill_9_of_either_process_or_both_the_terminal_is_as_it_was(tmp_path, terminal, victim):
    live_diagram(tmp_path)
    terminal.run("springs.py", "--no-record", cwd=tmp_path)
    terminal.wait_for("lists the keys")
    recorder = recorder_of(terminal)
    assert terminal.takes_keys
    if victim == "recorder":
        recorder.kill()
        patient(lambda: not recorder.is_running() or recorder.status() == psutil.STATUS_ZOMBIE)
        terminal.process.send_signal(signal.SIGINT)
    elif victim == "both":
        recorder.kill()
        terminal.process.kill()
    else:
        terminal.process.kill()
    terminal.process.wait(20)
    patient(lambda: terminal.attributes == terminal.before)
    patient(lambda: not psutil.pid_exists(recorder.pid))


# What a shell with job control does: the run is a job of its own that is given the terminal, and loses it again.
SHELL = """
import os, signal, subprocess, sys
signal.signal(signal.SIGTTOU, signal.SIG_IGN)
job = subprocess.Popen([sys.executable, "-m", "runtime", *sys.argv[2:]], preexec_fn=os.setpgrp)
for line in os.fdopen(int(sys.argv[1])):
    if line == "foreground\\n":
        os.tcsetpgrp(0, job.pid)
    elif line == "background\\n":
        os.tcsetpgrp(0, os.getpgrp())
    else:
        os.killpg(job.pid, signal.SIGINT)
        break
sys.exit(job.wait())
"""


@pytest.mark.soak
def test_a_background_run_reads_no_keys(tmp_path, terminal):
    live_diagram(tmp_path)
    orders, write_orders = os.pipe()

    def say(order):
        os.write(write_orders, order + b"\n")

    terminal.start("-c", SHELL, str(orders), "springs.py", "--no-record", cwd=tmp_path, pass_fds=(orders,))
    job = patient(lambda: psutil.Process(terminal.process.pid).children())[0]
    shared = patient(lambda: shared_state_of(job.pid))
    patient(lambda: shared.statistics()["ticks"] > 50)
    assert not terminal.takes_keys and terminal.look() == ""
    say(b"foreground")
    patient(lambda: terminal.takes_keys)
    terminal.press(TAB)
    terminal.wait_for(r"spring\.stiffness 30")
    say(b"background")
    patient(lambda: terminal.attributes == terminal.before)
    terminal.press(b" \n")  # for the shell, which has not read it when the run comes back
    ticks = shared.statistics()["ticks"]
    patient(lambda: shared.statistics()["ticks"] > ticks + 20)
    say(b"foreground")
    patient(lambda: terminal.takes_keys)
    terminal.press(TAB)
    terminal.wait_for(r"spring\.damping 1 ")
    say(b"end")
    assert terminal.end() == 130 and terminal.attributes == terminal.before
    os.close(orders)
    os.close(write_orders)


@pytest.mark.parametrize("missing", ["stdin", "stdout"])
def test_without_a_terminal_at_both_ends_no_keys_are_taken(tmp_path, terminal, missing):
    live_diagram(tmp_path)
    with open(os.devnull, "r+") as nowhere:
        terminal.run("springs.py", "--no-record", cwd=tmp_path, **{missing: nowhere})
        terminal.wait_for(r"running .*Hz")
        assert terminal.attributes == terminal.before and "lists the keys" not in terminal.look()
        terminal.press(b"\x03")
        assert terminal.end() == 130


def parameter(low, high, dtype="float", unit="1", built=None):
    return Parameter(0, "a.b", dtype, unit, "", low if built is None else built, low, high, float("inf"))


def test_key_steps_are_round_numbers_and_stop_at_the_bounds():
    stiffness = parameter(0.0, 150.0)
    up = [30.0]
    for _ in range(3):
        up.append(stiffness.next_step(up[-1], 10))
    assert (
        up == [30.0, 35.0, 40.0, 45.0]
        and stiffness.next_step(41.7, 10) == 45.0
        and stiffness.next_step(41.7, -10) == 40.0
    )
    assert stiffness.next_step(30.0, 1) == 30.5 and stiffness.next_step(30.0, -1) == 29.5
    assert (
        stiffness.next_step(149.0, 10) == 150.0
        and stiffness.next_step(150.0, 10) == 150.0
        and stiffness.next_step(3.0, -10) == 0.0
    )
    share = parameter(0.0, 1.0)
    values = [0.0]
    for _ in range(20):
        values.append(share.next_step(values[-1], 10))
    assert values == [round(0.05 * number, 2) for number in range(21)], "no 0.15000000000000002"
    assert parameter(-0.3, 0.4).next_step(0.0, -1) == -0.002 and parameter(0.0, 0.0).next_step(0.0, 10) == 0.0
    assert parameter(0, 12, "int").next_step(3.0, 10) == 4.0 and parameter(0, 100, "int").next_step(50.0, 1) == 51.0
    assert (
        parameter(False, True, "bool").next_step(0.0, 1) == 1.0
        and parameter(False, True, "bool").next_step(1.0, -10) == 0.0
    )
    assert [nice(number) for number in (7.5, 0.5, 1e-3, 0.05, 20.0, 1.99)] == [5.0, 0.5, 1e-3, 0.05, 20.0, 1.0]


def test_values_are_shown_with_their_unit_and_written_exactly():
    assert (
        parameter(0.0, 1.0, unit="rad").value_text(0.1 + 0.2) == "0.3 rad"
        and parameter(0.0, 1.0).setting_text(0.1 + 0.2) == "0.30000000000000004"
    )
    assert parameter(0, 9, "int").setting_text(3.0) == "3" and parameter(0, 1, "bool").setting_text(1.0) == "true"


def test_sequences_of_bytes_are_keys_however_a_terminal_writes_them():
    data = b" mA\x1b[A\x1bOB\x1b[1;2C\x1b[D\t\x1b[Z\x1b[5~\x1bx0\xc3"
    assert [key_name(match[0]) for match in KEY.finditer(data)] == [
        "space",
        "m",
        "A",
        "up",
        "down",
        "right",
        "left",
        "tab",
        "shift tab",
        "",
        "\x1bx",
        "0",
        "\ufffd",
    ]
    assert KEY.match(b"\x1b") is None and KEY.match(b"\x1b[1;") is None, "not yet whole"


def test_the_selected_parameter_remains_visible_on_a_narrow_terminal():
    chosen = [part(8.5, "spring.stiffness 30 N·m/rad"), part(4.5, "(0 to 150 N·m/rad)", joined=True)]
    settings = plan(None, duration=10.0, virtual=False, buses=["legs"])
    parts = describe(settings, "running", STATISTICS, (200.0, 0.03, 1600.0), True, chosen)
    wide, narrow = fit(parts, 160, False, True)[0], fit(parts, 60, False, True)[0]
    assert "5.3/10 s · spring.stiffness 30 N·m/rad (0 to 150 N·m/rad) · 200.0 Hz" in wide
    assert narrow == "running 5.3/10 s · spring.stiffness 30 N·m/rad · 200.0 Hz"
