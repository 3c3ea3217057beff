"""`commission` on emulated drives with faults: each is named before the drive gets torque, none on healthy ones."""

import os
import signal
import time

import pytest

from blocks.actuators import CubeMars
from graph import Diagram
from runtime.robot.rig.records import AGREES, Record, StepRecord, settings_of, write
from tests.runtime.setup.commissioning.benched import Benched
from tests.runtime.setup.commissioning.nodes import DISABLE, ENABLE, Node

pytestmark = pytest.mark.paced


def ready(bench, name):
    """Write a record in which the steps before torque agree."""
    with Diagram("bench", rate=200):
        block = CubeMars("AK80-9", bus="legs", can_id=3, range=(-6.0, 6.0), name=name)
    steps = {step: StepRecord("2026-12-01 10:00", AGREES) for step in ("identity", "bus", "state", "turn")}
    record = Record(name, name, "CubeMars", "AK80-9", settings=settings_of(block), steps=steps)
    record.signed = {"name": "E. Person", "date": time.strftime("%Y-%m-%d")}
    write(bench.rig, record)


@pytest.mark.hazard("H4i")
@pytest.mark.parametrize("end", ["Ctrl-C", "kill -9", "hang-up"])
def test_a_step_under_torque_that_ends_early_leaves_the_drive_disabled(tmp_path, end):
    listener = Node()

    def finish(terminal):
        time.sleep(2.2)  # the torque grows
        if end == "Ctrl-C":
            terminal.press(b"\x03")
        else:
            os.kill(terminal.process.pid, signal.SIGKILL if end == "kill -9" else signal.SIGHUP)

    with Benched(tmp_path, 113, {"knee": ("CubeMars", "AK80-9", 3, {}, {})}) as bench:
        ready(bench, "knee")
        listener.start(bench.channel)
        code, shown = bench.commission("--only", "torque", stop_at=(r"running 0\.", finish))
        time.sleep(0.5)
        listener.end()
        frames = [data for identifier, extended, data in listener.heard if identifier == 3 and data[0] != 3]
        assert ENABLE in frames, shown
        assert frames[-1] == DISABLE and ENABLE not in frames[frames.index(ENABLE) + 60 :]
        assert code not in (0, 1) and "torque" not in bench.records()["knee"].steps
        assert 0.0 < bench.torque("knee") <= 0.05 * 9.0
