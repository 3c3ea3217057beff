"""Clocks of other devices in a recording: those of emulators that drift, against an edge on a GPIO line."""

import numpy as np
import pytest

import runtime
from blocks.gpio import SyncIn
from blocks.imus import MicroStrain
from blocks.recorders import CsvRecorder
from blocks.sensors import LslInlet, Microcontroller, Ros2Subscription
from blocks.sources import Pulse, Ramp
from graph import Diagram
from runtime.host.errors import BadInput
from tests.docs.test_special_samples import samples
from tests.runtime.record.analysis.test_recorded_trial import recorded

DRIFT, SHOWN = 150e-6, 4290.0  # slowness; s that the device's clock shows at tick 0, before it wraps at 4294.967 s
WRAP = 2**32 * 1e-6  # s


@pytest.fixture(scope="module")
def trial():
    with Diagram("clocks", rate=200) as diagram:
        SyncIn(name="mocap")
        fields = (("trigger", "uint8"), ("t", "uint32", "s", 1e-6))
        Microcontroller(fields=fields, clock="t", name="teensy")
        LslInlet(channels=(("trigger", "1"),), name="emg")
        Ros2Subscription(channels=(("trigger", "1"),), name="command")
        MicroStrain("1", name="imu")
        CsvRecorder()

    with Diagram("laboratory", rate=1000) as laboratory:
        edge = Pulse(period=40.0, delay=15.0037)()
        diagram["mocap"].emulator()(level=edge)
        slow = Ramp(slope=-DRIFT, initial=SHOWN, unit="s")()
        diagram["teensy"].emulator(period=0.001)(trigger=edge, t=slow)
        diagram["emg"].emulator(period=0.004)(
            trigger=edge, offset=Ramp(slope=DRIFT, initial=-SHOWN, unit="s")(), stamp=0.0
        )
        diagram["command"].emulator(period=0.01)(trigger=edge, stamp=slow)
        diagram["imu"].emulator(clock_error=DRIFT)()
    return runtime.run(diagram, 30.0, plant=laboratory)


def edge_of(trial):
    """Time of the edge on the line, which the plant sets at 15.004 s, in its tick after the pulse."""
    first = trial["mocap.on"].argmax()
    return trial.time[first] - trial["mocap.age"][first]


@pytest.mark.parametrize("name, wrap", [("teensy.t", WRAP), ("emg", 0.0), ("command", 0.0), ("command.stamp", 0.0)])
def test_offset_and_drift_of_a_clock_are_found(name, wrap, trial):
    # the plant runs while the robot is armed; stamps of LSL are those of the run, whose start is 0 in virtual time
    ahead = 0.0 if name == "emg" else 15.004 - edge_of(trial)
    clock = trial.clock(name, wrap)
    assert clock.drift == pytest.approx(DRIFT, abs=2e-6)
    assert clock.offset == pytest.approx(SHOWN + ahead, abs=0.0015)  # a sample waits for the next tick of the plant
    assert clock.time == pytest.approx(clock.offset + (1.0 - DRIFT) * trial.time, abs=1e-4)
    assert clock.at(clock.time) == pytest.approx(trial.time, abs=1e-9) and clock.error < 1e-3


def test_the_clock_of_a_microcontroller_agrees_with_an_edge_on_a_line(trial):
    text, check = samples("docs/how_to/motion_capture.md")
    assert 'trial.clock("teensy.t", wrap=2**32 * 1e-6)' in text
    there = trial["teensy.t"][trial["teensy.trigger"].argmax()]
    error = trial.clock("teensy.t", WRAP).at(there + WRAP) - edge_of(trial)
    assert error == pytest.approx(0.0, abs=0.006)  # up to a tick of the robot
    lines = check.splitlines()
    assert lines[0].startswith("there = ") and lines[2].startswith('trial.clock("teensy.t").at(there) - (')


def test_a_drift_alone_gives_a_clock_from_tick_0(trial):
    clock = trial.clock("imu")
    assert clock.drift == pytest.approx(DRIFT, abs=2e-6) and clock.offset == clock.time[0] == 0.0
    assert clock.time[-1] - trial.time[-1] == pytest.approx(-DRIFT * trial.time[-1], abs=1e-4) and np.isnan(clock.error)


def test_a_block_without_a_clock_is_an_error(trial):
    with pytest.raises(BadInput, match="mocap has no recorded clock: name a block"):
        trial.clock("mocap")
    with pytest.raises(BadInput, match="clock teensy.t starts again at 4.9. s: state `wrap`"):
        trial.clock("teensy.t")


def test_a_device_that_restarts_has_a_clock_before_and_one_after(tmp_path):
    def rows(restart):
        for tick in range(2000):
            time = tick / 200.0
            jitter = 0.004 * (-1) ** tick  # a sample may have an earlier stamp than the one before
            yield tick, 0.001, 100.0 + time + jitter - (90.0 if restart and time > 6.0 else 0.0)

    signals = ("imu.age s", "imu.t s")
    whole, broken = (runtime.load(recorded(tmp_path, rows(restart), f"trial{restart}", signals)) for restart in (0, 1))
    assert whole.clock("imu.t").offset == pytest.approx(100.0, abs=0.006)
    with pytest.raises(BadInput, match="imu.t starts again at 6.00 s: .* or take a part of the trial with `between`"):
        broken.clock("imu.t")
    assert broken.between(0.0, 6.0).clock("imu.t").offset == pytest.approx(100.0, abs=0.006)
    assert broken.between(6.1, 10.0).clock("imu.t").offset == pytest.approx(10.0, abs=0.006)
