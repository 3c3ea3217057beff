"""The loop and the watchdog never use the devices, the buses or the ring at the same time: in real time, by threads.

ThreadSanitizer runs these tests as well (`make sanitize`).
"""

import json
import math
import signal
import time

import pytest

from blocks.actuators import CubeMars
from blocks.limiters import TorqueLimiter
from cext.memory.shared_state import RECORD_EVENT, RECORD_FRAME, SharedState
from graph import Block, Diagram, Input, Output
from tests.cext.rigs import FRAME, Rig, plant_of
from tests.cext.schedule.test_watchdog import AT, RATE, Then, robot

pytestmark = pytest.mark.paced


def deaf(seconds):
    """Sleep in a step, whatever the watchdog sends."""
    before = signal.signal(signal.SIGURG, signal.SIG_IGN)
    time.sleep(seconds)
    signal.signal(signal.SIGURG, before)


class Raises(Block):
    """Passes its input on; raises once."""

    u = Input("N·m")
    y = Output("N·m")

    def __init__(self, **options):
        self.raised = False
        super().__init__(hold_exceptions=1, **options)

    def step(self, u, tick):
        if tick >= AT and not self.raised:
            self.raised = True
            raise ValueError("held")
        return u


class From(Block):
    """True from a tick on."""

    y = Output("1", dtype=bool)

    def step(self, tick):
        return tick >= AT


def chain(side, knee, before, after):
    """A law that may hang, then one that raises, then one that may hang."""
    first = Then(before if side == "left" else time.monotonic, name=f"{side}_law")(knee.position)
    return Then(after if side == "left" else time.monotonic, name=f"{side}_late")(Raises(name=f"{side}_raises")(first))


def test_an_exception_held_in_a_hung_tick_is_recorded_behind_the_frames_of_the_watchdog():
    ended = []

    def late():
        deaf(0.06)
        ended.append(time.monotonic_ns())

    rig = robot(lambda side, knee: chain(side, knee, lambda: deaf(0.05), late))
    assert rig.executor.run(100).status == "hung"
    records = list(rig.shared.drain(1 << 30))
    [place] = [
        place
        for place, (kind, record) in enumerate(records)
        if kind == RECORD_EVENT and json.loads(record).get("block") == "left_raises"
    ]
    frames = [(place, FRAME.unpack(record)[0]) for place, (kind, record) in enumerate(records) if kind == RECORD_FRAME]
    end = ended[0] - rig.shared.began
    during = [at for at, sent in frames if end - 0.055e9 < sent < end]
    assert len(during) > 5  # the watchdog stops the motors meanwhile
    assert all(at < place for at in during), "a step wrote to the ring that the watchdog owned"


@pytest.mark.hazard("H8b")
def test_a_drive_is_not_taken_out_by_the_loop_while_the_watchdog_stops_it():
    with Diagram("robot", rate=RATE) as diagram:
        knee = CubeMars("AK10-9-V2.0", can_id=1, name="knee", timeout=0.0)
        law = Then(lambda: deaf(0.06), name="law")(knee.position)
        knee(torque_command=TorqueLimiter(limit=5.0, slew=math.inf)(law), disable=From(name="from")())
    shared = SharedState(1 << 20)
    shared.look_after(time.monotonic_ns())
    rig = Rig(diagram, plant_of(diagram, substeps=1), virtual=False, shared=shared, guard=60.0)
    assert rig.run(100).status == "hung"
    assert [event for event in rig.events if event["event"] == "drive"] == []


@pytest.mark.parametrize("milliseconds", [14, 16, 18, 20, 25, 40])
def test_a_step_that_returns_while_the_watchdog_takes_over_leaves_a_whole_recording(milliseconds):
    """Around the limit of 15 ms either may win. Every record is read, and the motors are stopped in both cases."""
    rig = robot(lambda side, knee: chain(side, knee, lambda: deaf(milliseconds * 1e-3), time.monotonic))
    outcome = rig.run(40)
    assert outcome.status in ("ok", "hung") and rig.shared.state == "safe" and rig.shared.fenced
    assert rig.statistics()["dropped"] == 0
    assert outcome.unconfirmed == ()
