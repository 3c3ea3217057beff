"""A bus over a socket. Most of it over a pair of sockets that carry struct can_frame: the same kernel, the same system
calls.

What only real CAN has (filters, error frames of a controller, interfaces that go down) is in tests/hardware.
"""

import errno
import gc
import os
import socket
import struct
import subprocess
import sys
import time
from contextlib import contextmanager

import pytest
from hypothesis import given
from hypothesis import strategies as st

from blocks.actuators import CubeMars
from blocks.actuators.mit_frames import DISABLE, ENABLE, NOTHING
from cext.bus.memory_bus import MemoryBus
from cext.bus.socketcan import SocketCan
from cext.memory.shared_state import RECORD_FRAME, SharedState
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Diagram, compile
from runtime.robot.emulation.priority import priority_of_loop
from tests.cext.rigs import FRAME, STOP, plant_of

pytestmark = pytest.mark.timing

CLASSIC, FLEXIBLE = struct.Struct("=IB3x8s"), struct.Struct("=IBB2x64s")
EXTENDED, ERROR = 0x80000000, 0x20000000
BUS_OFF, RESTARTED, CONTROLLER = 0x040, 0x100, 0x004  # classes of error frames, and what byte 1 says of the controller
WARNING, PASSIVE, ACTIVE, OVERFLOW = 0x08, 0x20, 0x40, 0x01
SO_TIMESTAMPNS = 35
ANSWER = bytes([1, 0x80, 0, 0x80, 0x08, 0, 70, 0])  # of the drive with id 1


def classic(identifier, data=b"", length=None):
    return CLASSIC.pack(identifier, len(data) if length is None else length, data)


def error_frame(kind, says=0):
    return classic(ERROR | kind, bytes([0, says, 0, 0, 0, 0, 0, 0]))


class Wire:
    """Two sockets: `can` for the robot, `far` for whoever is at the other end."""

    def __init__(self, **options):
        self.near, self.far = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.stamp(True)
        self.far.setblocking(False)
        self.can = SocketCan(self.near, **options)

    def stamp(self, wanted):
        """Whether the kernel stamps what comes from now on."""
        self.near.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, wanted)

    @property
    def end(self):
        return self.can.end

    def heard(self, calls=70):
        """What the robot's end takes, one frame a call: a call that meets something else than a frame takes none."""
        return [frame for _ in range(calls) for frame in self.end.receive(1)]

    def said(self):
        """(id, data) of every frame that has come out at the other end."""
        frames = []
        while True:
            try:
                identifier, length, data = CLASSIC.unpack(self.far.recv(100))
            except BlockingIOError:
                return frames
            frames.append((identifier, data[:length]))


# Frames


def test_frames_pass_both_ways_through_the_kernel():
    wire = Wire()
    assert wire.end.send(0x123, b"\x01\x02\x03") and wire.end.send(0x12345, b"12345678", extended=True)
    assert wire.said() == [(0x123, b"\x01\x02\x03"), (EXTENDED | 0x12345, b"12345678")]
    wire.far.send(classic(0x7FF, b"\xff"))
    wire.far.send(classic(EXTENDED | 0x1FFFFFFF))
    assert [frame[:3] for frame in wire.heard()] == [(0x7FF, False, b"\xff"), (0x1FFFFFFF, True, b"")]
    assert wire.heard() == [] and wire.can.trouble is None and set(wire.can.counts.values()) == {0}


@given(st.lists(st.tuples(st.booleans(), st.integers(0, 0x7FF), st.binary(max_size=64)), max_size=40))
def test_sent_frames_arrive_once_in_order_on_fd_bus(frames):
    near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    one, other = SocketCan(near, fd=True), SocketCan(far, fd=True)
    for extended, identifier, data in frames:
        assert one.end.send(identifier, data, extended)
    assert [(extended, identifier, data) for identifier, extended, data, _ in other.end.receive()] == frames


def test_only_frames_over_eight_bytes_are_sent_as_fd():
    wire = Wire(fd=True)
    wire.end.send(5, bytes(range(12)))
    wire.end.send(6, b"abc")
    assert FLEXIBLE.unpack(wire.far.recv(100))[1:3] == (12, 0) and len(wire.far.recv(100)) == CLASSIC.size
    switching = Wire(fd=True, switching=True)
    switching.end.send(5, bytes(range(12)))
    switching.end.send(6, b"abc")
    assert FLEXIBLE.unpack(switching.far.recv(100))[1:3] == (12, 1) and len(switching.far.recv(100)) == CLASSIC.size


@pytest.mark.parametrize(
    "spoilt",
    [
        b"",
        b"\x01",
        classic(1, ANSWER)[:-1],
        classic(1, ANSWER) + b"\x00",
        classic(1, ANSWER, length=9),
        classic(1, ANSWER, length=255),
        FLEXIBLE.pack(1, 8, 0, ANSWER),
        bytes(3000),
    ],
    ids=["empty", "one byte", "short", "long", "length 9", "length 255", "FD on a bus without", "huge"],
)
def test_invalid_frame_is_counted_and_ignored(spoilt):
    wire = Wire()
    for datagram in (spoilt, classic(1, ANSWER), spoilt, classic(2, b"x")):
        wire.far.send(datagram)
    assert [frame[:3] for frame in wire.heard()] == [(1, False, ANSWER), (2, False, b"x")]
    assert wire.can.counts["corrupt"] == 2 and wire.can.trouble is None


def test_fd_length_beyond_64_is_invalid():
    wire = Wire(fd=True)
    for length in (64, 65, 255):
        wire.far.send(FLEXIBLE.pack(1, length, 0, bytes(64)))
    assert [len(frame[2]) for frame in wire.heard()] == [64] and wire.can.counts["corrupt"] == 2


def test_a_bus_end_keeps_its_bus_alive():
    wire = Wire()
    end = wire.end
    del wire.can
    gc.collect()
    wire.far.send(classic(3, b"x"))
    assert [frame[:3] for frame in end.receive()] == [(3, False, b"x")]


# Time


def test_a_frame_has_the_time_at_which_it_arrived_not_that_at_which_it_was_read():
    wire = Wire()
    began = time.monotonic_ns()
    wire.can.begin(began)
    sent = []
    for number in range(3):
        sent.append(time.monotonic_ns() - began)
        wire.far.send(classic(number))
        time.sleep(0.005)  # the kernel's clock cannot be made virtual
    assert [frame[3] for frame in wire.heard()] == pytest.approx(sent, abs=2e6)  # ns; 5 ms lie between them


def test_frame_times_lie_between_the_previous_and_the_present_read():
    wire = Wire()
    wire.can.begin(began := time.monotonic_ns())
    for number in range(50):
        before = time.monotonic_ns() - began
        wire.end.receive(1)
        wire.far.send(classic(number))
        [(*_, at)] = wire.end.receive(1)
        assert before <= at <= time.monotonic_ns() - began


def test_frame_received_before_run_start_has_time_zero():
    wire = Wire()
    wire.can.begin(time.monotonic_ns() + 20_000_000)  # as a run begins: a period ahead
    wire.far.send(classic(1))
    time.sleep(0.03)
    [(*_, at)] = wire.end.receive(1)
    assert at == 0


def test_a_frame_without_a_time_stamp_has_the_time_of_reading():
    wire = Wire()
    wire.can.begin(began := time.monotonic_ns())
    for stamped in (False, True):
        wire.stamp(stamped)
        wire.end.receive(1)
        before = time.monotonic_ns() - began
        wire.far.send(classic(1))
        between = time.monotonic_ns() - began
        [(*_, at)] = wire.end.receive(1)
        assert (before <= at <= between) if stamped else (between <= at <= time.monotonic_ns() - began)


# Full queues, failures


def test_full_queue_refuses_and_counts_frames_until_drained():
    wire = Wire(queue_full_limit=1000)
    taken = 0
    while wire.end.send(1, bytes([taken % 256])):
        taken += 1
    assert taken > 8 and not wire.end.send(1, b"") and wire.can.counts["refused"] == 2 and wire.can.trouble is None
    assert wire.said() == [(1, bytes([number % 256])) for number in range(taken)]
    assert wire.end.send(1, b"again") and wire.said() == [(1, b"again")]


def test_queue_full_beyond_limit_is_reported_once_as_failure():
    wire = Wire(queue_full_limit=3)
    while wire.end.send(1, b""):
        pass
    told = []
    for _tick in range(6):  # a tick receives, then sends
        wire.end.receive()
        told.append(wire.can.trouble)
        wire.end.send(1, b"")
    assert told == [None, None, "full", "full", "full", "full"]
    wire.said()
    assert wire.end.send(1, b"stop")  # the safe stop goes on trying
    wire.can.begin(0)
    assert wire.can.trouble is None and wire.can.counts["refused"] == 0


def test_a_temporarily_full_queue_is_not_a_failure():
    wire = Wire(queue_full_limit=3)
    for _ in range(5):
        while wire.end.send(1, b""):
            pass
        wire.end.receive()
        assert not wire.end.send(1, b"")
        wire.said()
        wire.end.receive()
        assert wire.end.send(1, b"")
        wire.end.receive()
    assert wire.can.trouble is None


def test_closed_end_is_a_failure_with_errno_and_no_signal():
    wire = Wire()
    wire.far.close()
    assert not wire.end.send(1, b"x") and wire.can.trouble in (
        errno.ECONNREFUSED,
        errno.ENOTCONN,
        errno.ECONNRESET,
        errno.EPIPE,
    )


# What a controller says of itself


def test_error_frames_are_delivered_and_update_state():
    wire = Wire()
    states = []
    for frame in (
        error_frame(CONTROLLER, WARNING),
        error_frame(CONTROLLER, PASSIVE),
        error_frame(CONTROLLER, ACTIVE),
        error_frame(CONTROLLER, OVERFLOW),
        error_frame(0x20),
    ):
        wire.far.send(frame)
        assert len(wire.heard()) == 1
        states.append(wire.can.state)
    assert states == ["warning", "passive", "active", "active", "active"] and wire.can.worst == "passive"
    assert wire.can.counts["errors"] == 5 and wire.can.counts["overflows"] == 1 and wire.can.trouble is None


@pytest.mark.hazard("H7a")
def test_bus_off_fails_next_send_and_stop_keeps_trying():
    wire = Wire()
    wire.far.send(error_frame(BUS_OFF))
    assert len(wire.heard(1)) == 1 and (wire.can.trouble, wire.can.state) == ("bus-off", "off")  # it is recorded first
    assert not wire.end.send(1, b"torque") and wire.said() == []
    assert wire.end.send(1, b"stop") and wire.said() == [(1, b"stop")]
    wire.far.send(error_frame(RESTARTED))
    wire.heard()
    assert (wire.can.state, wire.can.worst, wire.can.trouble) == ("active", "off", "bus-off")


def test_bus_off_on_receive_only_bus_fails_next_read():
    wire = Wire()
    wire.far.send(error_frame(BUS_OFF))
    wire.far.send(classic(1, ANSWER))
    assert [len(wire.heard(1)) for _ in range(4)] == [1, 0, 1, 0]  # the frame, the failure, then all as before


def test_bus_state_persists_and_error_count_restarts_with_each_run():
    wire = Wire()
    wire.far.send(error_frame(CONTROLLER, PASSIVE))
    wire.heard()
    wire.can.begin(0)
    assert wire.can.worst == "passive" and wire.can.counts["errors"] == 0  # it still is
    wire.far.send(error_frame(CONTROLLER, ACTIVE))
    wire.heard()
    wire.can.begin(0)
    assert wire.can.worst == "active"


# Whole runs, in real time: drives answer from the other end of each pair


class Robot:
    """Drives with ids 1, 2, ... each on a wire of its own. far : numbers of those that are emulated at the other ends
    of their wires
    """

    def __init__(self, drives=1, *, far=(1,)):
        with Diagram("robot", rate=200) as robot:
            for number in range(1, drives + 1):
                CubeMars("AK10-9-V2.0", bus=f"bus{number}", can_id=number, name=f"knee{number}", timeout=0.0)(
                    torque_command=1.0
                )
        schedule = compile(robot)
        self.wires = {name: Wire() for name in schedule.buses}
        self.control = Program(schedule, [wire.end for wire in self.wires.values()])
        plant = None
        if far:
            model = compile(plant_of(robot, substeps=1))
            self.far = [
                SocketCan(self.wires[f"bus{number}"].far) if number in far else None for number in range(1, drives + 1)
            ]
            plant = Program(model, [MemoryBus().device if can is None else can.end for can in self.far])
        self.shared = SharedState(1 << 22)
        self.executor = Executor(self.control, 200, plant=plant, shared=self.shared)

    def run(self, ticks):
        with priority_of_loop():  # no load of a computer delays a tick
            outcome = self.executor.run(ticks, fade=0.0)
        self.frames = [FRAME.unpack(record) for kind, record in self.shared.drain(1 << 30) if kind == RECORD_FRAME]
        return outcome

    def sent(self, bus=0):
        """Data of all frames that went out on a bus, as they were recorded."""
        return [data[:length] for _, _, length, _, number, ours, data in self.frames if ours and number == bus]


@contextmanager
def far_end(robot, script):
    """Another process at the far end of the first wire."""
    fd = robot.wires["bus1"].far.fileno()
    process = subprocess.Popen([sys.executable, "-S", "-E", "-c", script, str(fd)], pass_fds=[fd])
    try:
        yield
    finally:
        process.kill()
        process.wait(10)


def test_a_drive_behind_a_socket_is_armed_runs_and_stops():
    robot = Robot()
    outcome = robot.run(40)
    assert (outcome.status, outcome.tick, outcome.unconfirmed) == ("ok", 39, ())
    sent = robot.sent()
    assert sent[:2] == [ENABLE, NOTHING] and sent[-2:] == STOP
    assert len([data for data in sent if data not in (ENABLE, NOTHING, DISABLE)]) == robot.shared.statistics()["ticks"]
    frames = robot.shared.statistics()["frames"]
    assert frames["sent"] == len(sent) and frames["foreign"] == frames["malformed"] == 0 and frames["received"] >= 40


def test_a_torque_of_a_tick_is_not_sent_on_a_bus_that_is_off_and_the_stop_is():
    robot = Robot(far=())
    with far_end(robot, BUS_OFF_SCRIPT):
        outcome = robot.run(400)
    assert (outcome.status, outcome.culprit) == ("bus error", "bus1") and outcome.tick < 399
    received = [index for index, frame in enumerate(robot.frames) if not frame[5] and frame[1] == ERROR | BUS_OFF]
    behind = [data[:length] for _, _, length, _, _, ours, data in robot.frames[received[0] + 1 :] if ours]
    assert len(received) == 1 and behind[-2:] == STOP and set(behind) == set(STOP)  # no torque, in that tick or after


# Answers what arms the drive and 20 commands, then says that the bus is off, and takes the rest.
BUS_OFF_SCRIPT = f"""
import socket, sys
wire = socket.socket(fileno=int(sys.argv[1]))
wire.settimeout(2)
for number in range(24):
    wire.recv(100)
    wire.send({classic(1, ANSWER)!r})
wire.send({error_frame(BUS_OFF)!r})
"""


@pytest.mark.hazard("H7b")
def test_failed_bus_does_not_block_confirmed_stop_of_others():
    robot = Robot(2, far=(2,))
    with far_end(robot, BUS_OFF_SCRIPT):
        outcome = robot.run(400)
    assert (outcome.status, outcome.culprit, outcome.unconfirmed) == ("bus error", "bus1", ("knee1",))
    assert robot.sent(1)[-2:] == STOP and robot.sent(1).count(DISABLE) >= 1


def test_an_unreadable_bus_does_not_prevent_a_confirmed_stop_on_other_buses():
    robot = Robot(2, far=(2,))
    with open(os.devnull) as nothing:
        os.dup2(nothing.fileno(), robot.wires["bus1"].near.fileno())
    outcome = robot.run(40)
    assert (outcome.status, outcome.culprit, outcome.unconfirmed) == ("bus error", "bus1", ("knee1",))
    assert robot.wires["bus1"].can.trouble == errno.ENOTSOCK


def test_a_second_run_over_the_same_bus_starts_fresh():
    robot = Robot()
    wire = robot.wires["bus1"]
    for frame in (error_frame(BUS_OFF), classic(1, ANSWER), classic(9)):  # that came before anything was asked
        robot.far[0].end.send(*struct.unpack("=I", frame[:4]), frame[8:])
    assert (robot.run(5).status, wire.can.state) == ("bus error", "off")  # it still is
    robot.far[0].end.send(ERROR | RESTARTED, bytes(8))
    outcome = robot.run(5)
    assert (outcome.status, wire.can.worst) == ("ok", "active") and robot.sent()[:2] == [ENABLE, NOTHING]
    assert robot.shared.statistics()["frames"]["foreign"] == 0


def test_blocked_queue_ends_run_and_only_accepted_frames_count_as_sent():
    robot = Robot(far=())
    wire = robot.wires["bus1"]
    with far_end(robot, SILENT_SCRIPT):
        outcome = robot.run(2000)
    assert (outcome.status, outcome.culprit, wire.can.trouble) == ("bus error", "bus1", "full")
    frames = robot.shared.statistics()["frames"]
    assert frames["sent"] == len(robot.sent()) and wire.can.counts["refused"] >= 10


# Answers once, and is never heard of again.
SILENT_SCRIPT = f"""
import socket, sys
wire = socket.socket(fileno=int(sys.argv[1]))
wire.settimeout(2)
wire.recv(100)
wire.send({classic(1, ANSWER)!r})
wire.send({classic(1, ANSWER)!r})
"""


@pytest.mark.hazard("H7c")
def test_a_node_that_floods_the_bus_does_not_delay_a_tick():
    robot = Robot(far=())
    with far_end(robot, BABBLING_SCRIPT):
        outcome = robot.run(60)
    statistics = robot.shared.statistics()
    assert outcome.status == "ok" and statistics["frames"]["foreign"] > 60 * 32  # there was always more to read
    assert statistics["frames"]["received"] <= 64 * (statistics["ticks"] + 250)
    assert statistics["execution"]["p50"] < 0.001  # s, of a period of 5 ms
    # nothing of longer frames before
    assert not any(any(data[length:]) for _, _, length, _, _, _, data in robot.frames)


# Answers what it is told, and sends somebody else's frames as fast as it can.
BABBLING_SCRIPT = f"""
import socket, sys
wire = socket.socket(fileno=int(sys.argv[1]))
wire.setblocking(False)
while True:
    for _ in range(100):
        try:
            wire.send({classic(0x555, b"babble")!r})
        except BlockingIOError:
            break
    try:
        wire.recv(100)
    except BlockingIOError:
        continue
    wire.setblocking(True)
    wire.send({classic(1, ANSWER)!r})
    wire.setblocking(False)
"""
