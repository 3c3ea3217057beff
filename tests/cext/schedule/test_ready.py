"""Between arming and tick 0: replies are shown, and nothing is enabled until the operator confirms. In virtual time."""

import math
import time

import pytest

from blocks.actuators import CubeMars, EmulatedCubeMars
from blocks.actuators.mit_frames import DISABLE, ENABLE, NOTHING
from blocks.limiters import TorqueLimiter
from cext.schedule.mailbox_writer import Writer
from graph import Block, Diagram, Output
from tests.cext.rigs import Rig, ends_in_the_safe_stop

ANSWERED = 5 * 3  # plant ticks after which the drive has answered, and some


class Person(Block):
    """In the plant: writes letters, and gives the drive a fault or takes its answers away. script : {plant tick: what
    is called}
    """

    fault = Output("1", dtype=int)

    def __init__(self, script, **options):
        self.script = script
        super().__init__(**options)

    def step(self, tick):
        return self.script.get(tick, int)() or 0


class Ready:
    def __init__(self, script, more=lambda: None):
        with Diagram("robot", rate=200) as robot:
            drive = CubeMars("AK10-9-V2.0", can_id=1, name="knee")
            drive(torque_command=TorqueLimiter(limit=5.0, name="limiter")(2.0))
        with Diagram("plant", rate=1000) as plant:
            fault = Person({tick: self.act(action) for tick, action in script.items()}, name="person")()
            EmulatedCubeMars.of(robot["knee"], name="drive")(position=0.3, velocity=0.0, fault=fault)
            more()
        self.rig = Rig(robot, plant)
        self.writer = Writer(self.rig.shared, "keys")
        self.shown = []

    def act(self, action):
        return (lambda: self.press(action)) if isinstance(action, str) else action

    def press(self, what):
        if what == "stop":
            self.writer.stop()
        else:
            self.writer.confirm(self.rig.shared.question)

    def show(self):
        self.shown.append(
            (self.rig.shared.state, self.rig.control.values[self.rig.schedule.signals["knee.position"].slot])
        )

    def torques(self):
        """How many torque commands were sent."""
        return sum(data not in (ENABLE, NOTHING, DISABLE) for data in self.rig.sent())

    def run(self, ticks=20, confirm=True, **options):
        return self.rig.run(ticks, fade=0.0, answered=self.show, confirm=confirm, **options)


def test_ready_state_asks_a_disabled_drive_until_confirmation():
    ready = Ready({500: "confirm"})
    assert ready.run().status == "ok"
    [(state, position)] = ready.shown
    assert state == "arming" and position == pytest.approx(0.3, abs=1e-3)
    sent = ready.rig.sent()
    assert sent.count(ENABLE) == 1
    waited = sent[: sent.index(ENABLE)]
    assert set(waited) == {DISABLE} and 100 <= len(waited) <= 104  # 500 ticks of the plant are 100 rounds
    assert ready.torques() == 20 and list(ready.rig.tick) == list(range(20))
    assert [change.kind for change in ready.rig.changes] == [3] and ready.rig.changes[0].tick == -1


def test_run_starts_at_once_without_confirmation_prompt():
    ready = Ready({})
    assert ready.run(confirm=False).status == "ok" and len(ready.shown) == 1
    assert ready.torques() == 20 and ready.rig.sent().count(NOTHING) < 6


def test_a_stop_ends_it_without_a_tick():
    ready = Ready({500: "stop"})
    outcome = ready.run()
    assert outcome.status == "ok" and outcome.stopped and outcome.tick == -1 and len(ready.rig.tick) == 0
    assert set(ready.rig.sent()) == {NOTHING, DISABLE} and ends_in_the_safe_stop(ready.rig)


def test_a_confirmation_before_the_table_was_shown_does_not_count():
    ready = Ready({0: "confirm", 500: "stop"})
    assert ready.run().tick == -1 and ready.torques() == 0


@pytest.mark.parametrize(
    "question, age, armed",
    [(0, 0.0, True), (0, 0.5, False), (0, 1.1, False), (0, -0.1, False), (-1, 0.0, False), (1, 0.0, False)],
    ids=["now", "before the question", "long ago", "in the future", "of the question before", "of no question yet"],
)
def test_a_confirmation_counts_for_the_newest_question_after_it_was_asked(question, age, armed):
    """question : relative to the newest one; age : s before the confirmation at which the key was pressed"""

    def confirm():
        pressed = time.monotonic_ns() - round(age * 1e9)
        ready.writer.confirm(ready.rig.shared.question + question, pressed)
        return 0

    ready = Ready({100: confirm, 500: "stop"})
    assert ready.run().status == "ok" and ready.torques() == (20 if armed else 0)


def test_a_confirmation_counts_once():
    """One that was refused does not arm once the joint is clear."""
    ready, asked = Ready({500: "confirm", 900: "stop"}), []
    assert ready.run(permitted=lambda: bool(asked) or bool(asked.append(True))).tick == -1
    assert asked == [True] and ready.torques() == 0


def test_waiting_for_confirmation_does_not_count_as_arming():
    ready = Ready({5000: "confirm"})
    assert ready.run(arming_timeout=0.1).status == "ok"  # 5 s later
    assert ready.torques() == 20


def test_a_drive_fault_during_confirmation_ends_the_run():
    ready = Ready({tick: lambda: 5 for tick in range(300, 1000)})
    outcome = ready.run()
    assert (outcome.status, outcome.culprit, outcome.tick) == ("device fault", "knee", -1)
    assert set(ready.rig.sent()) == {NOTHING, DISABLE} and ends_in_the_safe_stop(ready.rig)


def test_a_drive_that_becomes_silent_during_confirmation_ends_the_run():
    ready = Ready({tick: lambda: ready.rig.buses["can"].host.receive() and 0 for tick in range(301, 2000)})
    outcome = ready.run()
    assert (outcome.status, outcome.culprit, outcome.tick) == ("silent", "knee", -1)
    assert set(ready.rig.sent()) == {NOTHING, DISABLE}


def test_a_fence_during_the_wait_ends_the_run():
    ready = Ready({300: lambda: ready.rig.shared.raise_fence()})
    assert ready.run().status == "fenced"


def test_failure_to_show_ready_state_prevents_arming():
    ready = Ready({})
    ready.show = lambda: 1 / 0
    outcome = ready.run()
    assert outcome.status == "exception" and isinstance(outcome.error, ZeroDivisionError) and outcome.tick == -1
    assert set(ready.rig.sent()) == {NOTHING, DISABLE}


# Where joints stand


def test_a_joint_with_an_ambiguous_angle_is_armed_once_it_is_resolved():
    ready, asked = Ready({500: "confirm", 700: "confirm", 900: "confirm"}), []

    def permitted():
        asked.append(ready.rig.shared.state)
        return len(asked) == 3

    assert ready.run(permitted=permitted).status == "ok"
    assert asked == ["ready"] * 3 and ready.torques() == 20
    sent = ready.rig.sent()
    waited = sent[: sent.index(ENABLE)]
    assert set(waited) == {DISABLE} and 180 <= len(waited) <= 184, "900 ticks of the plant are 180 rounds"
    assert [change.kind for change in ready.rig.changes] == [3], "only the confirmation that has armed"


def test_an_ambiguous_joint_ends_an_unattended_run_without_enabling():
    ready = Ready({})
    outcome = ready.run(confirm=False, permitted=lambda: False)
    assert (outcome.status, outcome.tick) == ("unclear pose", -1) and len(ready.rig.tick) == 0
    assert set(ready.rig.sent()) == {NOTHING, DISABLE} and ends_in_the_safe_stop(ready.rig)


@pytest.mark.parametrize("confirm", [False, True])
def test_exception_in_pose_check_prevents_arming(confirm):
    ready = Ready({500: "confirm"})
    outcome = ready.run(confirm=confirm, permitted=lambda: 1 / 0)
    assert outcome.status == "exception" and isinstance(outcome.error, ZeroDivisionError) and ready.torques() == 0


@pytest.mark.parametrize(
    "presses, armed",
    [
        (((200, 1500),), True),  # plant ticks of 1 ms, in which the button is pressed
        (((200, 1100), (1150, 2000)), False),  # never for 1 s without a break
        (((0, 3000),), False),  # a button that sticks
        (((0, 500), (600, 2000)), True),
    ],
)
def test_input_arms_when_held_for_a_second_after_it_was_released(presses, armed):
    class Button(Block):
        y = Output("rad")

        def step(self, tick):
            return 0.505 if any(begin <= tick < end for begin, end in presses) else 0.495  # above 0.5: pressed

    with Diagram("robot", rate=200) as robot:
        CubeMars("AK10-9-V2.0", can_id=1, name="knee")(torque_command=1.0)
    with Diagram("plant", rate=1000) as plant:
        EmulatedCubeMars.of(robot["knee"], name="drive")(
            position=Button()(), velocity=0.0, fault=Person({2500: lambda: writer.stop() and 0})()
        )
    rig = Rig(robot, plant)
    writer = Writer(rig.shared, "keys")
    slot = rig.schedule.signals["knee.position"].slot
    outcome = rig.run(20, fade=0.0, answered=lambda: None, confirm=True, arm_slot=slot)
    assert outcome.status == "ok" and len(rig.tick) == (20 if armed else 0)


@pytest.mark.parametrize("gap, armed", [(math.nan, False), (0.0, True)])
def test_an_input_that_is_nan_was_not_released(gap, armed):
    """A button that sticks, of a sensor that fails for a moment."""

    class Stuck(Block):
        y = Output("1")

        def step(self, tick):
            ready.rig.control.values[slot] = gap if 500 <= tick < 520 else 1.0
            return 0.0

    ready = Ready({3000: "stop"}, more=lambda: Stuck(name="stuck"))
    slot = ready.rig.schedule.signals["limiter.limited"].slot  # not computed while it waits
    assert ready.run(arm_slot=slot).status == "ok" and ready.torques() == (20 if armed else 0)
