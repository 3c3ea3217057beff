"""A new run that takes a bus over and then sends nothing: the process of the stop, which goes on, takes it back."""

import os
import signal
import time
from contextlib import contextmanager, suppress

import psutil
import pytest

from runtime.host.errors import FAULT, OK
from runtime.robot.guardian.handover import SILENCE
from runtime.robot.guardian.lock import BusLock
from tests.checkout import ROOT
from tests.runtime.robot.guardian.bus import guardian_of, is_torque
from tests.runtime.robot.guardian.test_handover import (
    GOES_ON,
    PAUSE,
    WAYS,
    TimedAdapter,
    line_of,
    longest_pause,
    stop_that_goes_on,
)
from tests.runtime.robot.rig.test_slcan import awaited, rig_of
from tests.runtime.runs import DISABLE, NOTHING, environment, knee, started, write
from tests.soaking import soaked

pytestmark = pytest.mark.paced

TAKEN_BACK = PAUSE + 2.0 * SILENCE * 1e-9  # s, longest without a frame to a drive
# the guardian of a run stops itself where it returns from a function
FROZEN = """
import os, signal, sys

def look(frame, event, argument):
    if event == "return" and (frame.f_code.co_name, os.path.basename(frame.f_code.co_filename)) == {place!r}:
        sys.setprofile(None)
        os.kill(os.getpid(), signal.{signal})

if "runtime.robot.guardian.process" in sys.orig_argv:
    sys.setprofile(look)
"""
PLACES = {  # the control process waits until its guardian has returned from prepare
    "before it has the interface": ("open", "handover.py"),
    "after its first frames": ("_open", "process.py"),
    "when it watches": ("prepare", "process.py"),
}
OPENING = [*PLACES][:2]


def failing_at(folder, place, name="SIGSTOP"):
    """Environment of a run whose guardian gets a signal at a place."""
    write(folder, FROZEN.format(place=PLACES[place], signal=name), "sitecustomize.py")
    return environment(PYTHONPATH=os.pathsep.join([str(folder), str(ROOT)]))


@contextmanager
def frozen_guardian(run):
    """Yields the guardian of a run, once it has stopped itself."""
    deadline = time.monotonic() + 30.0  # its interpreter starts on a machine that may be busy
    while time.monotonic() < deadline:
        for child in psutil.Process(run.pid).children():
            if child.name() == "tickwork-guard" and child.status() == psutil.STATUS_STOPPED:
                with suppress(psutil.NoSuchProcess):
                    try:
                        yield child
                    finally:
                        child.resume()  # a test has failed
                return
        time.sleep(0.01)
    raise AssertionError("the guardian has not stopped itself")


@pytest.mark.hazard("H9d")
@pytest.mark.parametrize("way", soaked(WAYS, but=[2]))
def test_a_bus_whose_new_run_sends_nothing_is_taken_back_each_time(way, tmp_path):
    with stop_that_goes_on(tmp_path, way) as (bus, drives, process):
        lock = BusLock("udp_multicast", bus.channel, {1, 2})
        for _ in range(2):
            assert lock.handover.send(b"o") and lock.handover.recv(1) == b"c"
            given = time.time()
            bus.listen(TAKEN_BACK)
            assert lock.handover.recv(1) == b"t"
            for motor in bus.motors:
                assert {frame.data for frame in bus.commands(motor, given + 0.1)} == {NOTHING, DISABLE}
        drives.awake = True
        text = "".join(process.communicate(timeout=10))
        assert "left/knee" in text and "only after" in text, text
        lock.close()


@pytest.mark.hazard("H9d")
@pytest.mark.soak
def test_a_new_run_whose_interface_took_long_to_open_has_no_more_time_between_frames(tmp_path):
    with stop_that_goes_on(tmp_path, WAYS[0]) as (bus, drives, process):
        lock = BusLock("udp_multicast", bus.channel, {1, 2})
        for frames in (0, 0, 3):  # as it is waited for twice as long each time
            assert lock.handover.send(b"o") and lock.handover.recv(1) == b"c"
            for _ in range(frames):
                time.sleep(0.1)
                lock.handover.send(b"s")
            silent = time.monotonic()
            assert lock.handover.recv(1) == b"t"
        assert time.monotonic() - silent < 3.0e-9 * SILENCE  # of 4
        drives.awake = True
        process.communicate(timeout=10)
        lock.close()


@pytest.mark.hazard("H9d")
@pytest.mark.parametrize("place", soaked(OPENING, but=[1]))
def test_no_drive_is_without_frames_while_the_guardian_of_a_new_run_is_stopped(place, tmp_path):
    with stop_that_goes_on(tmp_path, WAYS[0]) as (bus, drives, process):
        began = time.time()
        second = bus.start("--no-record", "--duration", "0.5", env=failing_at(tmp_path, place))
        with frozen_guardian(second):
            bus.listen(2.0)
            for motor in bus.motors:
                assert longest_pause(bus.frames, motor, began) < TAKEN_BACK
            assert not [frame for frame in bus.frames if frame.time >= began and is_torque(frame)]
        line_of(process, "continues the stop of")
        drives.awake = True
        resumed = time.time()
        while second.poll() is None:
            bus.listen(0.05)
        process.communicate(timeout=10)
        _, errors = second.communicate(timeout=20)
        assert second.returncode in (OK, FAULT), errors  # a busy machine may end it
        assert any(is_torque(frame) for frame in bus.frames if frame.time >= resumed), errors
        for motor in bus.motors:
            assert longest_pause(bus.frames, motor, resumed) < PAUSE


@pytest.mark.soak
def test_the_earlier_stop_continues_after_a_run_whose_guardian_does_not_watch(tmp_path):
    with stop_that_goes_on(tmp_path, WAYS[0]) as (bus, drives, process):
        began = time.time()
        second = bus.start("--no-record", "--duration", "0.5", env=failing_at(tmp_path, "when it watches"))
        while second.poll() is None:
            bus.listen(0.05)
        assert second.returncode == FAULT
        bus.listen(1.0)
        drives.awake = True
        assert "only after" in "".join(process.communicate(timeout=10))
        for motor in bus.motors:
            assert longest_pause(bus.frames, motor, began) < TAKEN_BACK
        assert not [frame for frame in bus.frames if frame.time >= began and is_torque(frame)]
        second.communicate()


@pytest.mark.parametrize("place", soaked(PLACES, but=[0]))
@pytest.mark.soak
def test_no_drive_is_without_frames_while_a_new_run_is_stopped_whose_guardian_was_killed(place, tmp_path):
    """The connection of the handover stays open in its control process until the guardian has answered."""
    with stop_that_goes_on(tmp_path, WAYS[0]) as (bus, drives, process):
        began = time.time()
        second = bus.start("--no-record", "--duration", "0.5", env=failing_at(tmp_path, place))
        with frozen_guardian(second) as guardian:
            second.send_signal(signal.SIGSTOP)
            guardian.kill()
        bus.listen(2.0)
        for motor in bus.motors:
            assert longest_pause(bus.frames, motor, began) < TAKEN_BACK
        assert {frame.data for motor in bus.motors for frame in bus.commands(motor, began)} == {NOTHING, DISABLE}
        drives.awake = True
        process.communicate(timeout=10)


@pytest.mark.parametrize("place", soaked(OPENING, but=[0]))
@pytest.mark.soak
def test_an_adapter_that_one_process_may_open_is_taken_back_and_handed_over_again(place, tmp_path):
    with TimedAdapter() as adapter:
        robot, rig = knee(tmp_path, "return 2.0"), rig_of(tmp_path, adapter.channel)
        words = [robot, "--rig", rig, "--yes", "--no-record"]
        first = started(*words, "--stop-for", "60", cwd=tmp_path)
        assert awaited(adapter.torque), "no torque was commanded"
        adapter.drives = ()
        guardian_of(first).kill()
        line_of(first, GOES_ON)
        time.sleep(0.7)
        adapter.times = []
        adapter.frames.clear()
        second = started(
            *words, "--stop-for", "0.2", "--duration", "0.5", cwd=tmp_path, env=failing_at(tmp_path, place)
        )
        with frozen_guardian(second):
            time.sleep(2.0)
            assert not adapter.torque()
        line_of(first, "continues the stop of knee")
        adapter.drives = (1,)
        first.communicate(timeout=10)
        _, errors = second.communicate(timeout=20)
        assert second.returncode in (OK, FAULT) and adapter.torque(), errors
        assert max(later - earlier for earlier, later in zip(adapter.times, adapter.times[1:])) < TAKEN_BACK
