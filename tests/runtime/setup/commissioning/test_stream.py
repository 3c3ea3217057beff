"""`stream actuator` over real udp_multicast: live, without torque, to a file and to PlotJuggler."""

import fcntl
import os
import pty
import re
import select
import struct
import termios

import pytest

from runtime.host.console.stderr import Terminal
from runtime.host.errors import BAD_INPUT, OK
from runtime.setup.commissioning.streaming import show
from tests.runtime.runs import Listener
from tests.runtime.setup.commissioning.nodes import DISABLE, V3, Commander, Mit, Nodes, Private, Servo

pytestmark = pytest.mark.paced


def test_a_drive_is_shown_recorded_and_plotted_without_torque(command_line):
    drive = Mit(3, position=0.5, velocity=2.0)
    with Nodes(80, drive) as nodes, Listener() as listener:
        code, out, err = command_line(
            "stream",
            "actuator",
            "3",
            *nodes.words,
            "--model",
            "AK10-9-V2.0",
            "--duration",
            "0.5",
            "--record",
            "out",
            "--plotjuggler",
            listener.address,
        )
        told = listener.rest()
    assert (code, err) == (OK, "") and "CubeMars in MIT mode, without torque\n" in out
    assert re.search(r"^ +0\.\d s +0\.500 rad +(1\.99|2\.0\d) rad/s +-?0\.0[0-2] N·m +31 °C$", out, re.MULTILINE)
    assert {frame for frame in drive.heard if not frame[1]} == {(3, False, DISABLE)}
    # a stop, before MIT mode is asked
    assert {frame for frame in drive.heard if frame[1]} == {(0x0400FD03, True, bytes(8))}
    [file] = (command_line.folder / "out").glob("actuator_3_*.csv")
    lines = file.read_text().splitlines()
    assert lines[0] == (
        "time [s],tick,actuator_3.position [rad],actuator_3.velocity [rad/s],actuator_3.torque "
        "[N*m],actuator_3.temperature [degC]"
    )
    assert len(lines) <= 1 + 50 and float(lines[-1].split(",")[2]) == pytest.approx(0.5, abs=4e-4)
    assert (
        len(told) == len(lines) - 1
        and told[0]["actuator_3"]["velocity"] == pytest.approx(2.0, abs=0.03)
        and "timestamp" in told[0]
    )


@pytest.mark.parametrize(
    "drive, model, family",
    [
        (Private(9), "AK80-9", "RobStride or CyberGear"),
        (Mit(9, host=253), "AK80-9", "RobStride in its MIT protocol"),
        (Mit(9), "RS02", "CubeMars in MIT mode"),
    ],
)
def test_a_model_of_another_family_is_refused(command_line, drive, model, family):
    with Nodes(86, drive) as nodes:
        err = command_line.refused("stream", "actuator", "9", *nodes.words, "--model", model, "--duration", "0.3")
    assert f"id 9 on {nodes.channel} is a {family}, and {model} is a model of another family" in err


def test_a_robstride_without_a_model_shows_only_its_position(command_line):
    drive = Private(9)
    with Nodes(81, drive) as nodes:
        code, out, _ = command_line("stream", "actuator", "9", *nodes.words, "--duration", "0.2")
    assert (
        code == OK
        and "velocity and torque need --model" in out
        and ("   0.250 rad        - rad/s        - N·m    36 °C") in out
    )
    assert {identifier >> 24 for identifier, extended, _ in drive.heard if extended} == {4}


def test_scan_only_listens_to_a_cubemars_in_servo_mode(command_line):
    """A report of 90°, and 0.12 A of an AK60-6 V1.1: 0.12 × 0.078 × 6 = 0.056 N·m."""
    drive = Servo(4, error=0)
    with Nodes(84, drive) as nodes:
        code, out, _ = command_line(
            "stream", "actuator", "4", *nodes.words, "--servo", "--model", "AK60-6-V1.1", "--duration", "0.3"
        )
    assert code == OK and "   1.571 rad" in out and "0.06 N·m" in out and drive.heard == []


def test_a_board_that_reports_on_request_is_queried(command_line):
    drive = V3(5)
    with Nodes(85, drive) as nodes:
        code, out, _ = command_line("stream", "actuator", "5", *nodes.words, "--duration", "0.2")
    assert code == OK and "CubeMars with a V3.0 board" in out and "   1.571 rad" in out


def test_an_absent_drive_and_another_controller_are_reported(command_line):
    with Nodes(82, Mit(3), Commander(3)) as nodes:
        code, _, err = command_line("stream", "actuator", "3", *nodes.words)
    assert (
        code == BAD_INPUT
        and (
            "another controller commands id 3 on this bus. Nothing was sent, because "
            "the queries remove torque. End that program first"
        )
        in err
    )
    with Nodes(83) as nodes:
        assert (
            f"no drive responds as id 3 on {nodes.channel}" in command_line("stream", "actuator", "3", *nodes.words)[2]
        )


@pytest.mark.parametrize(
    "words, said",
    [
        (["foot", "3"], "stream foot: expected stream actuator ID, or stream imu, openimu or i2c"),
        (["actuator"], "missing argument ID"),
        (["actuator", "3", "--rate", "1000"], "--rate 1000: at most 500 Hz"),
        (["actuator", "3", "--model", "AK80"], "is not a CubeMars model"),
    ],
)
def test_stream_rejects_invalid_options_with_reason(command_line, words, said):
    assert said in command_line.refused("stream", *words)


def test_stream_line_is_redrawn_in_place_within_the_terminal():
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 40, 0, 0))
    screen = Terminal(slave, {"TERM": "xterm", "LANG": "C"})
    for now in (1.0, 1.1):
        assert show(now, f"{now:8.1f} s  " + "0.500 rad  -4.50 N·m  " * 9, screen) == now
    drawn = ""
    while select.select([master], [], [], 0.2)[0]:
        drawn += os.read(master, 1 << 16).decode()
    os.close(master)
    os.close(slave)
    lines = [re.sub(r"\x1b\[(J|\?7[lh])", "", line) for line in drawn.split("\r") if line]
    assert [*map(len, lines)] == [39, 39] and lines[1].startswith("     1.1 s  0.500 rad  -4.50 N*m")
