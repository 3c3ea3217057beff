"""What the guardian carries is checked against the fence frame by frame: behind it nothing but the frames of the safe
stop goes out.
"""

import errno
import itertools
import json
import math
import mmap
import os
import signal
import struct
import time
from types import SimpleNamespace

import pytest

from blocks.actuators import CubeMars
from blocks.limiters import TorqueLimiter
from cext.memory.shared_state import SharedState
from cext.ring.rings import Line, Lines
from cext.safety.thresholds import HANG_REPORT_DELAY
from graph import Block, Diagram, Input, Output, compile
from runtime.robot.guardian import interfaces, plan
from runtime.robot.guardian.process import Guardian
from tests.cext.rigs import one_drive

ENABLE, NOTHING, DISABLE, TORQUE = (
    bytes.fromhex(text) for text in ("FFFFFFFFFFFFFFFC", "7FFF7FF0000007FF", "FFFFFFFFFFFFFFFD", "7FFF7FF00000083E")
)
STOP = [NOTHING, DISABLE]


class Log:
    """A wire that keeps what is sent, and calls something whenever a frame goes out."""

    polled = True

    def __init__(self):
        self.sent, self.counts, self.trouble, self.then = [], {}, None, lambda data: None

    def send(self, identifier, data):
        self.sent.append(data)
        self.then(data)
        return True

    def fileno(self):
        return None

    def receive(self):
        return []

    def close(self):
        pass


class Carrying:
    """A guardian in this process, with two buses that it carries and a motor on each; and the loop's ends of them."""

    def __init__(self, shared=None):
        self.shared, self.lines = shared or SharedState(1 << 12), Lines(2)
        self.ends = [Line(self.lines, number).end for number in range(2)]
        self.wires = [Log(), Log()]
        read, self.orders = os.pipe()
        with Diagram("robot", rate=200) as robot:
            for bus in range(2):
                CubeMars("AK80-9", can_id=1, bus=f"{bus}", name=f"{bus}")(torque_command=0.0)
        planned = json.loads(json.dumps(plan([], compile(robot), None)))
        planned |= {"buses": [{"name": f"{bus}", "line": bus} for bus in range(2)], "items": ["law"], "limit": 0.04}
        self.guardian = Guardian(self.shared, self.lines, -1, self.orders, read, planned)
        for bus, wire in enumerate(self.wires):
            self.guardian.interfaces.add(bus, wire)

    def queue(self, *frames):
        """The loop sends these, on both buses."""
        for end in self.ends:
            for data in frames:
                assert end.send(1, data)

    def receive(self, bus):
        self.guardian.interfaces.receive(bus, self.guardian.stop)

    def sent(self):
        return [wire.sent for wire in self.wires]


@pytest.fixture
def robot(monkeypatch):
    """Frames are received 1 µs after one another, however busy the machine is."""
    clock = itertools.count(time.monotonic_ns(), 1000)
    monkeypatch.setattr(interfaces, "time", SimpleNamespace(monotonic_ns=lambda: next(clock)))
    return Carrying()


def test_frames_before_the_fence_are_sent_in_order(robot):
    robot.queue(ENABLE, TORQUE, NOTHING, TORQUE)
    robot.guardian.carry()
    assert robot.sent() == [[ENABLE, TORQUE, NOTHING, TORQUE]] * 2


@pytest.mark.parametrize("after", range(1, 6))
def test_a_fence_that_is_raised_between_taking_frames_and_sending_them_holds_back_the_rest_on_every_bus(robot, after):
    """All have been taken out of their ring by then, of the first bus at least. The loop's own stop is behind them."""
    gone = []

    def count(data):
        gone.append(data)
        if len(gone) == after:
            robot.shared.raise_fence()
            robot.queue(*STOP)

    robot.wires[0].then = robot.wires[1].then = count
    robot.queue(*[TORQUE] * 3)
    for _ in range(3):
        robot.guardian.carry()
    first = min(after, 3)
    assert robot.sent() == [[TORQUE] * first + STOP, [TORQUE] * (after - first) + STOP]


@pytest.mark.parametrize("why", ["died", "hung", "stalled"])
def test_frames_queued_when_the_guardian_stops_the_motors_are_never_sent(robot, why):
    robot.queue(TORQUE, ENABLE, TORQUE)
    now = time.monotonic_ns()
    robot.guardian.begin_stop(why, 50_000_000, now)
    assert robot.shared.fenced and robot.sent() == [STOP, STOP]  # at once, before anything that waits
    robot.guardian.carry()
    robot.queue(TORQUE)  # a loop that had been stopped goes on
    robot.guardian.carry()
    assert robot.sent() == [STOP, STOP]
    assert [Line(robot.lines, number).counts["withheld"] for number in range(2)] == [4, 4]


def test_the_fence_is_up_and_the_stop_is_shown_before_its_first_frame():
    class Shown(SharedState):
        stops = False

        def show_stop(self, stops):
            self.stops = stops

    robot, fenced = Carrying(Shown(1 << 12)), []
    robot.wires[0].then = lambda data: fenced.append((robot.shared.fenced, robot.shared.stops))
    robot.guardian.begin_stop("died", 0, time.monotonic_ns())
    assert fenced == [(True, True)] * 2


def test_stop_repeats_until_both_drives_acknowledge_it(robot):
    answers = [(1, bytes.fromhex("017FFF7FF7FF4100"), time.monotonic_ns() + 10**12, 0)]
    robot.wires[0].receive = lambda: answers * 2  # they lie there when the stop begins: of the last torques
    robot.guardian.begin_stop("died", 0, time.monotonic_ns() + 10**11)  # so that no reply is late on a busy machine
    assert robot.guardian.stop.report()["confirmed"] == []
    robot.receive(0)  # these were on their way
    assert robot.guardian.stop.report()["confirmed"] == []
    stop = robot.guardian.stop
    stop.step(stop.due)
    robot.receive(0)
    stop.step(stop.due)  # no frame to the first, and none from it
    stop.step(stop.due)
    report = stop.report()
    assert (report["confirmed"], report["unconfirmed"], report["sent"]) == (["0"], ["1"], 12)
    robot.wires[0].receive, robot.wires[1].receive = list, lambda: answers
    for _ in range(2):
        robot.receive(1)  # one answer each time
    stop.step(stop.due)  # replies to one round alone are not enough
    for _ in range(2):
        robot.receive(1)
    robot.wires[1].receive = list
    for _ in range(2):
        assert not stop.over
        stop.step(stop.due)
    assert stop.over
    # the loop hears them, too
    assert [frame[:3] for frame in robot.ends[1].receive()] == [(1, False, answers[0][1])] * 4


def test_frames_queued_before_stop_reach_loop_before_stop_replies(robot):
    before = [[(1, b"\1 before", 0, 0)]]
    robot.wires[0].receive = lambda: before.pop() if before else []
    robot.wires[0].then = lambda data: before.append([(1, b"\1 after", 0, 0)])
    robot.guardian.begin_stop("died", 0, time.monotonic_ns())
    assert [frame[2] for frame in robot.ends[0].receive()] == [b"\1 before"]


def test_guardian_receives_on_loop_driven_bus_from_stop_on(robot):
    heard = {}
    for number, wire in enumerate(robot.wires):
        wire.listen = lambda replies, number=number: heard.update({number: replies})
    frames = robot.guardian.devices[1]["stop_reply"]["frames"]
    robot.guardian.buses[1]["line"] = None
    robot.guardian.begin_stop("died", 0, time.monotonic_ns())
    assert heard == {1: frames} and [1, 0xE00007FF, "01"] in frames


def test_interface_counters_and_failure_reach_loop_once(robot):
    line = Line(robot.lines, 1)
    robot.wires[1].counts, robot.wires[1].trouble = {"corrupt": 2}, (errno.ENODEV, "it is gone")
    for _ in range(2):
        robot.guardian.carry()
    line.end.receive()  # the loop hears of it
    assert line.counts["corrupt"] == 2 and line.trouble == errno.ENODEV and Line(robot.lines, 0).trouble is None


def test_interface_with_readiness_event_is_not_polled(robot):
    asked = []
    for number, wire in enumerate(robot.wires):
        wire.receive = lambda number=number: asked.append(number) or []
    read, write = os.pipe()
    robot.guardian.interfaces.close(0)
    robot.wires[0].fileno = lambda: read
    robot.guardian.interfaces.add(0, robot.wires[0])
    robot.guardian.interfaces.wait(None, None)
    assert asked == [1]
    os.write(write, b"frame")
    robot.guardian.interfaces.wait(None, None)
    assert asked == [1, 1, 0]


# Whether the loop is there


class Tells(Block):
    """Calls something in one tick."""

    u = Input("any")
    y = Output("N·m")

    def __init__(self, action, when, **options):
        self.action, self.when = action, when
        super().__init__(**options)

    def step(self, u, tick):
        if tick == self.when:
            self.action()
        return 1.0


def judged(look, tick=20):
    """A guardian that looks at a real loop in the middle of its run: `look(guardian, page)`. Returns it."""
    shared = SharedState(1 << 20)
    guardian = Carrying(shared).guardian
    rig = one_drive(
        lambda knee: TorqueLimiter(limit=5.0)(Tells(lambda: look(guardian, shared), tick)(knee.position)),
        options={"shared": shared},
    )
    rig.run(40)
    return guardian


def test_a_loop_that_ticked_within_the_limit_counts_as_alive():
    assert judged(lambda guardian, shared: guardian.check_loop(shared.beat + guardian.limit)).verdict is None


@pytest.mark.hazard("H8e")
def test_stalled_loop_is_stopped_and_its_last_tick_reported():
    guardian = judged(lambda guardian, shared: guardian.check_loop(shared.beat + guardian.limit + 1))
    assert (guardian.verdict["because"], guardian.verdict["state"], guardian.verdict["last_tick"]) == (
        "stalled",
        "running",
        19,
    )
    assert (
        guardian.verdict["silent"] == pytest.approx(0.04, abs=1e-6)
        and guardian.stuck_at is None
        and guardian.shared.fenced
    )


def damp(guardian):
    """Let the safe stop begin by damping."""
    for device in guardian.devices:
        device["damp"] = {
            "duration": 0.1,
            "round": 0.002,
            "acceleration": 500.0,
            "transit": 0.0,
            "velocity": None,
            "bands": [(math.inf, [(1, b"damp")])],
        }


@pytest.mark.parametrize("hold, closed", [(0.03, False), (60.0, True)])
def test_a_relay_that_may_have_dropped_since_the_newest_tick_is_not_closed_again(hold, closed):
    reader, line = os.pipe()
    os.set_blocking(reader, False)

    def look(guardian, shared):
        damp(guardian)
        guardian.relays = [{"descriptor": line, "gpio": False, "frames": ["01", "00"], "hold": hold}]
        time.sleep(guardian.limit * 1e-9 + 0.001)  # the relay has a clock of its own
        guardian.check_loop(time.monotonic_ns())

    judged(look)
    os.close(line)
    assert os.read(reader, 10) == (b"\1" if closed else b"")
    os.close(reader)


@pytest.mark.parametrize("tick, moving", [(0, False), (1, True)])
def test_a_joint_is_damped_first_from_its_first_torque_on(tick, moving):
    def look(guardian, shared):
        damp(guardian)
        guardian.check_loop(shared.beat + guardian.limit + 1)

    guardian = judged(look, tick)
    assert guardian.verdict["last_tick"] == tick - 1
    assert [wire.sent for wire in guardian.wires.values()] == [[b"damp"] if moving else STOP] * 2


HUNG, CRASHED, ASLEEP = 32, 36, 48  # bytes, of cext.memory.shared_state.SharedLayout


def write(shared, offset, number):
    """What the loop's watchdog, or its handler of a crash, writes there."""
    with mmap.mmap(shared.fd, 0) as memory:
        struct.pack_into("=i", memory, offset, number)


@pytest.mark.parametrize("item, block", [(1, "law"), (-1, "the tick")])
def test_a_hanging_step_is_reported_and_checked_again(item, block):
    asked = []

    def look(guardian, shared):
        write(shared, HUNG, item)
        asked.append(shared.beat)
        guardian.check_loop(shared.beat)

    guardian = judged(look)
    assert (guardian.verdict["because"], guardian.verdict["block"]) == (
        "hung",
        block,
    ) and "signal" not in guardian.verdict
    assert guardian.stuck_at == asked[0] + HANG_REPORT_DELAY


def suspend(shared, seconds):
    """Let the shared state show that the computer was suspended since the run began. shared : its file descriptor"""
    with mmap.mmap(shared, 0) as memory:
        [before] = struct.unpack_from("=q", memory, ASLEEP)
        struct.pack_into("=q", memory, ASLEEP, before - round(seconds * 1e9))


def crash(guardian, shared):
    write(shared, HUNG, 1)
    write(shared, CRASHED, signal.SIGSEGV)


@pytest.mark.parametrize(
    "deed, verdict",
    [
        (lambda guardian, shared: setattr(guardian, "dead", True), {"because": "died"}),
        (lambda guardian, shared: setattr(guardian, "cut_off", True), {"because": "cut off"}),
        (crash, {"because": "died", "block": "law", "signal": "SIGSEGV"}),
        (
            lambda guardian, shared: suspend(shared.fd, 3600.0),
            {"because": "suspended", "silent": pytest.approx(3600.0, abs=1)},
        ),
    ],
    ids=["exit", "closed pipe", "crash", "suspend"],
)
def test_drives_are_stopped_at_once_and_the_cause_reported(deed, verdict):
    def look(guardian, shared):
        deed(guardian, shared)
        guardian.check_loop(shared.beat)

    guardian = judged(look)
    assert {key: guardian.verdict[key] for key in verdict} == verdict
    assert guardian.stuck_at is None and guardian.shared.fenced
    assert [wire.sent for wire in guardian.wires.values()] == [STOP] * 2


def test_a_tick_that_begins_while_the_guardian_waits_for_a_processor_leaves_no_negative_silence():
    def look(guardian, page):
        guardian.dead = True
        guardian.check_loop(page.beat - 1_000_000)

    assert judged(look).verdict["silent"] == 0.0


def test_finished_loop_is_not_stopped():
    guardian = judged(lambda guardian, shared: None)
    guardian.gone = True
    guardian.check_loop(time.monotonic_ns() + 10 * guardian.limit)
    assert guardian.shared.state == "safe" and guardian.verdict is None


def test_the_end_of_a_second_stop_is_shown_like_that_of_the_first():
    """The guardian stopped a stalled loop, which then goes on, and whose own stop a drive does not confirm."""
    shown = []

    class Shown(SharedState):
        def show_stop(self, stops):
            shown.append(stops)

    guardian = Carrying(Shown(1 << 12)).guardian
    for because, begin in (("stalled", 0), ("unconfirmed", 1_000_000_000)):
        guardian.begin_stop(because, 50_000_000, begin)
        for now in (begin + 100_000_000, begin + 300_000_000):
            guardian._report_stop(guardian.stop, guardian.verdict, now)
    assert shown == [True, False] * 2


# A bus that the loop drives itself


def test_a_stop_is_not_repeated_without_a_send_that_had_begun_before_the_fence(robot):
    robot.guardian.begin_stop("stalled", 50_000_000, 0)
    stop = robot.guardian.stop
    robot.guardian.stop_again_if_due(1_000_000)
    assert robot.guardian.stop is stop and "again" not in robot.guardian.verdict


@pytest.mark.parametrize("end", ["goes on", "dies"])
def test_the_stop_is_repeated_after_a_send_that_had_begun_before_the_fence(end):
    """The loop is suspended between its check of the fence and its send for longer than a whole stop."""

    class Held(SharedState):
        sending = True

    shared = Held(1 << 12)
    robot = Carrying(shared)
    guardian, wire = robot.guardian, robot.wires[0]
    guardian.begin_stop("stalled", 50_000_000, 0)
    for now in range(0, 300_000_000, 5_000_000):
        guardian.stop.step(now)
    assert not guardian._is_over() and guardian.in_send
    guardian.released = guardian.reported = True
    assert not guardian._is_over(), "it stays until the loop has left the send"
    wire.sent.append(TORQUE)
    if end == "goes on":
        Held.sending = False
    else:
        guardian.dead = guardian.gone = True
    guardian.stop_again_if_due(400_000_000)
    assert wire.sent[-3:] == [TORQUE, *STOP] and not guardian.reported
    for now in range(405_000_000, 700_000_000, 5_000_000):
        guardian.stop.step(now)
    assert wire.sent[-2:] == STOP
    stop = guardian.stop
    guardian.stop_again_if_due(700_000_000)
    assert guardian.stop is stop, "once"
