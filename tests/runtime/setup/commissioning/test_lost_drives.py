"""Steps without torque on nodes that change or are shared while they are commissioned."""

import time

import can
import pytest

from blocks.actuators import CubeMars, CubeMarsServo
from graph import Diagram
from runtime.host.errors import FAULT
from runtime.robot.rig.file import parse
from runtime.robot.rig.records import OPEN
from runtime.setup.commissioning.guided.bench import Bench, Given, Lost, Result, Unmeasured
from runtime.setup.commissioning.guided.steps import STEPS, Step
from tests.runtime.runs import DISABLE, ENABLE, NOTHING, finished
from tests.runtime.setup.commissioning.nodes import Mit, Node, Nodes, Servo

pytestmark = pytest.mark.paced

RIG = '[bus.legs]\ninterface = "udp_multicast"\nchannel = "{}"\n'
STEP = {step.name: step for step in STEPS}


class TwoIds(Mit):
    """Two drives that obey one id, and of which one replies with another."""

    def hear(self, identifier, extended, data):
        own = super().hear(identifier, extended, data)
        return own + [(reply, extended, bytes([9]) + data[1:]) for reply, extended, data in own]


class Switched(Node):
    """A drive that leaves MIT mode for servo mode after some queries, or the reverse."""

    def __init__(self, first, then, after):
        super().__init__()
        self.each, self.then, self.since = first, then, time.monotonic() + after

    @property
    def period(self):
        return self.now.period

    @property
    def now(self):
        return self.each if time.monotonic() < self.since else self.then

    def speak(self):
        return self.now.speak() if self.now.period else []

    def hear(self, *frame):
        return self.now.hear(*frame)


class Bursts(Node):
    """Twenty error frames, once."""

    def start(self, channel):
        super().start(channel)
        for _ in range(20):
            self.bus.send(can.Message(is_error_frame=True, arbitration_id=0x80, data=bytes(8)))


def bench_of(channel, kind=CubeMars):
    with Diagram("bench", rate=200) as diagram:
        block = kind("AK80-9", bus="legs", can_id=3, range=(-6.0, 6.0), name="knee")
        block(**{next(each for each in block.inputs if each in ("torque_command", "current_command")): 0.0})
    return Bench("robot.py", parse("lab.toml", RIG.format(channel)), diagram), diagram["knee"]


@pytest.mark.hazard("H4i")
def test_a_second_id_in_the_replies_to_one_query_is_named():
    for node, found in ((TwoIds(3), ["two drives with one id"]), (Mit(3), [])):
        with Nodes(122, node) as nodes:
            bench, block = bench_of(nodes.channel)
            with bench:
                result = STEP["identity"].of(bench, block, Given(0.0))
                assert [name for name, _ in result.findings] == found, result


@pytest.mark.hazard("H4i")
@pytest.mark.parametrize("kind, drives", [(CubeMars, (Mit(3), Servo(3))), (CubeMarsServo, (Servo(3, error=0), Mit(3)))])
@pytest.mark.parametrize("step", ["bus", "state"])
def test_a_drive_whose_protocol_is_switched_after_identity_is_named(kind, drives, step):
    with Nodes(123, Switched(*drives, after=0.0)) as nodes:
        nodes.nodes[0].since = time.monotonic() + 60.0
        bench, block = bench_of(nodes.channel, kind)
        with bench:
            assert not STEP["identity"].of(bench, block, Given(0.0)).findings
            nodes.nodes[0].since = 0.0
            result = STEP[step].of(bench, block, Given(0.0))
            assert [name for name, _ in result.findings] == ["protocol"], result


@pytest.mark.hazard("H4i")
def test_a_burst_of_error_frames_in_any_step_is_named():
    with Nodes(124, Mit(3)) as nodes:
        bench, block = bench_of(nodes.channel)
        with bench:
            assert not STEP["state"].of(bench, block, Given(0.0)).findings
            with Nodes(124, Bursts()):
                result = STEP["state"].of(bench, block, Given(0.0))
            assert [name for name, _ in result.findings] == ["bus errors"], result


class Stalls:
    """Carries out a step in which the drive is silent for the first `times`, or the computer has ended the run."""

    def __init__(self, times, error=Lost):
        self.times, self.error, self.count = times, error, 0

    def __call__(self, bench, block, given):
        self.count += 1
        if self.count <= self.times:
            raise self.error("no reply for 0.3 s")
        return Result(["measured"])


@pytest.mark.hazard("H4i")
@pytest.mark.parametrize(
    "stalls, driven, names, count",
    [
        (Stalls(1), True, [], 2),
        (Stalls(2), True, ["silent"], 2),
        (Stalls(1), False, ["silent"], 1),
        (Stalls(1, Unmeasured), True, [], 1),
    ],
)
def test_a_step_under_torque_is_repeated_once_where_the_drive_responds_again(stalls, driven, names, count):
    with Nodes(126, Mit(3)) as nodes:
        bench, block = bench_of(nodes.channel)
        with bench:
            result = Step("torque", "", "", stalls, driven).of(bench, block, Given(0.0))
    assert [name for name, _ in result.findings] == names and stalls.count == count, result
    assert "no reply for 0.3 s" in result.says[0] and (result.verdict == OPEN) == (stalls.error is Unmeasured)


class SwitchedUnderTorque(Switched):
    """A drive that changes its protocol 0.3 s after it was first heard with a torque."""

    def hear(self, identifier, extended, data):
        if self.each is self.now and under_torque(extended, data):
            self.since = min(self.since, time.monotonic() + 0.3)
        return super().hear(identifier, extended, data)


def under_torque(extended, data):
    """Whether a frame commands a torque in MIT mode, or a current in servo mode."""
    return any(data) if extended else data.hex().upper() not in (NOTHING, ENABLE, DISABLE)


@pytest.mark.soak  # ten seconds of stop frames that nobody confirms
@pytest.mark.hazard("H4i")
@pytest.mark.parametrize("words, drives", [((), (Mit(3), Servo(3))), (("--servo",), (Servo(3, error=0), Mit(3)))])
def test_a_drive_whose_protocol_is_switched_under_torque_ends_the_run_and_receives_the_stop(words, drives, tmp_path):
    drive = SwitchedUnderTorque(*drives, after=60.0)
    with Nodes(125, drive) as nodes:
        words = "3", "--model", "AK80-9", *words, *nodes.words, "--torque", "0.6", "--duration", "20", "--yes"
        process = finished("move", *words, "--no-record", cwd=tmp_path)
    shown = process.stderr
    assert process.returncode == FAULT and "no reply for longer than its" in shown, shown
    assert "stop NOT confirmed" in shown and "its frames continue at a falling rate" in shown, shown
    assert not any(under_torque(*frame) for _, *frame in drive.heard[-5:])
