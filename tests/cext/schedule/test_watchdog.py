"""The watchdog: a tick that does not return ends with the motors stopped, in real time, by a real thread; and what
is no hang.
"""

import ctypes
import json
import math
import os
import signal
import subprocess
import sys
import threading
import time
import traceback
from contextlib import suppress
from pathlib import Path

import pytest

from blocks.actuators import CubeMars
from blocks.actuators.mit_frames import DISABLE, NOTHING
from blocks.limiters import TorqueLimiter
from cext.memory.shared_state import SharedState
from graph import Block, Diagram, Input, Output
from runtime.robot.emulation.priority import priority_of_loop
from tests.cext.clock.test_signals import ENVIRONMENT, ROOT
from tests.cext.rigs import Rig, plant_of
from tests.cext.spinning import BLOCK, compiled, needs_compiler

pytestmark = pytest.mark.timing

RATE, AT = 200, 20
LIMIT = 0.015  # s that a tick may work at 200 Hz
ALLOWANCE = 0.05  # s until every motor is told, on a machine that is busy; 0.0003 where it is not
SLACK = 0.01  # s, from the beginning of a tick to the call in it
GUARD = 60.0  # s: there is no guardian here that could come first
KNEES = {"left": 1, "right": 2}


@pytest.fixture(autouse=True)
def time_limit():
    """Without a watchdog, the test fails instead of hanging."""

    def end(*_):
        raise TimeoutError("no watchdog has ended the step")

    before = signal.signal(signal.SIGALRM, end)
    signal.alarm(20)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


class Then(Block):
    """2 N·m; calls something once, at a tick or the next that is not missed. called : ns, CLOCK_MONOTONIC"""

    u = Input("any")
    y = Output("N·m")

    def __init__(self, action, tick=AT, **options):
        self.action, self.when, self.called = action, tick, 0
        super().__init__(**options)

    def call(self, tick):
        if tick >= self.when and not self.called:
            self.called = time.monotonic_ns()
            self.action()

    def step(self, u, tick):
        self.call(tick)
        return 2.0


class Slow(Then):
    """The same, in the update phase; does not start quickly either."""

    def __init__(self, action, start=lambda: None, **options):
        self.start = start
        super().__init__(action, **options)

    def reset(self):
        self.start()

    def step(self):
        return 2.0

    def update(self, u, tick):
        self.call(tick)


def robot(*laws, rate=RATE, virtual=False, guard=GUARD, grace=0.0):
    """Two knees on buses of their own, each under a law."""
    with Diagram("robot", rate=rate) as diagram:
        for (side, can_id), law in zip(KNEES.items(), (*laws, *laws)):
            knee = CubeMars("AK10-9-V2.0", bus=side, can_id=can_id, name=f"{side}_knee", timeout=0.0)
            knee(torque_command=TorqueLimiter(limit=5.0, slew=math.inf)(law(side, knee)))
    shared = SharedState(1 << 20)
    shared.look_after(time.monotonic_ns())
    rig = Rig(diagram, plant_of(diagram, substeps=1), virtual=virtual, shared=shared, guard=guard, grace=grace)
    rig.called = lambda: min(
        block.called for block in diagram if isinstance(block, Then) and block.path.startswith("left")
    )
    return rig


def calls(action, kind=Then, **options):
    """A robot whose left law calls something at tick AT."""
    return robot(
        lambda side, knee: kind(action if side == "left" else time.monotonic, name=f"{side}_law", **options)(
            knee.position
        )
    )


def assert_stopped(rig, outcome, culprit="left_law"):
    """Every motor was stopped in time, and no torque followed."""
    assert (outcome.status, outcome.culprit) == ("hung", culprit) and rig.shared.fenced and rig.shared.state == "safe"
    assert outcome.tick >= AT and rig.tick[-1] < outcome.tick
    assert outcome.unconfirmed == ()  # the loop has come back, and has asked
    assert LIMIT <= outcome.hung
    for can_id in KNEES.values():
        said = [frame for frame in rig.frames if frame.sent and frame.id == can_id]
        end = next(place for place, frame in enumerate(said) if frame.data == DISABLE)
        assert [frame.data for frame in said[end - 1 :]] == [NOTHING, DISABLE] * ((len(said) - end + 1) // 2)
        assert len(said) - end > 2  # by the watchdog, then by the loop
        assert {NOTHING, DISABLE}.isdisjoint(rig.commands(can_id)[1:]) and len(rig.commands(can_id)) == len(rig.tick)
        since = rig.shared.began + said[end].time - rig.called()
        assert (LIMIT - SLACK) * 1e9 <= since < (LIMIT + ALLOWANCE) * 1e9


def forever():
    while True:
        pass


def deaf():
    """Does not let itself be broken off."""
    with suppress(KeyboardInterrupt):
        forever()


HELD = threading.Lock()
HELD.acquire()
HANGS = {
    "a loop without an end": forever,
    "a sleep": lambda: time.sleep(10.0),
    "C code that holds the GIL": lambda: ctypes.PyDLL(None).usleep(10_000_000),
    "a wait for a lock": HELD.acquire,
}


@pytest.mark.hazard("H8b")
@pytest.mark.parametrize("what", HANGS)
def test_a_hanging_python_block_is_interrupted_and_the_motors_are_stopped(what):
    rig = calls(HANGS[what])
    began = time.monotonic()
    outcome = rig.run(100)
    assert time.monotonic() - began < 2.0
    assert_stopped(rig, outcome)
    assert isinstance(outcome.error, KeyboardInterrupt)
    assert ("step", __file__) in [
        (frame.name, frame.filename) for frame in traceback.extract_tb(outcome.error.__traceback__)
    ]


def test_hanging_update_is_detected_like_hanging_step():
    rig = calls(forever, Slow)
    outcome = rig.run(100)
    assert (outcome.status, outcome.culprit) == ("hung", "left_law")
    # this tick's were out already
    assert len(rig.commands()) == len(rig.tick) + 1 and rig.sent()[-2:] == [NOTHING, DISABLE]


def test_a_block_that_catches_the_interrupt_still_counts_as_hung():
    rig = calls(deaf)
    outcome = rig.run(100)
    assert_stopped(rig, outcome)
    assert outcome.error is None


def test_a_block_that_hangs_at_the_start_prevents_the_first_tick():
    rigs = []

    def start():
        if rigs and rigs[0].shared.state == "arming":
            forever()

    rigs.append(calls(time.monotonic, Slow, start=start))
    outcome = rigs[0].run(100)
    assert (outcome.status, outcome.tick) == ("hung", -1) and isinstance(outcome.error, KeyboardInterrupt)
    assert outcome.hung >= 0.04 and rigs[0].commands() == [] and rigs[0].sent()[-4:] == [NOTHING, DISABLE] * 2


def test_the_start_of_blocks_may_take_all_of_the_grace_of_a_run_that_has_nothing_to_stop():
    rigs = []

    def start():
        if rigs and rigs[0].shared.state == "arming":
            time.sleep(0.3)

    def law(side, knee):
        return Slow(time.monotonic, start if side == "left" else time.monotonic, name=f"{side}_law")(knee.position)

    rigs.append(robot(law, grace=0.4))
    outcome = rigs[0].run(100)
    assert outcome.status == "ok" and rigs[0].tick[-1] == 99


@needs_compiler
def test_spinning_native_kernel_is_reported_repeatedly(tmp_path):
    space = {"ctypes": ctypes, "Block": Block, "Input": Input, "Output": Output}
    exec(BLOCK.format(library=compiled(tmp_path)), space)

    class Seconds(Then):
        y = Output("s")

        def step(self, u, tick):
            if tick < AT or self.called:
                return 0.0
            self.called = time.monotonic_ns()
            return self.action()

    def law(side, knee):
        spun = space["Spin"](name=f"{side}_spin")(
            Seconds(lambda: 0.08 if side == "left" else 0.0, name=f"{side}_seconds")(knee.position)
        )
        return Then(time.monotonic, tick=10**9, name=f"law_{side}")(spun)

    rig = robot(law)
    outcome = rig.run(100)
    assert_stopped(rig, outcome, culprit="left_spin")
    assert 0.08 <= outcome.hung < 0.25 and outcome.error is None
    assert rig.sent().count(DISABLE) >= (0.08 - LIMIT - ALLOWANCE) / 0.005  # a round every 5 ms
    assert rig.run(10).status == "ok" and rig.shared.hung is None  # nothing of it stays behind


def test_a_loop_on_another_thread_is_stopped_but_not_interrupted():
    rig = calls(lambda: time.sleep(0.1))
    found = []
    thread = threading.Thread(target=lambda: found.append(rig.run(100)))
    thread.start()
    thread.join()
    assert_stopped(rig, found[0])
    assert 0.1 <= found[0].hung and found[0].error is None


def test_after_it_everything_is_as_before():
    def threads():
        return [Path(f"/proc/self/task/{task}/comm").read_text().strip() for task in os.listdir("/proc/self/task")]

    before = signal.getsignal(signal.SIGURG)
    for action in (forever, lambda: seen.extend(threads())):
        seen = []
        calls(action).run(40)
        assert signal.getsignal(signal.SIGURG) == before and "tickwork-watch" not in threads()
    assert "tickwork-watch" in seen


# What is no hang


def busy(seconds):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        pass


def test_a_tick_of_two_periods_is_late_but_not_a_hang():
    rig = robot(
        lambda side, knee: Then(lambda: busy(0.04), name=f"{side}_law", tick=10 if side == "left" else 15)(
            knee.position
        ),
        rate=50,
    )
    outcome = rig.run(30)
    assert outcome.status == "ok" and rig.statistics()["missed"] >= 2 and not rig.shared.hung


class Patient(Then):
    """A block that declares how long its step may take."""

    allowance = 0.04


def test_a_step_within_its_allowance_is_not_a_hang():
    rig = calls(lambda: busy(0.03), Patient)
    assert rig.run(60).status == "ok" and not rig.shared.hung


def test_a_step_beyond_its_allowance_is_a_hang():
    outcome = calls(forever, Patient).run(60)
    assert (outcome.status, outcome.culprit) == ("hung", "left_law")
    assert outcome.hung >= LIMIT + Patient.allowance


def test_an_allowance_does_not_extend_the_limit_of_other_blocks():
    def law(side, knee):
        kind, action = (Patient, lambda: busy(0.03)) if side == "left" else (Then, forever)
        return kind(action, name=f"{side}_law")(knee.position)

    outcome = robot(law).run(60)
    assert (outcome.status, outcome.culprit) == ("hung", "right_law")
    assert LIMIT <= outcome.hung < Patient.allowance


@pytest.mark.parametrize("grace, status", [(0.4, "ok"), (0.06, "hung"), (0.0, "hung")])
def test_a_step_may_take_half_of_the_grace_of_a_run(grace, status):
    rig = robot(lambda side, knee: Then(lambda: busy(0.05), name=f"{side}_law")(knee.position), grace=grace)
    outcome = rig.run(60)
    assert outcome.status == status and (status == "ok" or outcome.hung >= max(LIMIT, grace / 2))


def test_the_guardian_sees_a_step_within_its_allowance_as_alive():
    ahead = []
    rig = calls(lambda: ahead.append(rig.shared.beat - time.monotonic_ns()), Patient)
    assert rig.run(60).status == "ok"
    assert ahead[0] > (Patient.allowance - SLACK) * 1e9 and rig.shared.beat < time.monotonic_ns()


@pytest.mark.parametrize("options", [{"virtual": True}, {"guard": 0.0}])
def test_watchdog_is_inactive_without_rig(options):
    rig = robot(lambda side, knee: Then(lambda: busy(0.06), name=f"{side}_law")(knee.position), **options)
    assert rig.run(60).status == "ok" and rig.shared.hung is None


STOPPED = """
import json, sys, time
from blocks.actuators import CubeMars
from graph import Diagram
from tests.cext.schedule.test_watchdog import Then, busy, robot

class Busy(Then):
    "Busy for much of each tick."
    def step(self, u):
        busy(0.015)
        return 2.0

rig = robot(lambda side, knee: (Busy if side == "left" else Then)(time.monotonic, name=side)(knee.position), rate=25)
print("ready", flush=True)
outcome = rig.run(60)
print(json.dumps([outcome.status, outcome.culprit, rig.statistics()["missed"]]))
"""


def test_a_suspended_machine_does_not_count_as_a_hang():
    process = subprocess.Popen(
        [sys.executable, "-c", STOPPED], cwd=ROOT, env=ENVIRONMENT, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == "ready\n"
    with priority_of_loop():
        time.sleep(0.3)
        for _ in range(6):
            process.send_signal(signal.SIGSTOP)
            time.sleep(0.15)  # nearly four periods
            process.send_signal(signal.SIGCONT)
            time.sleep(0.09)
    out, _ = process.communicate(timeout=30)
    status, culprit, missed = json.loads(out)
    assert (status, culprit) == ("ok", None) and missed >= 12
