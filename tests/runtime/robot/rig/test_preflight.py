"""Before a rig is armed the operator reads a table and presses Enter: real processes, drives on udp_multicast,
and a third party.
"""

import json
import os
import signal
import time

import pytest

from blocks.actuators import CubeMars
from blocks.safety import EStopHeartbeat
from graph import Diagram, compile
from runtime.host.console.styles import Console
from runtime.host.errors import FAULT, OK
from runtime.record.report.failure_coverage import coverage, in_words
from runtime.record.report.preflight.table import Preflight
from runtime.record.report.preflight.text import ASK, text
from tests.runtime.robot.guardian.bus import PATIENT, ROBOT, Bus, is_torque
from tests.runtime.runs import DISABLE, ENABLE, KNEE_EXO, NOTHING, Files, finished, write
from tests.runtime.terminals import Terminal
from tests.soaking import soaked

pytestmark = pytest.mark.paced

WIDE = Console(260)
BOTH_GONE = "kill -9 of guardian and control process together, power loss of the computer, suspend of the computer"
NO_MEANS = "no time-out in the drive, no charge pump"


@pytest.fixture
def bus(tmp_path):
    with Bus(tmp_path, number=5) as bus:
        yield bus


@pytest.fixture
def terminal():
    with Terminal() as found:
        yield found


def at_the_table(bus, terminal, *words):
    """A run that asks. Returns what it has shown."""
    robot = write(bus.folder, ROBOT.format(law="pass", torque=2.0, more="", blocks="", drive=PATIENT))
    terminal.run(robot, "--rig", bus.rig, *words, cwd=bus.folder)
    terminal.wait_for("press Enter to arm")
    return terminal.look()


@pytest.mark.hazard("H4a")
def test_torque_is_zero_until_operator_presses_enter(bus, terminal, tmp_path):
    shown = at_the_table(bus, terminal, "--record", "out", "--duration", "60").replace("\r", "")
    for side, can_id in (("left", 1), ("right", 2)):
        assert f"  {side}/knee".ljust(14) + f"legs {can_id}      yes       " in shown
    assert (
        shown.count("0.100 rad in [-12.5, 12.5]") == 2
        and shown.count("30 °C        none") == 2
        and " ".join(shown.split()).count(
            "limit 18 N·m; not read back: mode, current limit, time-out; own time-out: unknown;"
        )
        == 2
    )
    assert f"bus legs  udp_multicast {bus.channel}, load 9%, 11% at worst" in shown
    assert (
        f"not covered: {BOTH_GONE} (nothing stops left/knee, right/knee after both processes have ended: {NO_MEANS})"
        in " ".join(shown.split())
    )
    assert "2 devices, no problems\n" in shown
    terminal.wait_for(r"ready .*0\.0/60 s .* Enter arms, space ends")
    terminal.press(b"rmx")  # any other key arms nothing
    bus.listen(1.2)  # longer than arming may take
    told = [frame.data for frame in bus.commands(1, asking=True)]
    assert set(told) == {DISABLE} and len(told) > 150, "it is asked for its state, and enabled by nothing"
    terminal.press(b"\n")
    bus.await_torque()
    told = [frame.data for frame in bus.commands(1)]
    assert told[:2] == [ENABLE, NOTHING]
    terminal.wait_for("running")
    terminal.press(b" ")
    assert terminal.end() == 0 and "zero torque, then disable: confirmed by left/knee, right/knee" in terminal.words()
    assert "caution nothing stops left/knee, right/knee after both processes have ended" in terminal.words()
    files = Files(tmp_path / "out")
    assert files.table["tick"][0] == 0 and files.sidecar["missed"] == 0
    [table] = [event for event in files.sidecar["events"] if event["event"] == "preflight"]
    assert [row["device"] for row in table["devices"]] == ["left/knee", "right/knee"] and table["devices"][0][
        "position"
    ] == pytest.approx(0.1, abs=1e-3)
    assert {"event": "confirm", "tick": -1, "by": "keys"} in files.sidecar["events"]


@pytest.mark.parametrize("key, code", soaked([(b" ", 0), (b"q", 0), (b"\x03", 130)], but=[0, 2]))
def test_the_run_can_be_ended_at_the_table(bus, terminal, key, code):
    at_the_table(bus, terminal, "--no-record")
    terminal.press(key)
    assert terminal.end() == code and terminal.attributes == terminal.before
    bus.listen()
    assert not any(is_torque(frame) for frame in bus.frames) and [frame.data for frame in bus.commands(2)][-2:] == [
        NOTHING,
        DISABLE,
    ]
    assert "  ticks       0 done" in terminal.look()


def test_missing_real_time_priority_and_its_risk_are_shown_before_enter(bus, terminal):
    at_the_table(bus, terminal, "--no-record", "--realtime", "off")
    shown = terminal.look()
    assert shown.index("the loop has no real-time priority") < shown.index("press Enter to arm")
    terminal.press(b"q")
    assert terminal.end() in (OK, FAULT), "on a busy machine the drives may miss frames of such a loop first"


def test_the_guardian_is_active_during_confirmation(bus, terminal):
    at_the_table(bus, terminal, "--no-record")
    stopped = time.time()
    os.kill(terminal.process.pid, signal.SIGSTOP)
    bus.listen(0.4)
    first = [next(frame for frame in bus.commands(motor, stopped) if frame.data == NOTHING) for motor in (1, 2)]
    assert max(frame.time for frame in first) - stopped < 0.3, "zero torque is sent only in a stop"
    os.kill(terminal.process.pid, signal.SIGCONT)
    assert terminal.end() == 3 and "fenced by the guardian" in terminal.words()
    bus.listen()
    assert {frame.data for motor in (1, 2) for frame in bus.commands(motor)} == {NOTHING, DISABLE}


def test_the_report_of_the_guardian_replaces_the_status_line(bus, terminal):
    at_the_table(bus, terminal, "--no-record")
    terminal.wait_for("ready ")
    terminal.process.kill()
    terminal.wait_for(r"\r\x1b\[Jtickwork guardian: the control process died after arming; .*\r\n")
    terminal.end()


def test_drive_lost_during_confirmation_ends_run_with_message(bus, terminal):
    at_the_table(bus, terminal, "--no-record", "--stop-for", "0.2")
    bus.drives.kill()
    assert terminal.end() == 3
    shown = terminal.words()  # wrapped at the width
    assert "/knee, while arming: no reply for longer than its timeout (1 s)" in shown
    bus.listen()
    assert not any(is_torque(frame) for frame in bus.frames)


IN_DOUBT = '[device."left/knee"]\nrange = [-0.1, 2.0]\nwake_shift = 0.6981\n'


@pytest.mark.hazard("H5b")
def test_neither_enter_nor_yes_arms_a_joint_with_an_ambiguous_angle(bus, terminal):
    """Its drive reads 0.1 rad, and 0.80 and 1.50 rad also lie in its range."""
    bus.rig.write_text(bus.rig.read_text() + IN_DOUBT)
    robot = write(bus.folder, ROBOT.format(law="pass", torque=2.0, more="", blocks="", drive=PATIENT))
    run = finished(robot, "--rig", bus.rig, "--yes", "--no-record", "--duration", "1", cwd=bus.folder)
    assert (
        run.returncode == 3
        and "FAULT at knees, while arming: left/knee reads 0.100 rad; a power cycle can shift" in run.stderr
    ), run.stderr
    terminal.run(robot, "--rig", bus.rig, "--no-record", cwd=bus.folder)
    terminal.wait_for("press Enter to check again")
    assert "1 problem: left/knee: in doubt" in terminal.look()
    terminal.wait_for("ready .* Enter arms")
    terminal.press(b"\n")
    terminal.wait_for("NOT armed: left/knee reads 0.100 rad")
    terminal.press(b"q")
    assert terminal.end() == 0
    bus.listen()
    assert not any(is_torque(frame) for frame in bus.frames)
    run = finished(
        robot,
        "--rig",
        bus.rig,
        "--yes",
        "--no-record",
        "--duration",
        "0.5",
        "--pose",
        "left/knee=6 deg",
        cwd=bus.folder,
    )
    assert run.returncode == 0, run.stderr
    bus.await_torque()


def test_a_pose_is_an_angle_of_a_joint_on_a_rig(command_line):
    assert "--pose needs --rig" in command_line.refused(KNEE_EXO, "--pose", "left/knee=0")
    rig = write(command_line.folder, "", "lab.toml")
    for pose in ("left/knee", "left/knee=", "left/knee=straight", "left/knee=inf", "left/knee=3 kg"):
        assert f"--pose {pose}: " in command_line.refused(KNEE_EXO, "--rig", rig, "--pose", pose)


@pytest.mark.hazard("H4b")
def test_without_a_terminal_a_rig_is_refused_before_anything_is_sent(command_line):
    with Bus(command_line.folder, number=6, answering=False) as bus:
        bus.rig.write_text(
            bus.rig.read_text() + '[device."left/knee"]\nrange = [-0.1, '
            '2.0]\n[device."right/knee"]\nrange = [-0.1, 2.0]\n'
        )
        complaint = command_line.refused(KNEE_EXO, "--rig", bus.rig)
        bus.listen(0.2)
        assert not bus.frames
    assert "are not a terminal" in complaint and "--yes to arm without confirmation" in complaint


# The table


@pytest.fixture
def knee():
    """A table of one drive, from values of its outputs."""
    with Diagram("one", rate=200) as robot:
        drive = CubeMars("AK80-9", bus="legs", can_id=7, name="knee", timeout=0.1)
        drive(torque_command=0.0)
    schedule = compile(robot)
    table = Preflight(robot, schedule, {"legs": ("socketcan", "can0")}, True)

    def told(**outputs):
        values = schedule.arena.copy()
        for name, value in {
            "position": 0.5,
            "velocity": 0.1,
            "temperature": 31.0,
            "fault": 0.0,
            "age": 0.002,
            "active": 1.0,
            **outputs,
        }.items():
            values[schedule.signals[f"knee.{name}"].slot] = value
        return table.event(values)

    return told


def test_a_healthy_drive_has_no_marks(knee, golden):
    lines = text(json.loads(json.dumps(knee())), WIDE)
    assert not any("!" in line for line in lines) and lines[-2:] == ["1 device, no problems", ASK]
    golden("preflight", lines)


def test_a_narrow_terminal_lists_the_readings_of_each_drive(knee, golden):
    golden("preflight_narrow", text(knee(fault=5.0), Console(80)))
    assert all(len(line) <= 80 for line in text(knee(), Console(80)))
    assert text(knee(), Console(128))[1] == text(knee(), WIDE)[1]
    assert "\x1b[31m" in text(knee(fault=5.0), Console(80, colour=True))[1]


@pytest.mark.parametrize(
    "outputs, mark, why",
    [
        ({"position": 12.5}, "12.500 rad in [-12.5, 12.5] !", "at the end of its range"),
        ({"position": -12.6}, "-12.600 rad in [-12.5, 12.5] !", "outside its range"),
        ({"position": float("nan")}, "nan rad", "outside its range"),
        ({"temperature": 70.0}, "70 °C !", "hot"),
        ({"fault": 5.0}, "encoder !", "encoder"),
        ({"fault": 77.0}, "code 77, not listed in the manual !", "code 77, not listed in the manual"),
        ({"age": 0.06}, "60.0 ms !", "old sample"),
    ],
)
def test_problems_are_marked_and_counted(knee, outputs, mark, why):
    lines = text(knee(**outputs), WIDE)
    assert mark in lines[2] and lines[-2] == f"1 problem: knee: {why}"
    two = text(knee(**{"velocity": 0.0, "temperature": 99.0, **outputs}), Console(200, colour=True))
    assert "\x1b[31m" in two[2] and ("2 problems" in two[-2] or outputs.get("temperature"))


def test_drive_timeout_covers_loss_of_power_and_of_both_processes():
    with Diagram("one", rate=200):
        one, other = both = [CubeMars("AK80-9", bus="legs", can_id=number, name=f"knee{number}") for number in (1, 2)]

    def last():
        return [(entry["failure"], entry["covered"], entry["by"]) for entry in coverage(both, both)[-3:]]

    failures = BOTH_GONE.split(", ")
    assert last() == [
        (failure, False, f"nothing stops knee1, knee2 after both processes have ended: {NO_MEANS}")
        for failure in failures
    ]
    one.own_timeout = 0.025
    assert last() == [
        (failure, False, f"nothing stops knee2 after both processes have ended: {NO_MEANS}") for failure in failures
    ]
    other.own_timeout = 0.025
    assert (
        in_words(coverage(both, both))[1] == ""
        and f"{BOTH_GONE} (the drives' own time-out, which is declared and not read back)"
        in in_words(coverage(both, both))[0]
    )


def test_table_lists_how_each_device_is_stopped():
    with Diagram("one", rate=200) as robot:
        CubeMars("AK80-9", name="knee", safe_stop="damp", stop_time=2.0)(torque_command=0.0)
        EStopHeartbeat(bus="estop", name="button")
    rows = Preflight(robot, compile(robot), {}, False).event(compile(robot).arena)
    assert {row["device"]: row["stop"] for row in rows["devices"]} == {
        "knee": "damped within 9 N·m for 2 s then disable",
        "button": "nothing to stop",
    }
    assert {bus["bus"]: len(bus["coverage"]) for bus in rows["buses"]} == {"can": 8, "estop": 0}
    assert any(
        line.startswith("  button  estop 256   yes") and line.endswith("safe stop: nothing to stop")
        for line in text(rows, WIDE)
    )


@pytest.mark.hazard("H8g")
def test_check_lists_covered_failures(command_line):
    out = command_line("check", KNEE_EXO)[1]
    assert (
        "covered: exception, loss of the guardian (the run itself); kill -9, kill -STOP (the guardian); hung "
        "block (the watchdog, then the guardian)"
    ) in out
    assert (
        f"not covered: {BOTH_GONE} (nothing stops left/knee, right/knee after both processes have ended: {NO_MEANS})"
        in out
    )
    [bus] = json.loads(command_line("check", KNEE_EXO, "--json")[1])["buses"]
    assert {entry["failure"]: entry["covered"] for entry in bus["coverage"]} == {
        "exception": True,
        "kill -9": True,
        "kill -STOP": True,
        "hung block": True,
        "loss of the guardian": True,
        "kill -9 of guardian and control process together": False,
        "power loss of the computer": False,
        "suspend of the computer": False,
    }


def test_drive_without_temperature_and_error_in_replies_is_marked():
    with Diagram("robot", rate=200) as diagram:
        CubeMars("AK80-9", can_id=1, name="knee", reply=6)(torque_command=0.0)
    schedule = compile(diagram)
    arena = schedule.arena.copy()
    for name, value in (("temperature", float("nan")), ("age", 0.001), ("active", 1.0)):
        arena[schedule.signals[f"knee.{name}"].slot] = value
    event = Preflight(diagram, schedule, {}, True).event(arena)
    (row,) = event["devices"]
    assert row["temperature"] is None and row["fault_words"] == "not reported" and row["marks"] == {}
    assert json.loads(json.dumps(event, allow_nan=False)) and "not reported" in "\n".join(text(event, WIDE))
