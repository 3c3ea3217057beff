"""Runs with real processes and the real clock: what is recorded, streamed and sent, however the run ends."""

import os
import pty
import re
import select
import signal
import sys

import numpy as np
import psutil
import pytest

from tests.runtime.runs import (
    DISABLE,
    ENABLE,
    KNEE_EXO,
    NOTHING,
    TORQUE_STEP,
    Files,
    Listener,
    assert_safely_stopped,
    environment,
    finished,
    knee,
    line_of,
    stamps,
    started,
    torque_of,
)
from tests.soaking import soaked

RATE = 200.0
SIDES = {"left": 1, "right": 2}


@pytest.fixture(scope="module")
def walked(tmp_path_factory):
    """The knee exoskeleton for 2 s by the clock: (process, files, datagrams, or None if the system dropped some)."""
    folder = tmp_path_factory.mktemp("walked")
    with Listener() as listener:
        process = finished(KNEE_EXO, "--duration", "2", "--plotjuggler", listener.address, cwd=folder)
        datagrams = listener.rest()
        return process, Files(folder / "recordings"), None if listener.dropped else datagrams


def test_every_grid_point_is_a_row_or_missed(walked):
    process, files, _ = walked
    assert process.returncode == 0, process.stderr
    sidecar = files.sidecar
    assert sidecar["ended"] == "ok" and sidecar["dropped"] == 0
    assert len(files.table["tick"]) + sidecar["missed"] == 400
    assert sidecar["ticks"] == len(files.table["tick"])
    assert f"{sidecar['ticks']} of 400 done, {sidecar['missed']} missed; 0 records dropped" in process.stdout


def test_ticks_increase_and_times_match_them(walked):
    table = walked[1].table
    assert np.all(np.diff(table["tick"]) >= 1) and 0 <= table["tick"][0] < table["tick"][-1] <= 399
    np.testing.assert_array_equal(table["time [s]"], table["tick"] / RATE)


def test_columns_have_headings(walked):
    header = walked[1].header
    assert header[:2] == ["time [s]", "tick"]
    for side in SIDES:
        for name in (
            "knee.position [rad]",
            "knee.velocity [rad/s]",
            "knee.torque [N*m]",
            "knee.temperature [degC]",
            "knee.age [s]",
            "knee.fault",
            "torque_limiter.limited [N*m]",
            "gait_phase.phase",
            "butterworth.y [rad/s]",
            "profile.torque [N*m]",
            "knee.torque_sent [N*m]",
        ):
            assert f"{side}/{name}" in header
    assert len(header) == len(set(header)) and ",".join(header).isascii()


def test_every_datagram_arrives_in_order_and_holds_the_rows_numbers(walked):
    _, files, datagrams = walked
    if datagrams is None:
        pytest.skip("the system has dropped datagrams: this machine was too busy to take them")
    table = files.table
    assert stamps(datagrams) == pytest.approx(table["time [s]"] - table["time [s]"][0], abs=1e-6)
    for side in SIDES:
        for port, column in (("position", "position [rad]"), ("torque_sent", "torque_sent [N*m]"), ("fault", "fault")):
            assert [datagram[side]["knee"][port] for datagram in datagrams] == list(table[f"{side}/knee.{column}"])


def test_every_frame_is_logged_and_bounded_by_the_limiter(walked):
    """One command a tick and drive, as the rows have it; enable and zero torque before, zero torque and disable
    after.
    """
    _, files, _ = walked
    table = files.table
    assert_safely_stopped(files, SIDES.values())
    for side, can_id in SIDES.items():
        sent = files.sent(can_id)
        commands = np.array([torque_of(data) for data in sent[2 : sent.index(DISABLE) - 1]])
        assert ENABLE not in sent[2:]
        assert len(commands) == len(table["tick"])
        assert np.max(np.abs(commands)) <= 12.0 + TORQUE_STEP
        inverted = -1.0 if side == "right" else 1.0
        np.testing.assert_allclose(inverted * commands, table[f"{side}/knee.torque_sent [N*m]"], atol=1e-9)
    for way in (True, False):  # what was heard keeps its own time, which may lie before what was sent meanwhile
        times = [time for time, *_, ours in files.frames if ours is way]
        assert times == sorted(times)


def test_received_frames_are_logged_too(walked):
    _, files, _ = walked
    heard = [identifier for _, bus, identifier, data, ours in files.frames if not ours and bus == "legs"]
    sent = [identifier for _, bus, identifier, data, ours in files.frames if ours]
    assert sorted(heard) == sorted(sent)


def test_a_pipe_gets_plain_lines(walked):
    process = walked[0]
    assert process.stderr == ""
    assert not re.search(r"[\x00-\x09\x0b-\x1f\x7f]", process.stdout)
    assert process.stdout.startswith("knee_exo: 2 s at 200 Hz, simulated\n")


def test_only_the_recording_remains(walked):
    names = walked[1].names
    assert len(names) == 3 and {name.partition(".")[2] for name in names} == {"csv", "mcap", "json"}
    assert len({name.partition(".")[0] for name in names}) == 1
    assert re.fullmatch(r"knee_exo_\d{4}-\d\d-\d\d_\d\d-\d\d-\d\d", names[0].partition(".")[0])


@pytest.mark.hazard("H9a")
@pytest.mark.parametrize(
    "number, code",
    soaked(
        [
            (signal.SIGINT, 130),
            (signal.SIGTERM, 143),
            (signal.SIGHUP, 129),
            (signal.SIGQUIT, 131),
            (signal.SIGUSR1, 138),
        ],
        but=[0, 1, 3],
    ),
)
def test_a_signal_in_the_middle_ends_in_the_safe_stop(tmp_path, number, code):
    with Listener() as listener:
        process = started(KNEE_EXO, "--plotjuggler", listener.address, cwd=tmp_path)
        seen = listener.wait(50)
        process.send_signal(number)
        out, err = process.communicate(timeout=30)
        seen += listener.rest()
    files = Files(tmp_path / "recordings")
    assert process.returncode == code
    assert err.startswith(f"stopped by {number.name}") and err.count("\n") == 1
    assert "safe stop   zero torque, then disable: confirmed by left/knee, right/knee" in out
    assert_safely_stopped(files, SIDES.values())
    sidecar, ticks = files.sidecar, files.table["tick"]
    assert sidecar["ended"] == f"stopped by {number.name}"
    assert len(ticks) == sidecar["ticks"] == sidecar["statistics"]["ticks"] and sidecar["dropped"] == 0
    assert ticks[-1] - ticks[0] + 1 - len(ticks) <= sidecar["missed"]
    assert stamps(seen) == pytest.approx(files.table["time [s]"] - files.table["time [s]"][0], abs=1e-6)


def test_a_signal_during_startup_leaves_no_files(tmp_path):
    """Between the end of Python's own start and arming: the run never begins."""
    path = knee(tmp_path)
    path.write_text(path.read_text() + "\nimport os, signal\nos.kill(os.getpid(), signal.SIGINT)\n")
    process = finished(path, "--duration", "5", cwd=tmp_path)
    assert process.returncode == 130
    assert (process.stdout, process.stderr) == ("", "tickwork: stopped by Ctrl-C; nothing is armed\n")
    assert not (tmp_path / "recordings").exists()


def test_kill_9_loses_no_tick_and_leaves_no_process(tmp_path):
    """What a listener has seen of the run is in the files, and whatever reached the ring besides."""
    with Listener() as listener:
        process = started(KNEE_EXO, "--plotjuggler", listener.address, cwd=tmp_path)
        seen = listener.wait(60)
        [recorder] = psutil.Process(process.pid).children()
        process.kill()
        process.wait(10)
        psutil.wait_procs([recorder], timeout=20)
        assert not recorder.is_running()
        out, err = process.communicate(timeout=10)
        seen += listener.rest()
    files = Files(tmp_path / "recordings")
    table, sidecar = files.table, files.sidecar
    assert process.returncode == -signal.SIGKILL and out == ""
    assert {name.partition(".")[2] for name in files.names} == {"csv", "mcap", "json"}
    assert stamps(seen) == pytest.approx(table["time [s]"] - table["time [s]"][0], abs=1e-6)
    assert sidecar["ended"] == "the control process died"
    assert sidecar["ticks"] == len(table["tick"]) == sidecar["statistics"]["ticks"]
    assert "the control process died" in err and f"{len(seen)} ticks were recorded" in err
    assert files.one(".csv").read_text().endswith("\n")
    # The last completed tick's commands are in the log, and at most one more that was on its way when the process died.
    for can_id in SIDES.values():
        assert len(files.sent(can_id)) - 2 - len(table["tick"]) in (0, 1)


def test_an_exception_in_a_block_at_tick_100(tmp_path):
    path = knee(
        tmp_path,
        law="return self.trouble(position) if tick == 100 else 1.5 * math.sin(t)\n\n"
        "    def trouble(self, position):\n        return {}['gain']",
    )
    process = finished("robot.py", "--fast", "--duration", "2", cwd=tmp_path)
    files = Files(tmp_path / "recordings")
    lines = process.stderr.splitlines()
    assert process.returncode == 3
    assert lines[0] == "FAULT at law, tick 100 (0.5 s): its step raised an exception"
    assert re.fullmatch(r"  its inputs: position = -?[\d.e-]+, velocity = -?[\d.e-]+", lines[1])
    line = line_of(path, "self.trouble(position)")
    assert lines[2] == f"  robot.py:{line} in step: return self.trouble(position) if tick == 100 else 1.5 * math.sin(t)"
    assert lines[3] == f"  robot.py:{line_of(path, 'return {}')} in trouble: return {{}}['gain']"
    assert lines[4] == "  KeyError: 'gain'"
    assert "Traceback" not in process.stderr and "executor" not in process.stderr
    assert list(files.table["tick"]) == list(range(100))
    assert files.sidecar["ended"] == "fault: exception at law, tick 100"
    assert_safely_stopped(files, [1])
    assert "try next" not in process.stdout


@pytest.mark.parametrize("value", ["math.nan", "math.inf", "-math.inf"])
def test_non_finite_commands_are_faults_also_after_a_limiter(tmp_path, value):
    """A limiter turns an infinity into NaN, which ends the run; the report names what was infinite."""
    path = knee(tmp_path, law=f"return {value} if tick == 100 else 1.5")
    process = finished("robot.py", "--fast", "--duration", "1", cwd=tmp_path)
    files = Files(tmp_path / "recordings")
    assert_safely_stopped(files, [1])
    torques = [torque_of(data) for data in files.sent(1) if data not in (ENABLE, DISABLE)]
    assert max(map(abs, torques)) <= 5.0 + TORQUE_STEP
    lines = process.stderr.splitlines()
    assert process.returncode == 3
    assert lines[0] == "FAULT at knee, tick 100 (0.5 s): a command is NaN or infinite"
    assert "torque_command = nan" in lines[1]
    assert lines[2].startswith(
        f"  first non-finite signal: law.torque = {value.replace('math.', '')}, created at "
        f"robot.py:{line_of(path, 'Law(name=')}, with inputs position = "
    )
    # 100 commands, of the ticks 0 to 99, between zero torque of arming and of the safe stop.
    sent = files.sent(1)
    assert sent.index(DISABLE) == 2 + 100 + 1 and max(torques) < 1.5 + TORQUE_STEP


def test_two_runs_in_virtual_time_leave_the_same_bytes(tmp_path):
    recorded = []
    for folder in ("first", "second"):
        words = ("--fast", "--duration", "3", "--record", folder, "--can-log")
        process = finished(KNEE_EXO, *words, cwd=tmp_path, cold=True)
        assert process.returncode == 0, process.stderr
        files = Files(tmp_path / folder)
        recorded.append([files.one(".csv").read_bytes(), files.one(".can.log").read_bytes()])
    assert recorded[0] == recorded[1]
    assert recorded[0][0].count(b"\n") == 601


def test_no_record_leaves_no_file_and_still_counts_strides(tmp_path):
    process = finished(KNEE_EXO, "--fast", "--duration", "8", "--no-record", cwd=tmp_path)
    assert process.returncode == 0, process.stderr
    assert list(tmp_path.iterdir()) == []
    assert re.search(
        r"  left        \d strides of 1\.10 s; peak torque \d+\.\d N·m; positive work \d\.\d\d J per stride, negative "
        r"-\d\.\d\d J\n",
        process.stdout,
    )
    assert "\n  files       nothing was recorded: --no-record\n" in process.stdout


@pytest.mark.parametrize("rate", [100, 400])
def test_a_run_at_another_rate_has_its_grid(command_line, rate):
    code, out, err = command_line(KNEE_EXO, "--fast", "--duration", "2", "--rate", rate)
    assert (code, err) == (0, "") and out.startswith(f"knee_exo: 2 s at {rate} Hz, simulated, in virtual time\n")
    files = Files(command_line.folder / "recordings")
    np.testing.assert_array_equal(files.table["time [s]"], np.arange(2 * rate) / rate)
    assert files.sidecar["rate"] == rate


def test_plotjuggler_adds_a_viewer_to_a_diagram_without_one(command_line):
    with Listener() as listener:
        path = knee(command_line.folder, law="return 1.0")
        code, out, err = command_line(path, "--duration", "0.5", "--plotjuggler", listener.address)
        datagrams = listener.rest()
    assert (code, err) == (0, "")
    times = Files(command_line.folder / "recordings").table["time [s]"]
    assert stamps(datagrams) == pytest.approx(times - times[0], abs=1e-6)
    assert datagrams[0]["law"]["torque"] == 1.0


def test_record_names_the_folder(tmp_path):
    process = finished(KNEE_EXO, "--fast", "--duration", "1", "--record", "a/b", cwd=tmp_path)
    assert process.returncode == 0, process.stderr
    assert len(list((tmp_path / "a" / "b").iterdir())) == 3 and not (tmp_path / "recordings").exists()


def test_record_adds_a_recorder_to_a_diagram_without_one(tmp_path):
    path = knee(tmp_path, law="return 1.0")
    path.write_text(path.read_text().replace("    CsvRecorder()", "    pass"))
    assert finished(path, "--fast", "--duration", "1", cwd=tmp_path).returncode == 0
    assert not (tmp_path / "recordings").exists()
    assert finished(path, "--fast", "--duration", "1", "--record", "recordings", cwd=tmp_path).returncode == 0
    assert "law.torque [N*m]" in Files(tmp_path / "recordings").header


def screen_of(text):
    """What a terminal shows after these characters: its lines. Knows carriage return, erase to the end of the screen,
    and colours.
    """
    lines, column = [""], 0
    for token in re.findall(r"\x1b\[[\d;?]*[A-Za-z]|.", text, re.DOTALL):
        if token == "\r":
            column = 0
        elif token == "\n":
            lines.append("")
            column = 0
        elif token == "\x1b[J":
            lines[-1] = lines[-1][:column]
        elif token.startswith("\x1b["):
            assert token.endswith(("m", "?7l", "?7h")), f"unexpected sequence {token!r}"
        else:
            lines[-1] = lines[-1][:column].ljust(column) + token + lines[-1][column + 1 :]
            column += 1
    return lines


class Terminal:
    """A run at a terminal of its own, where Ctrl-C is a key."""

    def __init__(self, *arguments, cwd):
        self.pid, self.descriptor = pty.fork()
        if self.pid == 0:
            os.chdir(cwd)
            command = [sys.executable, "-m", "runtime", *map(str, arguments)]
            os.execvpe(sys.executable, command, environment(TERM="xterm-256color"))
        self.text = ""

    def read_until(self, pattern, timeout=30.0):
        """Read on until the text matches; None: until the terminal is closed."""
        while pattern is None or not re.search(pattern, self.text):
            assert select.select([self.descriptor], [], [], timeout)[0], self.text
            try:
                data = os.read(self.descriptor, 65536)
            except OSError:  # closed at the other end
                data = b""
            if not data:
                assert pattern is None, self.text
                return
            self.text += data.decode()

    def press(self, keys):
        os.write(self.descriptor, keys)

    def close(self):
        """As when the window is closed, or the connection to another machine breaks."""
        os.close(self.descriptor)

    def code(self):
        return os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])


def test_the_status_line_refreshes_in_place_and_is_gone_at_the_end(tmp_path):
    terminal = Terminal(KNEE_EXO, "--duration", "1.5", "--no-record", cwd=tmp_path)
    terminal.read_until(None)
    terminal.close()
    assert terminal.code() == 0
    drawn, _, rest = terminal.text.partition("knee_exo: 1.5 s")
    refreshes = [line for line in drawn.split("\r") if "running" in line]
    assert 5 <= len(refreshes) <= 30 and "\n" not in drawn
    assert all(re.search(r"\d\.\d/1\.5 s", line) for line in refreshes)
    screen = screen_of(terminal.text)
    assert screen[0].startswith("knee_exo: 1.5 s at 200 Hz, simulated")
    assert not any("running" in line or "missed 0 ·" in line for line in screen)
    assert rest and "\x1b" not in rest.replace("\r\n", "\n")


@pytest.mark.hazard("H9a")
def test_ctrl_c_at_a_terminal_stops_safely(tmp_path):
    """The key reaches the whole foreground group, and yet only the controller: the recorder finishes its files."""
    terminal = Terminal(KNEE_EXO, cwd=tmp_path)
    terminal.read_until(r"running.* 0\.[3-9] s")
    terminal.press(b"\x03\x03\x03")  # impatience must not tear the end of the recording
    terminal.read_until(None)
    terminal.close()
    assert terminal.code() == 130
    screen = "\n".join(screen_of(terminal.text))
    assert "stopped by SIGINT (Ctrl-C)" in screen and "confirmed by left/knee, right/knee" in screen
    files = Files(tmp_path / "recordings")
    assert_safely_stopped(files, SIDES.values())
    assert files.sidecar["ended"] == "stopped by SIGINT" and files.sidecar["ticks"] == len(files.table["tick"])


@pytest.mark.hazard("H9a")
def test_a_terminal_that_is_closed_ends_the_run_in_the_safe_stop(tmp_path):
    terminal = Terminal(KNEE_EXO, cwd=tmp_path)
    terminal.read_until(r"running.* 0\.[3-9] s")
    [recorder] = psutil.Process(terminal.pid).children()
    terminal.close()
    assert terminal.code() == 129
    assert psutil.wait_procs([recorder], timeout=20)[1] == []
    files = Files(tmp_path / "recordings")
    assert_safely_stopped(files, SIDES.values())
    assert files.sidecar["ended"] == "stopped by SIGHUP" and files.sidecar["ticks"] == len(files.table["tick"])


def test_arming_without_replies_names_the_drives_and_the_frames_received(tmp_path):
    path = knee(tmp_path, law="return 1.0")
    path.write_text(
        path.read_text()
        + """

def plant(robot):
    from blocks.actuators import EmulatedCubeMars

    with Diagram("plant", rate=1000) as plant:
        EmulatedCubeMars("AK10-9-V2.0", bus="legs", can_id=7)(position=0.0, velocity=0.0)
    return plant
"""
    )
    process = finished(path, "--fast", "--duration", "1", cwd=tmp_path)
    files = Files(tmp_path / "recordings")
    assert process.returncode == 3
    assert process.stderr.splitlines()[0] == (
        "FAULT at knee, while arming: no reply from knee (id 1 on bus legs); no frame was received on any bus; "
        'add robot["knee"].emulator() to the plant'
    )
    assert "safe stop   zero torque, then disable: NOT confirmed by knee" in process.stdout
    assert set(files.sent(1)) == {ENABLE, NOTHING, DISABLE} and files.sent(1)[-2:] == [NOTHING, DISABLE]
    assert len(files.table["tick"]) == 0


def test_replies_of_another_length_are_named_with_their_remedy(tmp_path):
    path = knee(tmp_path, law="return 1.0")
    path.write_text(
        path.read_text()
        + """

def plant(robot):
    with Diagram("plant", rate=1000) as plant:
        robot["knee"].emulator(reply=7)(position=0.0, velocity=0.0)
    return plant
"""
    )
    process = finished(path, "--fast", "--duration", "1", cwd=tmp_path)
    assert process.returncode == 3
    first, *rest = process.stderr.splitlines()
    assert re.fullmatch(
        r"FAULT at knee, while arming: no reply from knee \(id 1 on bus legs\); knee: \d+ replies of 7 bytes from "
        r"id 1: set reply=7",
        first,
    )
    assert (
        any(re.search(r"\d+ replies of 7 bytes from id 1: set reply=7", line) for line in rest)
        and "never replied" not in process.stderr
    )
