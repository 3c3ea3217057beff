"""After a fault: behind the fence until the operator rearms, and only once all causes are cleared. In virtual time,
on in-memory buses.
"""

import ctypes
import math
import time

import numpy as np
import pytest

from blocks.actuators import CubeMars, EmulatedCubeMars
from blocks.actuators.mit_frames import DISABLE, ENABLE, NOTHING
from blocks.limiters import TorqueLimiter
from blocks.safety import EmergencyStop, Rearm
from cext.memory.shared_state import SharedState
from cext.schedule.mailbox_writer import Writer
from graph import Block, Diagram, Input, Kernel, Output, subsystem
from tests.cext.rigs import Rig, ends_in_the_safe_stop, plant_of

pytestmark = pytest.mark.timing

SIGNATURE = ctypes.CFUNCTYPE(
    ctypes.c_int, ctypes.POINTER(ctypes.c_double), ctypes.POINTER(ctypes.c_int32), ctypes.POINTER(ctypes.c_int32)
)
FADE = 0.1  # s
RATE = 200


class Law(Block):
    """2 N·m; does something else at some ticks. script : {tick: what is called, which gives the torque}"""

    position = Input("rad")
    torque = Output("N·m")

    def __init__(self, script, **options):
        self.script, self.resets = script, 0
        super().__init__(**options)

    def reset(self):
        self.resets += 1

    def step(self, position, tick):
        return self.script.get(tick, lambda: 2.0)()


class Ask(Block):
    """True in some ticks."""

    asked = Output("1", dtype=bool)

    def __init__(self, ticks, **options):
        self.ticks = ticks
        super().__init__(**options)

    def step(self, tick):
        return tick in self.ticks


def nan():
    return math.nan


def broken():
    raise ValueError("a wire has come loose")


class Bit(Block):
    """In the plant: what the drive reports as its fault."""

    code = Output("1", dtype=int)

    def __init__(self, ticks, **options):
        self.ticks = ticks
        super().__init__(**options)

    def step(self, tick):
        return 5 if tick in self.ticks else 0


class Thief(Block):
    """In the plant: takes away what the drive has answered, in some of its ticks."""

    taken = Output("1")
    host = None

    def __init__(self, ticks, **options):
        self.ticks = ticks
        super().__init__(**options)

    def step(self, tick):
        return len(self.host.receive()) if tick in self.ticks else 0.0


class Survivor:
    """A drive whose law follows a script, and which may be armed again. asks : ticks at which its input asks for
    that
    """

    def __init__(self, script, asks=(), *, plant=None, more=lambda: None, **options):
        with Diagram("robot", rate=RATE) as robot:
            self.law = Law({tick: self.act(action) for tick, action in script.items()}, name="law")
            drive = CubeMars("AK10-9-V2.0", can_id=1, name="knee")
            drive(torque_command=TorqueLimiter(limit=5.0, slew=math.inf)(self.law(drive.position)))
            Rearm(name="again")(Ask(set(asks), name="ask")())
            more()
        self.rig = Rig(robot, (plant or plant_of)(robot), **options)
        self.writer = Writer(self.rig.shared, "keys")
        self.slots = [self.rig.schedule.inputs["again"]["request"]]
        self.heard, self.answers = [], {}

    def act(self, action):
        return (lambda: self.press(action)) if isinstance(action, str) else action

    def press(self, what):
        """A request to the run, from within its tick."""
        if what == "stop":
            self.writer.stop()
        else:
            self.writer.confirm(self.rig.shared.question)
        return 2.0

    def tell(self, what, outcome):
        self.heard.append((what, outcome.status, outcome.culprit, outcome.tick))

    def run(self, ticks=200, **options):
        options = {"fade": FADE, "rearm": self.slots, "notify": self.tell, **options}
        return self.rig.run(ticks, **options)

    def between(self):
        """Frames sent to the drive between the first fault and the next enable."""
        sent = self.rig.sent()
        first = sent.index(DISABLE)
        return sent[first : sent.index(ENABLE, first)]


def test_after_a_fault_a_rising_input_arms_again_with_torque_faded_in_on_the_same_grid():
    robot = Survivor({50: nan}, asks=[80])
    outcome = robot.run()
    assert (outcome.status, outcome.tick) == ("ok", 199)
    [fault] = outcome.faults
    assert (fault.status, fault.culprit, fault.tick) == ("not finite", "knee", 50)
    assert [entry[:2] for entry in robot.heard] == [("fault", "not finite"), ("rearm", "ok")]
    assert set(robot.between()) <= {NOTHING, DISABLE}
    rig = robot.rig
    assert (np.diff(rig.tick) > 0).all() and len(rig.tick) == len(set(rig.tick))
    armed = (
        next(tick for tick in rig.tick if tick > 80 and rig["knee.torque_sent"][list(rig.tick).index(tick)] > 0.0) - 1
    )
    assert 81 < armed < 90
    sent = dict(zip(rig.tick, rig["knee.torque_sent"]))
    for tick in range(armed, armed + 20):  # as after the first arming
        assert sent[tick] == pytest.approx(2.0 * (tick - armed) / (FADE * RATE), abs=130.0 / 4095)
    assert sent[199] == pytest.approx(2.0, abs=130.0 / 4095)
    waiting = [torque for tick, torque in sent.items() if 50 < tick <= 80]
    assert len(waiting) > 20 and np.abs(waiting).max() < 130.0 / 4095  # computed and recorded, and nothing of it sent
    untroubled = Survivor({})
    untroubled.run()
    assert robot.law.resets == untroubled.law.resets + 1  # blocks begin anew at each arming
    assert ends_in_the_safe_stop(rig)


@pytest.mark.parametrize("python", [False, True], ids=["native", "Python"])
def test_a_disabled_subsystem_outputs_zero_after_arming_again(python):
    """Not the torque that it held before the fault, from which it would jump once it is enabled."""

    class Pass(Block):
        u, y = Input("N·m"), Output("N·m", range=(-9.0, 9.0))

        def step(self, u):
            return u

    def more():
        with subsystem("assist", enabled=Ask({*range(45), *range(150, 200)}, name="walking")()):
            torque = TorqueLimiter(limit=9.0, slew=100.0, name="limiter")(4.0)
            torque = Pass(name="pass")(torque) if python else torque
        CubeMars("AK10-9-V2.0", can_id=2, name="hip")(torque_command=torque)

    robot = Survivor({50: nan}, asks=[80], more=more)
    assert robot.run().status == "ok"
    tick, sent = robot.rig.tick, robot.rig["hip.torque_sent"]
    assert sent[tick == 44] == pytest.approx(4.0, abs=0.04)
    assert np.abs(sent[(tick > 50) & (tick < 150)]).max() < 0.04, "zero while it waits, and while it is disabled"
    assert np.abs(np.diff(sent[tick > 140])).max() < 0.5 + 0.04 and sent[-1] == pytest.approx(4.0, abs=0.04)


def test_a_confirmation_arms_again():
    robot = Survivor({50: nan, 80: "rearm"})
    outcome = robot.run()
    assert outcome.status == "ok" and len(outcome.faults) == 1 and robot.rig.sent().count(ENABLE) == 2
    assert [change.kind for change in robot.rig.changes] == [4]


@pytest.mark.parametrize("tick", range(55, 62))
def test_a_request_early_in_the_wait_is_not_lost(tick):
    robot = Survivor({50: nan, tick: "rearm"})
    outcome = robot.run()
    assert outcome.status == "ok" and [entry[0] for entry in robot.heard] == ["fault", "rearm"]


def test_while_waiting_the_drive_is_disabled_every_tick_and_replies():
    robot = Survivor({50: nan})
    outcome = robot.run(120)
    assert (outcome.status, outcome.culprit, outcome.tick, outcome.faults) == ("not finite", "knee", 50, ())
    sent = robot.rig.sent()
    waited = sent[sent.index(DISABLE) + 1 :]
    assert waited.count(DISABLE) > 60 and set(waited) == {NOTHING, DISABLE}
    ages = dict(zip(robot.rig.tick, robot.rig["knee.age"]))
    assert max(ages[tick] for tick in ages if tick > 60) <= 1.0 / RATE + 1e-9
    assert robot.rig.tick[-1] == 119 and ends_in_the_safe_stop(robot.rig)


@pytest.mark.parametrize("ask", [range(200), range(49), range(40, 51)])
def test_held_or_early_input_requests_no_rearm(ask):
    robot = Survivor({50: nan}, asks=ask)
    assert robot.run().status == "not finite" and robot.rig.sent().count(ENABLE) == 1
    assert [entry[0] for entry in robot.heard] == ["fault"]


def test_a_request_before_the_wait_has_no_effect():
    robot = Survivor({49: "rearm", 50: nan})
    assert robot.run().status == "not finite" and robot.rig.sent().count(ENABLE) == 1


def test_a_confirmation_from_before_the_fault_that_is_delivered_after_it_has_no_effect():
    """As of a recorder that is stopped for a while: the key was pressed before the transient fault."""
    before = []
    script = {
        40: lambda: before.append((robot.rig.shared.question, time.monotonic_ns())) or 2.0,
        45: lambda: time.sleep(0.005) or 2.0,  # the time of a key has a resolution of a millisecond
        50: nan,
        80: lambda: robot.writer.confirm(*before[0]) or 2.0,
        90: lambda: robot.writer.confirm(robot.rig.shared.question, before[0][1]) or 2.0,
        100: lambda: robot.writer.confirm(before[0][0], time.monotonic_ns()) or 2.0,
    }
    robot = Survivor(script)
    assert robot.run().status == "not finite" and robot.rig.sent().count(ENABLE) == 1
    assert [entry[0] for entry in robot.heard] == ["fault"]


def test_an_input_that_is_nan_for_a_tick_requests_no_rearm():
    """A stuck button of a sensor that fails for a tick: neither its return from NaN nor NaN itself is a press."""

    class Stuck(Block):
        y = Output("1")

        def step(self, tick):
            return math.nan if tick in (70, 110) else float(tick < 100)

    robot = Survivor({50: nan}, more=lambda: Stuck(name="stuck"))
    slot = robot.rig.schedule.signals["stuck.y"].slot
    assert robot.run(rearm=[slot]).status == "not finite" and [entry[0] for entry in robot.heard] == ["fault"]


def test_rearm_is_refused_with_cause_while_it_persists():
    robot = Survivor(
        {tick: nan for tick in range(50, 100)} | {79: lambda: robot.press("rearm") and math.nan}, asks=[70, 130]
    )
    outcome = robot.run()
    assert outcome.status == "ok" and robot.rig.sent().count(ENABLE) == 2
    assert [entry[:3] for entry in robot.heard] == [
        ("fault", "not finite", "knee"),
        ("refused", "not finite", "knee"),
        ("refused", "not finite", "knee"),
        ("rearm", "ok", None),
    ]
    assert robot.heard[1][3] == 70 and robot.heard[2][3] == 80


def test_exception_is_recoverable_and_reported_each_time():
    robot = Survivor({50: broken, 65: broken, 120: broken}, asks=[65, 80, 140])
    outcome = robot.run()
    assert outcome.status == "ok" and outcome.error is None
    assert [(fault.status, fault.culprit, fault.tick, str(fault.error)) for fault in outcome.faults] == [
        ("exception", "law", 50, "a wire has come loose"),
        ("exception", "law", 120, "a wire has come loose"),
    ]
    assert [entry[0] for entry in robot.heard] == ["fault", "refused", "rearm", "fault", "rearm"]


def test_a_run_survives_a_fault_in_its_first_tick():
    robot = Survivor({0: nan}, asks=[30])
    outcome = robot.run(100)
    assert outcome.status == "ok" and [fault.tick for fault in outcome.faults] == [0]


@pytest.mark.parametrize("status", [64, 70])
def test_status_of_custom_kernel_is_recoverable(status):
    @SIGNATURE
    def kernel(arena, slots, sizes):
        return status if arena[1] == 50.0 else 0  # the slot of the tick

    class Own(Block):
        y = Output("1")

    Own.kernel = Kernel(kernel, "y")
    robot = Survivor({}, asks=[80], more=lambda: Own(name="own"))
    outcome = robot.run(120)
    assert outcome.status == "ok" and [(fault.culprit, fault.tick) for fault in outcome.faults] == [("own", 50)]


def test_without_rearm_a_fault_ends_the_run():
    robot = Survivor({50: nan}, asks=[80])
    outcome = robot.run(rearm=None)
    assert (outcome.status, outcome.tick, outcome.faults) == ("not finite", 50, ()) and robot.rig.tick[-1] == 49
    assert ends_in_the_safe_stop(robot.rig) and not robot.heard


def test_a_stop_by_the_operator_ends_the_run():
    robot = Survivor({50: "stop"}, asks=[80])
    outcome = robot.run()
    assert outcome.status == "ok" and outcome.stopped and outcome.tick == 51 and robot.rig.sent().count(ENABLE) == 1


def test_a_stop_while_it_waits_ends_with_the_fault():
    robot = Survivor({50: nan, 80: "stop"})
    outcome = robot.run()
    assert (outcome.status, outcome.stopped, outcome.tick) == ("not finite", "keys", 50) and robot.rig.tick[-1] == 80


def test_another_process_that_fences_while_it_waits_ends_the_run_for_good():
    robot = Survivor({50: nan, 80: lambda: robot.rig.shared.raise_fence() or 2.0}, asks=[90])
    outcome = robot.run()
    assert (outcome.status, [fault.status for fault in outcome.faults]) == ("fenced", ["not finite"])
    assert robot.rig.sent().count(ENABLE) == 1 and ends_in_the_safe_stop(robot.rig)


def test_a_waiting_run_updates_its_heartbeat_and_monitors_the_guardian():
    beats, shared = [], SharedState(1 << 21)

    def live():
        beats.append(shared.beat)
        shared.look_after(time.monotonic_ns())
        return 2.0

    script = {tick: live for tick in range(200)} | {50: nan, 90: lambda: shared.look_after(0) or 2.0}
    robot = Survivor(script, shared=shared, guard=5.0)
    shared.look_after(time.monotonic_ns())
    outcome = robot.run()
    assert (outcome.status, [fault.status for fault in outcome.faults], robot.rig.tick[-1]) == (
        "unguarded",
        ["not finite"],
        90,
    )
    assert len(set(beats)) == len(beats) and beats == sorted(beats) and len(beats) > 80


def test_a_fence_ends_a_run_without_devices():
    with Diagram("thoughts", rate=RATE) as robot:
        Law({20: lambda: rig.shared.raise_fence() or 2.0}, name="law")(0.0)
    rig = Rig(robot)
    outcome = rig.run(100)
    assert outcome.status == "fenced" and rig.tick[-1] == 20


def test_in_real_time_the_rounds_of_a_stop_are_5_ms_apart_until_time_is_up():
    def plant(robot):
        model = plant_of(robot)
        with model:
            plant.thief = Thief(range(5 * 20, 5 * 10**6), name="thief")
            plant.thief()
        return model

    robot = Survivor({20: nan}, plant=plant, virtual=False)
    plant.thief.host = robot.rig.buses["can"].host
    outcome = robot.run(40, rearm=None)
    assert outcome.status == "not finite" and outcome.unconfirmed == ("knee",)
    times = [frame.time for frame in robot.rig.frames if frame.sent and frame.data == DISABLE]
    assert 30 <= len(times) <= 40  # of 200 ms; a machine that is busy misses some
    assert 0.15e9 < times[-1] - times[0] < 0.2e9 + 5e6
    assert np.median(np.diff(times)) == pytest.approx(5e6, abs=1e6)


def test_a_fence_of_another_process_ends_the_run_despite_rearm():
    robot = Survivor({50: lambda: robot.rig.shared.raise_fence() or 2.0}, asks=[80])
    assert robot.run().status == "fenced" and robot.rig.sent().count(ENABLE) == 1


def test_silent_drive_blocks_rearm_until_it_replies():
    def plant(robot):
        model = plant_of(robot)
        with model:
            plant.thief = Thief(range(5 * 50, 5 * 250), name="thief")
            plant.thief()
        return model

    robot = Survivor({}, asks=[150, 300], plant=plant)
    plant.thief.host = robot.rig.buses["can"].host
    outcome = robot.run(400)
    assert outcome.status == "ok" and [fault.status for fault in outcome.faults] == ["silent"]
    assert [entry[:3] for entry in robot.heard] == [
        ("fault", "silent", "knee"),
        ("refused", "silent", "knee"),
        ("rearm", "ok", None),
    ]
    assert robot.rig.sent().count(ENABLE) == 2 and outcome.faults[0].unconfirmed == ("knee",)


def test_fault_bit_blocks_rearm_until_drive_clears_it():
    def plant(robot):
        with Diagram("plant", rate=5 * RATE) as model:
            fault = Bit(range(5 * 50, 5 * 150), name="bit")()
            drive = EmulatedCubeMars.of(robot["knee"], name="drive")
            drive(position=0.0, velocity=0.0, fault=fault)
        return model

    robot = Survivor({}, asks=[100, 250], plant=plant)
    outcome = robot.run(300)
    assert outcome.status == "ok"
    assert [entry[:3] for entry in robot.heard] == [
        ("fault", "device fault", "knee"),
        ("refused", "device fault", "knee"),
        ("rearm", "ok", None),
    ]


def test_emergency_stop_blocks_rearm_until_released():
    robot = Survivor({}, asks=[80, 150], more=lambda: EmergencyStop()(Ask(set(range(50, 100)), name="button")()))
    outcome = robot.run()
    assert (outcome.status, [fault.status for fault in outcome.faults]) == ("ok", ["e-stop"])
    assert [entry[:2] for entry in robot.heard] == [("fault", "e-stop"), ("refused", "e-stop"), ("rearm", "ok")]
    assert [entry[3] for entry in robot.heard][:2] == [50, 80] and robot.rig.sent().count(ENABLE) == 2


def test_a_failing_plant_ends_the_run():
    def plant(robot):
        with Diagram("plant", rate=5 * RATE) as model:
            drive = EmulatedCubeMars.of(robot["knee"], name="drive")
            drive(position=0.0, velocity=0.0)
            Law({250: broken}, name="wall")(0.0)
        return model

    robot = Survivor({}, asks=[100], plant=plant)
    outcome = robot.run(300)
    assert (outcome.status, outcome.culprit) == ("exception", "wall") and not robot.heard


def test_at_most_sixteen_inputs_may_request_arming():
    robot = Survivor({})
    with pytest.raises(ValueError, match="at most 16 inputs can request arming again, not 17"):
        robot.run(rearm=list(range(17)))


@pytest.mark.parametrize("script, asks", [({50: nan}, (80, 90)), ({50: nan, 80: "rearm", 90: "rearm"}, ())])
def test_a_joint_with_an_ambiguous_angle_is_not_armed_again(script, asks):
    """As after a drive that lost its power and woke up elsewhere: asked for by an input, or by a letter."""
    robot, asked = Survivor(script, asks=asks), []

    def permitted():
        asked.append(len(robot.heard))
        return len(asked) in (1, 3)  # at the start; not at 80; at 90

    outcome = robot.run(permitted=permitted, answered=lambda: None)
    assert outcome.status == "ok" and len(asked) == 3
    assert [entry[:2] for entry in robot.heard] == [
        ("fault", "not finite"),
        ("refused", "unclear pose"),
        ("rearm", "ok"),
    ]
    refused, armed = robot.heard[1][3], robot.heard[2][3]
    assert 80 <= refused <= 82 and 90 <= armed <= 92 and set(robot.between()) <= {NOTHING, DISABLE}
