"""Caps of a subject file on a real bus: each way to exceed them, with the frames on the wires as the judge."""

import datetime
import json
import select
import signal
import threading
import time

import pytest

from runtime.record.analysis.trial import Trial
from runtime.robot.rig.records import Record, StepRecord
from runtime.robot.rig.records import write as write_record
from tests.blocks.actuators import reference
from tests.runtime.robot.guardian.bus import Bus, is_torque
from tests.runtime.robot.guardian.drives import open_bus
from tests.runtime.runs import AK10_9, NOTHING, TORQUE_STEP, finished, started, write
from tests.soaking import soaked

pytestmark = pytest.mark.paced

ANGLE = reference.read_reply(AK10_9, reference.reply(AK10_9, 1, 0.1, 0.0, 0.0, 30.0, 0))[1]  # rad, as it is read
CAP = 1.5  # N·m; the diagram commands more, and its own limits are those of the peak, 48 N·m
SUBJECT = f"""
version = 1
id = "S03"
signed_by = "A. Investigator"
date = 2026-11-27
reason = "first session"

[joint."*/knee"]
torque = {CAP}
"""
ROBOT = '''
import math

from msgspec.structs import replace

from blocks.actuators import CubeMars
from blocks.limiters import TorqueLimiter
from blocks.recorders import CsvRecorder
from blocks.safety import Rearm
from cext.kernels.devices.cubemars import mit as kernels
from graph import Block, Diagram, Live, Memory, Output, subsystem


class Law(Block):
    """A torque that rises to 40 N·m, and requests to arm again twice a second."""

    torque = Output("N·m")
    again = Output("1", dtype=bool)

    def step(self, t, tick):
        return 40.0 * math.sin(3.0 * t), tick % 100 > 50


{drive}

with Diagram("knees", rate=200) as diagram:
    law = Law(name="law")()
    for side, can_id in (("left", 1), ("right", 2)):
        with subsystem(side):
            knee = CubeMars("AK10-9-V2.0", "legs", can_id, "peak", range=(-12.5, 12.5), wake_shift=0.0, name="knee",
                            timeout=1.0, rms_mode="silent")
            limited = TorqueLimiter(limit=Live(10.0, max=40.0), slew=1e6, name="limiter")(law.torque)
            knee(torque_command=limited{more})
    Rearm(name="rearm")(law.again)
    CsvRecorder()
diagram.caps = {{}}
'''
# states larger limits than it was given, wherever it can
LIAR = """
class CubeMars(CubeMars):
    caps = property(lambda self: None, lambda self, value: None)

    def find_limit(self):
        return 48.0

    def configure(self):
        super().configure()
        self.limits = (*self.limits[:4], 48.0, 48.0, 1.0)

    def watched(self):
        watch = super().watched()
        return replace(watch, limit=48.0, motion=replace(watch.motion, limit=48.0))
"""
# lets its kernel read its limits from another place than the one that the run writes
ROGUE = """
class CubeMars(CubeMars):
    freedom = Memory((12.5, 50.0, 500.0, 5.0, 48.0, 48.0, 1.0))
    encode = kernels.encode.renamed(limits="freedom")
"""
# has nothing monitored
UNWATCHED = """
class CubeMars(CubeMars):
    def watched(self):
        return replace(super().watched(), motion=None)
"""
STIFF = ", position_command=3.0, stiffness_command=200.0, damping_command=2.0"


@pytest.fixture
def bus(tmp_path):
    write(tmp_path, SUBJECT, "subject.toml")
    with Bus(tmp_path, number=61) as bus:
        yield bus


def start(bus, drive="", more="", *words):
    robot = write(bus.folder, ROBOT.format(drive=drive, more=more))
    options = ("--subject", "subject.toml", "--yes", "--stop-for", "0.2", "--record", "here")
    words = ("--set", "*/knee.limit=peak", "--accept=left/knee.record", "--accept=right/knee.record", *words)
    bus.runs.append(started(robot, "--rig", bus.rig, *options, *words, cwd=bus.folder))
    return bus.runs[-1]


def ended(bus, process, number=None):
    """Standard output and error of a run that has been sent a signal."""
    if number is not None:
        process.send_signal(number)
    out, err = process.communicate(timeout=20)
    bus.listen(0.3)
    return out + err


def highest(bus):
    """The largest torque of the law of any frame on the bus, at the angle of the drives of this test, N·m."""
    said = [bytes.fromhex(frame.data) for motor in (1, 2) for frame in bus.commands(motor, asking=True)]
    laws = [reference.read_command(AK10_9, data) for data in said if not data.startswith(b"\xff" * 7)]
    return max(abs(law["torque"] + law["stiffness"] * (law["position"] - ANGLE)) for law in laws)


@pytest.mark.hazard("H1l")
@pytest.mark.parametrize(("drive", "more"), soaked([(LIAR, ""), ("", STIFF)], but=[0]), ids=["liar", "stiff"])
def test_no_diagram_setting_live_change_or_rearming_raises_a_cap(bus, tmp_path, drive, more):
    """Peak torque by --set, a limiter that a live change raises to 40 N·m, and a second arming after a fault."""
    process = start(bus, drive, more)
    bus.await_torque()
    changed = finished("set", process.pid, "*/limiter.limit=40", cwd=tmp_path)
    bus.listen(0.5)
    bus.drives.send_signal(signal.SIGUSR1)  # a fault of the encoder, which is then gone
    bus.listen(0.3)
    bus.drives.send_signal(signal.SIGUSR2)
    again = time.time()
    assert bus.listen(10.0, is_torque), process.poll() is not None and process.communicate()
    bus.listen(1.0)
    assert any(frame.time > again for frame in filter(is_torque, bus.frames))
    words = ended(bus, process, signal.SIGINT)
    assert changed.returncode == 0 and process.returncode == 130, changed.stderr + words
    assert CAP - 3 * TORQUE_STEP < highest(bus) <= CAP
    [recording] = (tmp_path / "here").glob("*.mcap")
    about = Trial(recording).about["metadata"]["subject"]
    assert about["id"] == "S03" and about["joints"] == {"*/knee": {"torque": CAP}} and len(about["sha256"]) == 64
    assert b"A. Investigator" not in recording.read_bytes()


@pytest.mark.hazard("H1l")
def test_no_proposal_of_an_optimisation_raises_a_cap(bus, tmp_path):
    """Proposals of 2 to 40 N·m, above the cap, and a live change after them; bounds above a cap of the parameter."""
    robot = write(tmp_path, ROBOT.format(drive=LIAR, more=""))
    write(tmp_path, SUBJECT + '[assistance]\n"*/limiter.limit" = 5.0\n', "assisted.toml")
    options = f"--rig {bus.rig} --yes --no-confirm --set */knee.limit=peak --stop-for 0.2 --record here "
    options += "--accept=left/knee.record --accept=right/knee.record --over limiter.limit=2:40 --reference 0 "
    options += "--cost signal:left/knee.torque_sent --settle 0.1 --measure 0.4 --generations 1 --population 3 "
    options = f"{options}--optimiser random".split()
    refused = finished("optimise", robot, *options, "--subject", "assisted.toml", cwd=tmp_path)
    assert refused.returncode == 2 and "live range of left/limiter.limit" in refused.stderr, refused.stderr
    assert "0 to 5 N·m" in refused.stderr, refused.stderr
    bus.listen(0.1)
    assert not bus.commands(1) and not bus.commands(2)
    process = started("optimise", robot, *options, "--subject", "subject.toml", cwd=tmp_path)
    bus.runs.append(process)
    bus.await_torque()
    until = time.monotonic() + 20.0
    while not any('"finished": true' in path.read_text() for path in (tmp_path / "here").glob("*.optimisation.json")):
        assert time.monotonic() < until and process.poll() is None, process.communicate()
        bus.listen(0.2)
    changed = finished("set", process.pid, "*/limiter.limit=40", cwd=tmp_path)
    bus.listen(0.5)
    words = ended(bus, process, signal.SIGINT)
    assert changed.returncode == 0 and process.returncode == 130, changed.stderr + words
    [path] = (tmp_path / "here").glob("*.optimisation.json")
    told = json.loads(path.read_text())["optimiser"]["told"]
    assert len(told) == 3 and all(values["limiter.limit"] > CAP for _, values, _ in told), (told, words)
    assert CAP - 3 * TORQUE_STEP < highest(bus) <= CAP


@pytest.mark.hazard("H1m")
def test_the_guardian_withholds_a_command_above_the_cap_and_stops_the_motors(bus):
    process = start(bus, ROGUE)
    words = ended(bus, process)
    assert process.returncode == 3 and "commanded torque of" in words and "of subject S03 (subject.toml)" in words, (
        words
    )
    assert highest(bus) <= CAP + TORQUE_STEP
    assert bus.stopped_after(0.0) and bus.commands(1)[-1].data != NOTHING


@pytest.mark.hazard("H1m")
def test_the_guardian_ends_a_run_whose_drive_gives_more_than_the_cap(tmp_path):
    write(tmp_path, SUBJECT, "subject.toml")
    with Bus(tmp_path, number=62, answering=False) as bus:
        node, excessive, over = open_bus(bus.channel), threading.Event(), threading.Event()

        def drives():
            sent = set()
            while not over.is_set():
                if not select.select([node], [], [], 0.05)[0]:
                    continue
                heard = node.recv()
                data, motor = bytes(heard.data), heard.arbitration_id
                if (motor, data) in sent or motor not in (1, 2):
                    continue
                reply = bytes(reference.held_reply(AK10_9, motor, 0.1, data))
                if excessive.is_set() and motor == 1 and data[:7] != b"\xff" * 7 and data.hex().upper() != NOTHING:
                    reply = bytes(reference.reply(AK10_9, motor, 0.1, 0.0, 9.0, 30.0, 0))
                sent.add((motor, reply))
                node.send(type(heard)(arbitration_id=motor, is_extended_id=False, data=reply))

        thread = threading.Thread(target=drives)
        thread.start()
        try:
            process = start(bus, UNWATCHED)
            bus.await_torque()
            excessive.set()
            words = ended(bus, process)
        finally:
            over.set()
            thread.join()
            node.shutdown()
    assert process.returncode == 3 and "measured torque of left/knee, 9" in words, words
    assert highest(bus) <= CAP


@pytest.mark.hazard("H1o")
def test_a_subject_asks_for_records_of_commissioning_that_fit(tmp_path):
    rig = write(tmp_path, '[bus.legs]\ninterface = "udp_multicast"\nchannel = "239.9.8.7"\n', "lab.toml")
    write(tmp_path, SUBJECT, "subject.toml")
    path = write(tmp_path, ROBOT.format(drive="", more=""))
    words = ("--rig", rig, "--subject", "subject.toml", "--yes", "--no-record")

    def record(device, **changes):
        own = {"serial": device[:1], "device": device, "block": "CubeMars", "model": "AK10-9-V2.0"}
        own["steps"] = {name: StepRecord("2026-11-27 14:02", "agrees") for name in ("identity", "bus", "state", "turn")}
        own["settings"] = {"can_id": 1 + (device == "right/knee"), "wake_shift": 0.0}
        signed = {"name": "E. Person", "date": str(datetime.date.today())}
        write_record(rig, Record(**own | {"signed": signed} | changes))

    run = finished(path, *words, cwd=tmp_path)
    assert run.returncode == 2 and "left/knee: subject S03 (subject.toml) asks for its record" in run.stderr, run.stderr
    assert "which is missing" in run.stderr and "--accept right/knee.record" in run.stderr
    old = {"signed": {"name": "E. Person", "date": "2020-01-01"}}
    record("left/knee", **old)
    record("right/knee", model="AK80-9", settings={"can_id": 7})
    run = finished(path, *words, cwd=tmp_path)
    for reason in ("days old", "is of a CubeMars AK80-9", "was measured with can_id = 7"):
        assert reason in run.stderr, run.stderr
    step = StepRecord("2026-11-27 14:02", "differs", findings=[("direction", "it turns the other way")])
    record("left/knee")
    record("right/knee", steps={"turn": step})
    run = finished(path, *words, cwd=tmp_path)
    assert "left/knee" not in run.stderr and "found: it turns the other way" in run.stderr
