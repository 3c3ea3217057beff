"""Devices that report faults, fall silent, or send what is no answer; and sensors that are never asked."""

import ctypes
import errno
import os
import signal
import threading
import time

import numpy as np
import pytest

from blocks.actuators import CubeMars, EmulatedCubeMars, RobStride
from blocks.actuators.mit_frames import DISABLE, ENABLE
from blocks.sources import StepSource
from cext.bus.memory_bus import MemoryBus
from cext.bus.replay_bus import ReplayBus
from cext.memory.shared_state import RECORD_FRAME, RECORD_RECEIVED, SharedState
from cext.ring.rings import Line, Lines
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Block, Device, Diagram, Kernel, Output, Param, compile
from tests.blocks.actuators.wire import Frame
from tests.cext.rigs import STOP, Rig, ends_in_the_safe_stop, one_drive, plant_of
from tests.soaking import soaked


@pytest.mark.hazard("H6b")
def test_a_fault_that_a_drive_reports_ends_the_run():
    with Diagram("robot", rate=200) as robot:
        CubeMars("AK10-9-V2.0", can_id=1, name="knee")(torque_command=1.0)
    with Diagram("plant", rate=200) as plant:
        EmulatedCubeMars.of(robot["knee"], name="knee")(0.0, 0.0, fault=StepSource(0.0, 2.0, 0.1).y)
    rig = Rig(robot, plant)
    outcome = rig.run(100)
    assert (outcome.status, outcome.culprit) == ("device fault", "knee") and 20 <= outcome.tick <= 22
    assert ends_in_the_safe_stop(rig)


@pytest.mark.hazard("H6a")
def test_a_silent_drive_ends_the_run_after_its_timeout():
    """Disconnect the plant: it no longer receives or replies."""
    with Diagram("robot", rate=200) as robot:
        CubeMars("AK10-9-V2.0", can_id=1, name="knee", timeout=0.05)(torque_command=1.0)
    rig = Rig(robot)
    host = rig.buses["can"].device
    reply = bytes([1, 0x80, 0, 0x80, 0x08, 0, 70, 0])
    host.send(1, reply, time=0)
    outcome = rig.run(100)
    # more than 0.05 s after the answer
    assert (outcome.status, outcome.culprit, outcome.tick) == ("silent", "knee", 11)
    assert ends_in_the_safe_stop(rig) and outcome.unconfirmed == ("knee",) and len(rig.commands()) == 11
    assert rig["knee.age"] == pytest.approx([tick / 200 for tick in range(11)], abs=1e-9)


def test_frame_received_after_tick_start_has_zero_age():
    rig = one_drive(lambda knee: 0.0, plant=False, timeout=0.0)
    rig.buses["can"].device.send(1, bytes([1, 0x80, 0, 0x80, 0x08, 0, 70, 0]), time=12_000_000)
    rig.run(6)
    assert rig["knee.age"] == pytest.approx([0.0, 0.0, 0.0, 0.003, 0.008, 0.013], abs=1e-12)


def test_a_drive_that_does_not_acknowledge_its_disable_has_not_confirmed_the_stop():
    class Stubborn(Block):
        """In the plant: answers every command but that to disable."""

        taken = Output("1")

        def step(self):
            for _, _, data, at in self.end.receive():
                if data not in (ENABLE, DISABLE):
                    self.end.send(1, bytes([1, 0x80, 0, 0x80, 0x08, 0, 70, 0]), time=at)
                if data == DISABLE:
                    states.add(rig.shared.state)
                    beats.add(rig.shared.beat)
            return 0.0

    states, beats = set(), set()

    with Diagram("robot", rate=200) as robot:
        CubeMars("AK10-9-V2.0", can_id=1, name="knee")(torque_command=1.0)
    with Diagram("plant", rate=200) as plant:
        drive = Stubborn(name="stubborn")
    rig = Rig(robot, plant)
    drive.end = rig.buses["can"].device
    outcome = rig.run(5)
    assert (outcome.status, outcome.unconfirmed) == ("ok", ("knee",)) and len(rig.commands()) == 5
    assert states == {"stopping"} and rig.shared.state == "safe"
    assert len(beats) == rig.sent().count(DISABLE) > 30  # it shows that it lives, all the time


def test_settings_of_a_drive_are_sent_at_one_frame_per_round():
    with Diagram("robot", rate=200) as robot:
        RobStride("CyberGear", can_id=1, name="knee")(torque_command=1.0)
    rig = Rig(robot)
    steps = rig.schedule.devices[0]
    assert len(steps.set_up) == 8
    assert rig.run(10, arming_timeout=0.1).status == "no answer"
    arming = [frame for frame in rig.frames if frame.sent and frame.time <= 100_000_000]
    asked = [frame.time for frame in arming if frame.data == steps.ask[0][2] and frame.id >> 24 & 31 == 4]
    written = sorted({frame.time for frame in arming if frame.data == steps.set_up[1][2]})
    period = 5_000_000  # ns
    assert len(set(asked)) == 21, "it is asked in every round"
    assert len(written) > 2 and written == [k * len(steps.set_up) * period for k in range(len(written))]
    assert not any(frame.data == steps.enable[0][2] and frame.id >> 24 & 31 == 3 for frame in rig.frames)


def test_receive_time_is_recorded_even_without_frames():
    with Diagram("robot", rate=200) as robot:
        Sensor(name="sensor", timeout=0.0)
    rig = Rig(robot)
    rig.executor.run(20)
    drains = [payload for kind, payload in rig.shared.drain(1 << 30) if kind == RECORD_RECEIVED]
    assert len(drains) >= 20 and len(set(drains)) >= 20


def test_receive_times_are_not_recorded_without_bus():
    with Diagram("robot", rate=200) as robot:
        StepSource(0.0, 1.0, 0.1)
    rig = Rig(robot)
    rig.executor.run(20)
    assert RECORD_RECEIVED not in {kind for kind, _ in rig.shared.drain(1 << 30)}


def test_zero_timeout_disables_timeout():
    rig = one_drive(lambda knee: 0.0, plant=False, timeout=0.0)
    rig.buses["can"].device.send(1, bytes([1, 0x80, 0, 0x80, 0x08, 0, 70, 0]))
    assert rig.run(1000).status == "ok"


BAD = {
    "short": (1, b"\x01\x80\x00\x80\x08\x00\x00", False, "malformed"),
    "empty": (1, b"", False, "malformed"),
    "long": (1, bytes(64), False, "malformed"),
    "of another id inside": (1, b"\x02\x90\x00\x90\x08\x00\x46\x00", False, "malformed"),
    "extended": (1, b"\x01\x90\x00\x90\x08\x00\x46\x00", True, "foreign"),
    "of another device": (9, b"\x09\x90\x00\x90\x08\x00\x46\x00", False, "foreign"),
    "from id 0 for another": (0, b"\x09\x90\x00\x90\x08\x00\x46\x00", False, "foreign"),
    "a remote request": (1 | 0x40000000, b"\x01\x90\x00\x90\x08\x00\x46\x00", False, "foreign"),
    "an error frame": (
        1 | 0x20000000,
        b"\x01\x90\x00\x90\x08\x00\x46\x00",
        False,
        "nowhere",
    ),  # the controller's own: the bus counts it
}


@pytest.mark.parametrize("kind", BAD)
def test_frames_that_are_not_replies_change_nothing_and_are_counted(kind):
    identifier, data, extended, counted = BAD[kind]
    rig = one_drive(lambda knee: 0.0, plant=False, timeout=0.0)
    device = rig.buses["can"].device
    device.send(1, bytes([1, 0x80, 0, 0x80, 0x08, 0, 70, 0]))
    for _ in range(5):
        device.send(identifier, data, extended)
    assert rig.run(10).status == "ok"
    frames = rig.statistics()["frames"]
    counts = {kind: 5 * (kind == counted) for kind in ("foreign", "malformed")}
    assert {kind: frames[kind] for kind in counts} == counts and frames["received"] == (
        1 if counted == "nowhere" else 6
    )
    assert set(rig["knee.temperature"]) == {30.0} and len(set(rig["knee.position"])) == 1


@pytest.mark.parametrize("kind", BAD)
def test_frames_that_are_not_replies_do_not_complete_arming(kind):
    identifier, data, extended, _ = BAD[kind]
    rig = one_drive(lambda knee: 0.0, plant=False)
    rig.buses["can"].device.send(identifier, data, extended)
    assert rig.run(10, arming_timeout=0.05).status == "no answer"


def test_a_flood_of_foreign_frames_is_taken_64_a_tick():
    rig = one_drive(lambda knee: 0.0)
    for _ in range(500):
        rig.buses["can"].device.send(9, b"\x00")
    assert rig.run(20).status == "ok"
    frames = rig.statistics()["frames"]
    assert frames["foreign"] == 500


def test_oversized_frame_is_refused_from_block_and_recording():
    """It would be written behind the frame's end."""

    class Long(CubeMars):
        def enable_frames(self):
            return [(1, False, bytes(65))]

    with Diagram("robot", rate=200) as robot:
        Long("AK10-9-V2.0", can_id=1)(torque_command=0.0)
    with pytest.raises(ValueError, match="at most 64 bytes, not 65"):
        Rig(robot)
    long, valid = (np.frombuffer(bytes(Frame(id=1, length=length)), np.uint8)[None] for length in (65, 64))
    with pytest.raises(ValueError, match="at most 64 bytes, not 65"):
        ReplayBus().give(long, [1])
    ReplayBus().give(valid, [1])


DOUBLES, SLOTS, FRAME = ctypes.POINTER(ctypes.c_double), ctypes.POINTER(ctypes.c_int32), ctypes.POINTER(ctypes.c_int64)


@ctypes.CFUNCTYPE(ctypes.c_int, DOUBLES, SLOTS, ctypes.c_void_p, FRAME)
def sensor_decode(arena, slots, sizes, frame):
    """Takes every frame: the reading is its identifier."""
    arena[slots[0]] = float(frame[1] & 0x7FF)
    return 1


@ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p)
def sensor_encode(arena, slots, sizes, frames):
    """Asks for nothing."""
    return 0


class Sensor(Device):
    """Speaks by itself and is never asked."""

    timeout = Param(0.05, "s", min=0.0)
    reading = Output("1")
    bus = "can"
    decode, encode = Kernel(sensor_decode, "reading"), Kernel(sensor_encode, "")


def test_streaming_sensor_is_awaited_while_arming():
    with Diagram("robot", rate=200) as robot:
        Sensor(name="sensor")
    rig = Rig(robot)
    outcome = rig.run(20, arming_timeout=0.1)
    assert (outcome.status, outcome.unanswered) == ("no answer", ("sensor",)) and rig.frames == []
    rig = Rig(robot)
    rig.buses["can"].device.send(42, b"")
    outcome = rig.run(20)
    assert (outcome.status, outcome.culprit, outcome.tick) == ("silent", "sensor", 11) and set(
        rig["sensor.reading"]
    ) == {42.0}
    assert outcome.unconfirmed == ()


def test_sensor_without_timeout_is_not_awaited_while_arming():
    with Diagram("robot", rate=200) as robot:
        Sensor(name="sensor", timeout=0.0)
    assert Rig(robot).run(20).status == "ok"


def test_fence_raised_while_arming_blocks_further_arming_frames():
    @ctypes.CFUNCTYPE(ctypes.c_int, DOUBLES, SLOTS, ctypes.c_void_p, FRAME)
    def raises_the_fence(arena, slots, sizes, frame):
        rig.shared.raise_fence()
        return 1

    class Spy(Sensor):
        bus, decode = "other", Kernel(raises_the_fence, "")

    with Diagram("robot", rate=200) as robot:
        CubeMars("AK10-9-V2.0", can_id=1, name="knee")(torque_command=1.0)
        Spy(name="sensor", timeout=0.0)
    rig = Rig(robot)
    rig.buses["other"].device.send(42, b"")
    assert rig.run(20).status == "fenced" and set(rig.sent()) == set(STOP)


def test_faults_during_stop_do_not_replace_its_cause():
    @ctypes.CFUNCTYPE(ctypes.c_int, DOUBLES, SLOTS, ctypes.c_void_p, FRAME)
    def is_pressed(arena, slots, sizes, frame):
        return 5  # PRESSED of cext/abi.pxd

    class Button(Sensor):
        bus, decode = "other", Kernel(is_pressed, "")

    class Presser(Block):
        """In the plant: presses the button as soon as the drive is disabled."""

        taken = Output("1")

        def step(self):
            if any(data == DISABLE for _, _, data, _ in self.drive.receive()):
                self.button.send(42, b"")
            return 0.0

    with Diagram("robot", rate=200) as robot:
        CubeMars("AK10-9-V2.0", can_id=1, name="knee", timeout=0.05)(torque_command=1.0)
        Button(name="button", timeout=0.0)
    with Diagram("plant", rate=200) as plant:
        presser = Presser(name="presser")
    rig = Rig(robot, plant)
    presser.drive, presser.button = rig.buses["can"].device, rig.buses["other"].device
    presser.drive.send(1, bytes([1, 0x80, 0, 0x80, 0x08, 0, 70, 0]))
    outcome = rig.run(100)
    assert (outcome.status, outcome.culprit) == ("silent", "knee") and any(frame.id == 42 for frame in rig.frames)


@pytest.mark.parametrize("by_signal", soaked([False, True], but=[1]))
def test_in_virtual_time_a_slow_reader_loses_nothing_of_a_long_stop(by_signal):
    """Thirty drives that do not confirm, and a ring that is full to some degree when the stop begins."""

    class Ends(Block):
        y = Output("1")

        def step(self, tick):
            if by_signal and tick == ticks - 1:
                os.kill(os.getpid(), signal.SIGTERM)
            return 0.0

    class Hears(Block):
        """In the plant: takes what the drives are sent, so that the bus goes on taking it."""

        taken = Output("1")

        def step(self):
            return float(len(self.end.receive()))

    with Diagram("plant", rate=100) as plant:
        hears = Hears(name="hears")
    with Diagram("robot", rate=100) as robot:
        Ends(name="ends")
        for can_id in range(1, 31):
            CubeMars("AK10-9-V2.0", can_id=can_id, name=f"drive{can_id}", timeout=0.0)(torque_command=1.0)
    for ticks in range(40, 100, 5):
        here, there = os.pipe()  # hangs up when nobody reads any more
        rig, records, over = Rig(robot, plant, shared=1 << 19, reader=here), [], threading.Event()
        hears.end = rig.buses["can"].device
        for can_id in range(1, 31):
            rig.buses["can"].device.send(can_id, bytes([can_id, 0x80, 0, 0x80, 0x08, 0, 70, 0]))

        def read():
            while not over.wait(0.06):
                records.extend(rig.shared.drain(1 << 30))

        thread = threading.Thread(target=read)
        thread.start()
        try:
            outcome = rig.executor.run(1000 if by_signal else ticks)
        finally:
            over.set()
            thread.join()
            os.close(here)
            os.close(there)
        records += rig.shared.drain(1 << 30)
        statistics = rig.statistics()
        assert (
            outcome.signal == (signal.SIGTERM if by_signal else 0)
            and len(outcome.unconfirmed) == 30
            and statistics["dropped"] == 0
        )
        assert (
            sum(kind == RECORD_FRAME for kind, _ in records)
            == statistics["frames"]["sent"] + statistics["frames"]["received"]
        )


@pytest.mark.parametrize("plant, least, most", [(True, 2, 2), (False, 3, 42)])  # a busy machine sends it less often
def test_real_time_stop_is_sent_twice_then_at_most_every_5_ms_until_confirmed(plant, least, most):
    rig = one_drive(lambda knee: 0.0, virtual=False, plant=plant)
    began = time.monotonic()
    outcome = rig.run(10, arming_timeout=0.05)
    assert outcome.unconfirmed == (() if plant else ("knee",)) and (plant or time.monotonic() - began > 0.25)
    assert least <= rig.sent().count(DISABLE) <= most
    times = [frame.time for frame in rig.frames if frame.sent]
    assert times == sorted(times) and times[-1] < 1e9 * (time.monotonic() - began)


@pytest.mark.parametrize("rate, rounds", [(50, 41), (200, 41), (1000, 201)])
def test_stop_is_resent_every_period_and_at_least_every_5_ms(rate, rounds):
    rig = one_drive(lambda knee: 0.0, plant=False, rate=rate)
    assert rig.run(10, arming_timeout=0.05).status == "no answer"
    assert abs(rig.sent().count(DISABLE) - rounds) <= 1


def test_run_without_drives_ends_with_last_tick():
    class Counts(Block):
        """In the plant."""

        y = Output("1")

        def step(self, tick):
            steps.append(tick)
            return 0.0

    steps = []
    with Diagram("robot", rate=200) as robot:
        StepSource(0.0, 1.0, 0.1)
    with Diagram("plant", rate=200) as plant:
        Counts(name="counts")
    assert Rig(robot, plant).run(20).status == "ok" and steps == list(range(20))


def test_a_robot_without_shared_state_arms_and_runs():
    with Diagram("robot", rate=200) as robot:
        CubeMars("AK10-9-V2.0", can_id=1, name="knee", timeout=0.0)(torque_command=1.0)
    bus, schedule = MemoryBus(), compile(robot)
    plant = Program(compile(plant_of(robot)), [bus.device])
    assert (
        Executor(Program(schedule, [bus.host]), schedule.rate, plant=plant, substeps=5, virtual=True).run(20).status
        == "ok"
    )


class Streamed(Sensor):
    """On a line of its own."""

    medium = "stream"


def test_received_bytes_are_consumed_in_one_tick():
    with Diagram("robot", rate=200) as robot:
        Streamed(name="sensor", timeout=0.0)
    rig = Rig(robot)
    for number in range(1, 501):
        rig.buses["can"].device.send(number, b"")
    assert rig.run(1).status == "ok" and rig["sensor.reading"].tolist() == [500.0]


def on_lines(more=lambda: None):
    """A drive on each of three buses, and more; lines that only the test serves. Returns (schedule, lines, their
    ends).
    """
    with Diagram("robot", rate=200) as robot:
        for bus in ("left", "middle", "right"):
            CubeMars("AK80-9", bus=bus, can_id=1, name=bus, timeout=0.0)(torque_command=0.0)
        more()
    schedule = compile(robot)
    lines = Lines(len(schedule.buses))
    return schedule, lines, [Line(lines, number).end for number in range(len(schedule.buses))]


def test_the_failed_one_of_several_buses_is_named():
    schedule, lines, ends = on_lines()
    for number in range(3):
        lines.give(number, 1, bytes([1, 0x80, 0, 0x80, 0x08, 0, 70, 0]), 0)
    lines.fail(1, errno.ENODEV)
    outcome = Executor(Program(schedule, ends), 200.0, virtual=True).run(10)
    assert (outcome.status, outcome.culprit) == ("bus error", schedule.buses[1])


def test_the_bus_that_fails_while_sending_is_named():
    @ctypes.CFUNCTYPE(ctypes.c_int, DOUBLES, SLOTS, ctypes.c_void_p, FRAME)
    def pulls_the_plug(arena, slots, sizes, frame):
        lines.fail(1, errno.ENODEV)  # of a bus that has been heard already
        return 1

    class Spy(Sensor):
        bus, decode = "spy", Kernel(pulls_the_plug, "")

    class Wires(Block):
        """In the plant: drives that answer, and a word to the spy."""

        taken = Output("1")

        def step(self, tick):
            for number in range(3):
                if lines.take(number):
                    lines.give(number, 1, bytes([1, 0x80, 0, 0x80, 0x08, 0, 70, 0]), 0)
            if tick == 10:
                lines.give(3, 42, b"", 0)
            return 0.0

    with Diagram("plant", rate=200) as plant:
        Wires(name="wires")
    schedule, lines, ends = on_lines(lambda: Spy(name="spy", timeout=0.0))
    assert schedule.buses == ["left", "middle", "right", "spy"]
    outcome = Executor(Program(schedule, ends), 200.0, plant=Program(compile(plant)), virtual=True).run(100)
    assert (outcome.status, outcome.culprit) == ("bus error", "middle") and outcome.tick < 20


def test_the_blocked_one_of_several_buses_is_named():
    schedule, lines, ends = on_lines()
    executor = Executor(Program(schedule, ends), 200.0, virtual=True)
    for number in range(3):
        lines.give(number, 1, bytes([1, 0x80, 0, 0x80, 0x08, 0, 70, 0]), 0)
    for _ in range(500):  # of 512 that it holds; nobody takes any
        ends[1].send(5, b"")
    outcome = executor.run(1000)
    assert (outcome.status, outcome.culprit) == ("bus error", schedule.buses[1]) and outcome.tick < 20


@pytest.mark.parametrize("batch", ["zero", "disable", "enable"])
def test_frame_equal_to_a_command_is_a_foreign_command(batch):
    with Diagram("robot", rate=200) as robot:
        RobStride("RS03", can_id=1, name="knee", timeout=0.0)(torque_command=0.0)
    shared = SharedState(1 << 20)
    shared.look_after(time.monotonic_ns())  # where the guardian sees to it that we are alone
    rig = Rig(robot, plant_of(robot), shared=shared, guard=30.0)
    number, extended, data = getattr(rig.schedule.devices[0], batch)[0]
    rig.buses["can"].device.send(number, bytes(len(data)), extended)
    assert (outcome := rig.run(20)).status == "foreign command" and outcome.culprit == "knee"


@pytest.mark.parametrize("kind, status", [(17, "ok"), (18, "foreign command")], ids=["read", "written"])
def test_a_parameter_that_another_program_reads_is_no_command_and_one_that_it_writes_is(kind, status):
    with Diagram("robot", rate=200) as robot:
        knee = RobStride("RS03", can_id=1, name="knee", timeout=0.0)
        knee(torque_command=0.0)
    with Diagram("plant", rate=200) as plant:
        knee.emulator(name="motor")(position=0.0, velocity=0.0)
    shared = SharedState(1 << 20)
    shared.look_after(time.monotonic_ns())
    rig = Rig(robot, plant, shared=shared, guard=30.0)
    own = [number for number, _, _ in rig.schedule.devices[0].set_up if number >> 24 == kind]
    assert own
    rig.buses["can"].device.send(own[0], bytes([0x05, 0x70, 0, 0, 0, 0, 0, 0]), True)
    assert rig.run(20).status == status


def test_armed_drive_is_not_reenabled_while_others_are_awaited():
    with Diagram("robot", rate=200) as robot:
        for can_id in (1, 2):
            CubeMars("AK80-9", can_id=can_id, name=f"drive{can_id}")(torque_command=0.0)
    with Diagram("plant", rate=200) as plant:
        EmulatedCubeMars.of(robot["drive1"], name="drive1")(0.0, 0.0)
    rig = Rig(robot, plant)
    assert rig.run(10, arming_timeout=0.1).unanswered == ("drive2",)
    assert rig.sent(1).count(ENABLE) == 1 and rig.sent(2).count(ENABLE) > 20


@pytest.mark.parametrize("can_id", [1, 5, 255])
def test_drive_accepts_only_its_declared_identifiers(can_id):
    """A rig lets the kernel keep all else from it."""
    with Diagram("robot", rate=200) as robot:
        CubeMars("AK10-9-V2.0", can_id=can_id, name="knee", timeout=0.0)(torque_command=0.0)
    rig = Rig(robot)
    offered = [(identifier, extended) for identifier in (0, 1, 5, 6, 255, 0x105, 0x7FF) for extended in (False, True)]
    for identifier, extended in offered:
        rig.buses["can"].device.send(identifier, bytes([can_id, 0x80, 0, 0x80, 0x08, 0, 70, 0]), extended)
    assert rig.run(1).status == "ok"
    heard = [
        frame
        for frame in offered
        if any(
            frame[0] & mask == number & mask and frame[1] == extended
            for number, mask, extended in robot["knee"].acceptance_filters()
        )
    ]
    frames = rig.statistics()["frames"]
    assert frames["received"] - frames["foreign"] == len(heard) == 2
