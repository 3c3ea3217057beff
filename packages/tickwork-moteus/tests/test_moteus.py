"""Conformance of the blocks, the life of the emulated drive, runs of both, and the set-up as a dialogue."""

import math
import os
import struct
import subprocess
import sys

import pytest

from blocks.controllers import Impedance
from blocks.limiters import TorqueLimiter
from graph import Diagram, DiagramError, compile
from graph.conformance import check_block
from graph.dialogue import Listen, Rejected, Send, Show
from graph.family import Request
from tests.blocks.actuators.wire import EXTENDED, FOREIGN, IDLE, MALFORMED, NOT_FINITE, OUT_OF_LIMITS, TAKEN, Wired
from tickwork_moteus import EmulatedMoteus, Moteus, protocol
from tickwork_moteus.family import FAMILY, answers
from tickwork_moteus.models import find

NOTED, COMMANDED, TIME = 2, 3, 0  # of cext/abi.pxd
TURN = 2.0 * math.pi


@pytest.mark.parametrize("kind", [Moteus, EmulatedMoteus])
def test_block_passes_the_conformance_test(kind):
    assert check_block(kind)


def driver_of(**parameters):
    return Wired(Moteus, "moteus-n1", **{"limit": 2.0} | parameters)


def drive_of(**parameters):
    return Wired(EmulatedMoteus, "moteus-n1", **parameters)


def exchange(drive, frame, after=0.0):
    """Offer a frame, advance the time, and return the replies."""
    drive.hear(frame[0] | EXTENDED * frame[1], frame[2])
    drive.arena[TIME] += after
    drive.step()
    return drive.say()


def reply(mode=10, position=0, velocity=0, torque=0, voltage=48, temperature=30, fault=0):
    return protocol.REPLY.pack(
        protocol.HEAD, mode, position, velocity, torque, protocol.TAIL, voltage, temperature, fault
    )


def test_a_command_has_its_units_gear_limit_and_time_out():
    """0.5 rad behind a gear of 2, mounted backwards, is -1/2π revolutions; 1 N·m is 0.5 N·m at the drive."""
    driver = driver_of(can_id=9, gear_ratio=2.0, invert=True, can_timeout=0.2)
    stiffness = driver["wire"][2]
    assert stiffness == pytest.approx(4.0 * 4.0 / TURN)
    [(identifier, data)] = driver.say(position_command=0.5, torque_command=1.0, stiffness_command=0.5 * stiffness)
    assert identifier == EXTENDED | 0x8009 and len(data) == 48
    position, velocity, torque, kp, kd, most = struct.unpack_from("<6i", data, 6)
    driver["age"], driver["max_acceleration"] = 0.0, 1e-6
    assert (velocity, kd) == (0, 0) and torque <= 0 and most == 1000  # the drive's own limit: 2 N·m at the joint
    assert struct.unpack_from("<h", data, 32)[0] == 200
    [(_, data)] = driver.say(position_command=0.0, stiffness_command=0.0, torque_command=1.0)
    assert struct.unpack_from("<3i", data, 6) == (protocol.NOT_SET, 0, -500) and driver["torque_sent"] == 1.0
    assert driver.say(torque_command=math.nan) == NOT_FINITE and driver.say(torque_command=2.1) == OUT_OF_LIMITS


def test_every_mode_is_reported_and_only_position_mode_is_enabled():
    driver = driver_of(gear_ratio=2.0)
    said = {0: 0, 1: 40, 2: 0, 4: 0, 5: 5, 10: 0, 11: 11, 15: 15}
    for mode, fault in said.items():
        verdict = TAKEN if mode == 10 else IDLE
        data = reply(mode, 100_000, -50_000, 250, fault=40 if mode == 1 else 96)
        assert driver.hear(0x100, data) == verdict and driver["fault"] == fault
    assert driver.hear(EXTENDED | 0x100, reply(position=-100_000, temperature=-5)) == TAKEN
    assert driver["position"] == pytest.approx(-TURN / 2.0) and driver["temperature"] == -5.0
    driver.hear(0x100, data)
    assert driver["velocity"] == pytest.approx(-TURN / 4.0) and driver["torque"] == pytest.approx(0.5)
    for identifier, data, verdict in (
        (0x200, reply(), FOREIGN),
        (0x100, reply()[:23], MALFORMED),
        (0x100, reply(position=protocol.NOT_SET), MALFORMED),
        (0x100, reply(temperature=-128), MALFORMED),
        (0x100, reply() + bytes(8), MALFORMED),
        (0x100, b"", NOTED),
        (0x100, b"\x21\x00\x0a", NOTED),
        (EXTENDED | 0x8101, b"\x01\x00\x0a", COMMANDED),
        (EXTENDED | 0x8102, b"\x01\x00\x0a", FOREIGN),
        (EXTENDED | 0x10100, reply(), FOREIGN),
        (0x40000100, reply(), FOREIGN),
        (0x20000100, reply(), FOREIGN),
    ):
        assert driver.hear(identifier, data) == verdict, (identifier, data)
    assert "encoder" in driver.block.fault_in_words(35) and "mode 12" in driver.block.fault_in_words(12)


def test_the_drive_stops_itself_damps_and_stays_so_until_a_stop():
    drive = drive_of()
    nothing = protocol.nothing(1, 100)
    [(identifier, data)] = exchange(drive, nothing)
    assert identifier == 0x100 and data[3] == 10 and drive["enabled"] == 1.0
    drive["velocity"] = 10.0
    [(_, data)] = exchange(drive, protocol.query(1), 0.101)  # a query is no command
    assert data[3] == 11 and drive["torque"] == pytest.approx(-0.05 / TURN * 10.0)
    assert exchange(drive, nothing)[0][1][3] == 11
    assert exchange(drive, protocol.stop(1))[0][1][3] == 0 and exchange(drive, nothing)[0][1][3] == 10
    drive["fault"] = 33.0
    [(_, data)] = exchange(drive, nothing)
    assert (data[3], data[23]) == (1, 33) and drive["torque"] == 0.0
    drive["fault"] = 0.0
    assert exchange(drive, nothing)[0][1][3] == 1
    assert exchange(drive, protocol.stop(1))[0][1][3] == 0 and exchange(drive, nothing)[0][1][3] == 10


def test_the_permitted_torque_bounds_a_drive_with_larger_gains():
    """Its kp is 10 times the one of the block: its torque is that of the limit."""
    driver, drive = driver_of(), drive_of(wire_stiffness=40.0 / TURN)
    driver["max_acceleration"] = 1e-6
    [(identifier, data)] = driver.say(position_command=3.0, stiffness_command=driver["wire"][2])
    assert struct.unpack_from("<i", data, 18)[0] > 0.99 * 2**31
    drive.hear(identifier, data)
    drive.step()
    assert drive["torque"] == pytest.approx(2.0)


def robot(**parameters):
    with Diagram("robot", rate=200) as diagram:
        knee = Moteus("moteus-n1", bus="legs", limit=2.0, wire_stiffness=20.0 / TURN, name="knee", **parameters)
        torque = Impedance(stiffness=5.0, damping=0.2)(knee.position, knee.velocity, 0.1)
        knee(torque_command=TorqueLimiter(limit=2.0)(torque))
    return diagram


FILE = """
from blocks.controllers import Impedance
from blocks.limiters import TorqueLimiter
from blocks.recorders import CsvRecorder
from graph import Diagram
from tickwork_moteus import Moteus

with Diagram("robot", rate=200) as diagram:
    knee = Moteus("moteus-n1", bus="legs", limit=2.0, name="knee")
    torque = Impedance(stiffness=5.0, damping=0.2)(knee.position, knee.velocity, 0.1)
    knee(torque_command=TorqueLimiter(limit=2.0)(torque))
    CsvRecorder()
"""
RIG = """
[bus.legs]
interface = "udp_multicast"
channel = "239.74.{}.{}"
fd = true
data_bitrate = 5_000_000
[device."knee"]
range = [-1.0, 1.0]
wire_stiffness = 0.7
wire_damping = 0.009
"""


def test_a_rig_with_can_fd_is_scanned_armed_stopped_and_replayed(tmp_path):
    """Other processes, over python-can's udp_multicast: frames of the run switch the rate, and its replay is equal."""

    def runtime(*words, start=subprocess.run, **how):
        command = [sys.executable, "-m", "runtime", *words]
        return start(command, cwd=tmp_path, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, **how)

    (tmp_path / "robot.py").write_text(FILE)
    (tmp_path / "lab.toml").write_text(RIG.format(os.getpid() % 250, os.getpid() // 250 % 250))
    (tmp_path / "classic.toml").write_text("\n".join((tmp_path / "lab.toml").read_text().splitlines()[:4]))
    plant = runtime("emulate", "robot.py", "--rig", "lab.toml", start=subprocess.Popen)
    try:
        while "Ctrl-C" not in (line := plant.stdout.readline()):
            assert line, "the emulator has ended"
        scanned = runtime("scan", "--rig", "lab.toml", timeout=60).stdout
        assert "id 1    moteus  0.000 rad" in scanned and "24.0 V, no fault" in scanned
        classic = runtime("scan", "--rig", "classic.toml", timeout=60).stdout
        assert "moteus" not in classic and "disable of drives in MIT mode" in classic, classic
        accepted = ("--accept", "knee.wire_stiffness", "--accept", "knee.wire_damping")
        ended = runtime("robot.py", "--rig", "lab.toml", "--duration", "0.5", "--yes", *accepted, timeout=60)
        assert ended.returncode == 0 and "confirmed by knee" in ended.stdout, ended.stdout
    finally:
        plant.terminate()
        plant.communicate(timeout=30)
    [recording] = (tmp_path / "recordings").glob("*.mcap")
    replayed = runtime("replay", str(recording), timeout=60)
    assert replayed.returncode == 0 and "are the same, bit for bit" in replayed.stdout, replayed.stdout
    runtime("convert", str(recording), "--to", "candump", timeout=60)
    lines = recording.with_suffix(".can.log").read_text()
    assert " 00008001##101000A" in lines and " 100##12804000A" in lines and "##0" not in lines


def test_its_load_is_that_of_can_fd():
    [load] = compile(robot()).loads
    assert load.frames == 400 and load.worst < 0.2


def converse(drive, dialogue):
    """Carry out a dialogue with a drive. Returns its result and the lines that it shows."""
    reply, replies, lines = None, [], []
    while True:
        try:
            step = dialogue.send(reply)
        except StopIteration as end:
            return end.value, lines
        reply = True
        if isinstance(step, Send):
            replies += [(i & 0x1FFFFFFF, bool(i & EXTENDED), data) for i, data in exchange(drive, step.frame)]
        elif isinstance(step, Listen):
            reply, replies = replies, []
        elif isinstance(step, Show):
            lines += step.lines


def test_scan_and_zero():
    drive = drive_of(can_id=9)
    drive["position"] = 0.4
    [(identifier, data)] = exchange(drive, protocol.query(9))
    [found] = answers([(identifier & 0x1FFFFFFF, True, data)], [1, 9], [])
    assert (found.can_id, found.enabled, found.voltage, found.block) == (9, False, 24.0, "Moteus")
    assert found.position == pytest.approx(0.4, abs=1e-4)
    assert converse(drive, FAMILY.set_up(Request(9, zero=True))) == (True, [
        "id 9, moteus, 0.400 rad, 24 V, fault: none", "  position -> 0 rad, until power-off", "done: id 9, 0.000 rad"
    ])  # fmt: skip
    assert converse(drive, FAMILY.set_up(Request(2)))[0] is None
    for wrong in (Request(9, new_id=3), Request(9, save=True), Request(9, writes=("a=1",)), Request(9, reads=("all",))):
        with pytest.raises(Rejected, match="moteus_tool"):
            FAMILY.check(wrong)


def test_a_board_needs_a_limit_and_unknown_ones_are_named():
    assert find("r4.11").name == find("moteus-r4").name == "moteus-r4"
    for parameters, words in (({"model": "n1"}, "limit="), ({"model": "moteus-q1", "limit": 1.0}, "did you mean")):
        with pytest.raises((ValueError, DiagramError), match=words):
            Moteus(**parameters)
    with pytest.raises((ValueError, DiagramError), match="disable"):
        Moteus("n1", limit=1.0, safe_stop="damp")


def test_stop_is_confirmed_in_modes_0_and_1_only():
    mode = Moteus("n1", limit=1.0).stop_reply().enabled
    assert [code for code in range(256) if mode.low + code * (mode.high - mode.low) / 255.0 <= 0.0] == [0, 1]
