"""GPIO lines of a real kernel, the simulated chip of its driver gpio-sim, through libgpiod's own package: levels,
edges, pulses, a stop.

On an emulated machine, where test_gpio_machine.py runs this file; its clock runs, but nothing there is fast.
"""

import os
import signal
import struct
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from blocks.actuators import CubeMars
from blocks.charge_pump import ChargePump
from blocks.gpio import EStopSwitch, GpioInput, SyncIn, SyncOut
from blocks.recorders import CsvRecorder
from cext.bus.memory_bus import MemoryBus
from cext.memory.shared_state import SharedState
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Diagram, StreamDevice, compile
from runtime.robot.guardian.relay import Relay
from runtime.robot.rig.errors import Refused
from runtime.robot.rig.gpio_line import open_line
from runtime.robot.rig.streams import StreamLines
from runtime.setup.commissioning import ports_inventory
from tests.blocks.running import player
from tests.cext.rigs import Rig, ends_in_the_safe_stop, plant_of
from tests.forking import fork

REQUIRED = "TICKWORK_REAL_GPIO"
pytestmark = [
    pytest.mark.soak,
    pytest.mark.skipif(not os.environ.get(REQUIRED), reason="needs the driver gpio-sim: on an emulated machine alone"),
]
CONFIG = Path("/sys/kernel/config/gpio-sim")
NAMES = ("STOP", "BUTTON", "MOCAP", "SYNC")
EVENT = struct.Struct("=QI36x")


class Chip:
    """Four lines by name. What is outside pulls them up or down; what the computer drives can be looked at."""

    def __init__(self):
        self.folder = CONFIG / "header"
        (self.folder / "bank").mkdir(parents=True)
        (self.folder / "bank/num_lines").write_text("4")
        for number, name in enumerate(NAMES):
            (self.folder / f"bank/line{number}").mkdir()
            (self.folder / f"bank/line{number}/name").write_text(name)
        self.live(True)
        chip = (self.folder / "bank/chip_name").read_text().strip()
        self.path = f"/dev/{chip}"
        self.lines = Path("/sys/devices/platform", (self.folder / "dev_name").read_text().strip(), chip)

    def live(self, whether):
        (self.folder / "live").write_text("1" if whether else "0")

    def pull(self, name, up):
        (self.lines / f"sim_gpio{NAMES.index(name)}/pull").write_text("pull-up" if up else "pull-down")

    def value(self, name):
        return (self.lines / f"sim_gpio{NAMES.index(name)}/value").read_text().strip() == "1"

    def close(self):
        if (self.folder / "live").read_text().strip() == "1":
            self.live(False)
        for number in range(len(NAMES)):
            (self.folder / f"bank/line{number}").rmdir()
        (self.folder / "bank").rmdir()
        self.folder.rmdir()


@pytest.fixture
def chip():
    chip = Chip()
    yield chip
    chip.close()


class RealLines(Rig):
    """A robot whose streams are real lines; its drives are emulated. As tests.cext.rigs.Rig has it, in real time."""

    def __init__(self, robot, plant=None):
        with robot:
            CsvRecorder()
        self.schedule = compile(robot)
        self.lines = StreamLines([block for block in robot if isinstance(block, StreamDevice)])
        assert not self.lines.problems, self.lines.problems
        memory = {name: MemoryBus() for name in self.schedule.buses if name not in self.lines.lines}
        ends = [memory[name].host if name in memory else self.lines.lines[name][1].end for name in self.schedule.buses]
        self.control, self.plant, substeps = Program(self.schedule, ends), None, 1
        if plant is not None:
            model = compile(plant)
            self.plant, substeps = (
                Program(model, [memory[name].device for name in model.buses]),
                round(plant.rate / robot.rate),
            )
        self.shared = SharedState(1 << 24)
        self.executor = Executor(
            self.control, self.schedule.rate, plant=self.plant, substeps=substeps, shared=self.shared, virtual=False
        )

    def run(self, ticks, meanwhile=lambda: None):
        """meanwhile : what happens outside, in a thread of its own."""
        outside = threading.Thread(target=meanwhile)
        self.lines.start(0)
        outside.start()
        try:
            return super().run(ticks)
        finally:
            outside.join()
            self.lines.close()


def at(chip, name, **parameters):
    return {"chip": chip.path, "pin": name, **parameters}


def test_edges_are_counted_and_timed_by_the_kernel(chip):
    chip.pull("MOCAP", True)
    with Diagram("robot", rate=50) as robot:
        SyncIn(name="mocap", **at(chip, "MOCAP"))
        GpioInput(name="button", debounce=0.3, **at(chip, "1"))
    rig, stamps = RealLines(robot), []

    def outside():
        time.sleep(0.3)
        for up in (False, True, False, True, False):  # faster than the tick
            before = time.monotonic()
            chip.pull("MOCAP", up)
            stamps.append((before, time.monotonic()))
            time.sleep(0.004)
        for up in (True, False, True):  # bounces, and stays
            chip.pull("BUTTON", up)

    outcome = rig.run(80, outside)
    assert outcome.status == "ok"
    assert rig["mocap.on"][0] == 1.0 and rig["mocap.known"][0] == 1.0  # its level as the run begins
    assert (rig["mocap.falls"][-1], rig["mocap.rises"][-1], rig["mocap.on"][-1], rig["mocap.missed"][-1]) == (
        3.0,
        2.0,
        0.0,
        0.0,
    )
    (rise_began, rise_ended), (fall_began, fall_ended) = stamps[3:]
    assert fall_began - rise_ended <= rig["mocap.fall_time"][-1] - rig["mocap.rise_time"][-1] <= fall_ended - rise_began
    assert (rig["button.rises"][-1], rig["button.falls"][-1], rig["button.on"][-1]) == (1.0, 0.0, 1.0)


def test_a_pulse_is_on_the_line_at_tick_0_and_on_request(chip):
    with Diagram("robot", rate=50) as robot:
        SyncOut(name="sync", duration=0.2, **at(chip, "SYNC"))(pulse=player([False] * 40 + [True, False], "1", bool))
    rig, seen = RealLines(robot), []

    def outside():
        deadline = time.monotonic() + 1.6
        while time.monotonic() < deadline:
            seen.append((time.monotonic(), chip.value("SYNC")))
            time.sleep(0.002)

    assert rig.run(70, outside).status == "ok"
    changes = [now for now, before in zip(seen[1:], seen) if now[1] != before[1]]
    assert [level for _, level in changes] == [True, False, True, False]
    assert np.diff([when for when, _ in changes]) == pytest.approx([0.2, 0.6, 0.2], abs=0.15)


def stopping(chip):
    """A knee that is told 1 N·m, and a switch that is not pressed."""
    with Diagram("robot", rate=200) as robot:
        CubeMars("AK10-9-V2.0", can_id=1, timeout=1.0, name="knee")(torque_command=1.0)
        EStopSwitch(name="stop", **at(chip, "STOP"))
    rig = RealLines(robot, plant_of(robot))
    assert chip.value("STOP")  # its own resistor pulls it up: an open contact
    chip.pull("STOP", False)
    return rig


def latencies(rig):
    """ms from the kernel's edge to the thread that reads it, and to the first frame of the safe stop, by the
    recording.
    """
    press = next(frame for frame in rig.frames if not frame.sent and len(frame.data) == EVENT.size)
    first = [frame for frame in rig.frames if frame.sent and frame.id == 1][-2]
    edge, _ = EVENT.unpack(press.data)
    return (press.time - edge) * 1e-6, (first.time - edge) * 1e-6


@pytest.mark.parametrize("how", ["pressed", "pressed for 2 ms", "unplugged"])
def test_a_stop_ends_the_run(chip, how):
    rig = stopping(chip)

    def press():
        time.sleep(0.8)
        if how == "unplugged":
            chip.live(False)
            return
        chip.pull("STOP", True)
        if how != "pressed":
            time.sleep(0.002)
            chip.pull("STOP", False)

    outcome = rig.run(1000, press)
    assert (outcome.status, outcome.culprit) == ("e-stop", "stop") and 20 < outcome.tick < 900
    assert len(rig.commands()) > 20 and ends_in_the_safe_stop(rig)
    if how != "unplugged":
        read, stopped = latencies(rig)
        print(f"edge to reader {read:.3f} ms, to the first frame of the stop {stopped:.3f} ms")
        assert 0.0 < read < stopped < 100.0  # a tick is 5 ms; nothing of an emulated machine is fast


def test_a_contact_that_is_open_keeps_the_robot_from_being_armed(chip):
    rig = stopping(chip)
    chip.pull("STOP", True)
    outcome = rig.run(200)
    assert (outcome.status, outcome.culprit) == ("e-stop", "stop") and rig.commands() == []


def edges(seen):
    """When a level changed, of (when, level) pairs."""
    return [now[0] for now, before in zip(seen[1:], seen) if now[1] != before[1]]


def watch(chip, name, seconds, seen):
    """Look at a line that the computer drives."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        seen.append((time.monotonic(), chip.value(name)))
        time.sleep(0.002)


def test_a_charge_pump_toggles_its_line_only_while_arming_and_in_every_tick(chip):
    with Diagram("robot", rate=20) as robot:
        ChargePump(name="pump", hold=0.5, start_up=0.5, **at(chip, "SYNC"))
    rig, seen = RealLines(robot), []
    outcome = rig.run(30, lambda: watch(chip, "SYNC", 3.0, seen))
    assert outcome.status == "ok"
    ended = rig.shared.began * 1e-9 + rig.shared.first_tick * 1e-9 + 30 / 20
    found = edges(seen)
    assert set(np.diff(rig["pump.changes"])) == {1.0}  # one change a tick, as many as were not missed
    assert 20 <= len([when for when in found if when < ended]) <= rig["pump.changes"][-1]
    assert len([when for when in found if when > ended + 0.1]) <= 1  # the line is let go


def test_after_kill_9_the_line_of_a_charge_pump_is_constant(chip):
    seen, after = [], []

    def work():  # only a signal ends it
        with Diagram("robot", rate=20) as robot:
            ChargePump(name="pump", hold=0.5, start_up=0.0, **at(chip, "SYNC"))
        RealLines(robot).run(100_000)

    child = fork(work)
    try:
        deadline = time.monotonic() + 20.0
        while len(edges(seen)) < 20 and time.monotonic() < deadline:
            watch(chip, "SYNC", 0.2, seen)
        assert len(edges(seen)) >= 20
    finally:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
    watch(chip, "SYNC", 1.0, after)
    assert len(edges(after)) <= 1  # the line is let go


def test_the_guardian_toggles_the_level_of_a_line(chip):
    lines = StreamLines([ChargePump(name="pump", **at(chip, "SYNC"))])
    line = lines.lines["pump"][1]
    relay = Relay({"descriptor": line.fileno(), "gpio": True, "frames": ["01", "00"], "hold": 0.1}, time.monotonic_ns())
    levels = []
    for _ in range(4):
        relay.change()
        levels.append(chip.value("SYNC"))
    lines.close()
    assert levels == [True, False, True, False]


def test_rejected_requests_are_explained(chip):
    import gpiod

    def refused(**how):
        with pytest.raises(Refused) as caught:
            open_line("button", **GpioInput(name="button", **at(chip, **how)).opening())
        return caught.value.problem

    assert refused(name="GPIO17").code == "TW127" and refused(name="9").code == "TW127"
    with gpiod.request_lines(chip.path, {"BUTTON": None}, consumer="another"):
        trouble = refused(name="BUTTON")
    assert trouble.code == "TW119" and "somebody else has that line" in trouble.message
    assert (ports_inventory.chip(chip.path).lines, ports_inventory.chip(chip.path).trouble) == (
        4,
        "",
    )  # as a scan tells it
