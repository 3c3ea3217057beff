"""The loop and its guardian: each monitors the other, and no other controller may command a guarded robot."""

import gc
import os
import signal
import subprocess
import time

import pytest

from blocks.actuators.mit_frames import DISABLE, ENABLE, NOTHING
from blocks.limiters import TorqueLimiter
from cext.memory.shared_state import SharedState
from cext.safety.suspend import time_suspended, was_paused
from cext.safety.thresholds import PAUSE_LIMIT
from graph import Block, Input, Output
from tests.cext.rigs import ends_in_the_safe_stop, one_drive

pytestmark = pytest.mark.timing

GUARD = 0.5  # s: before a run garbage is collected, which takes long among many tests


class Then(Block):
    """1 N·m; calls something at one tick."""

    u = Input("any")
    y = Output("N·m")

    def __init__(self, tick, action, **options):
        self.when, self.action = tick, action
        super().__init__(**options)

    def step(self, u, tick):
        if tick == self.when:
            self.action()
        return 1.0


def guarded(action=lambda: None, tick=20, *, shared=None, virtual=True, **options):
    """One drive under a guardian that has just looked. action : called in a tick"""
    shared = shared or SharedState(1 << 20)
    law = lambda knee: TorqueLimiter(limit=5.0)(Then(tick, action, name="then")(knee.position))  # noqa: E731
    rig = one_drive(law, virtual=virtual, options={"shared": shared, "guard": GUARD, **options})
    shared.look_after(time.monotonic_ns())
    return rig


def test_a_robot_under_a_guardian_runs():
    rig = guarded()
    assert rig.run(5).status == "ok" and len(rig.commands()) == 5


@pytest.mark.hazard("H8f")
def test_without_its_guardian_nothing_is_armed():
    for looked in (0, time.monotonic_ns() - round(2e9 * GUARD)):
        rig = guarded()
        rig.shared.look_after(looked)
        outcome = rig.run(50)
        assert (outcome.status, outcome.culprit, outcome.tick) == ("unguarded", None, -1)
        assert ENABLE not in rig.sent() and set(rig.sent()) == {NOTHING, DISABLE}


@pytest.mark.hazard("H8f")
def test_a_guardian_that_dies_ends_the_run_in_the_safe_stop():
    rig = guarded(lambda: rig.shared.look_after(0))
    outcome = rig.run(200)
    assert (
        (outcome.status, outcome.tick) == ("unguarded", 21) and ends_in_the_safe_stop(rig) and len(rig.commands()) == 21
    )


def test_a_guardian_that_dies_ends_the_run_at_the_next_tick():
    """Its last check is recent; the kernel reports the death of its thread."""
    shared = SharedState(1 << 20)
    alive, dying = os.pipe(), os.pipe()
    guardian = os.fork()
    if guardian == 0:
        shared.take_guard()
        os.write(alive[1], b"!")
        os.read(dying[0], 1)
        os._exit(0)
    os.read(alive[0], 1)

    def kill():
        os.write(dying[1], b"!")
        os.waitpid(guardian, 0)

    rig = guarded(kill, shared=shared)
    assert not shared.guardian_died
    outcome = rig.run(200)
    assert (
        (outcome.status, outcome.tick) == ("unguarded", 21) and ends_in_the_safe_stop(rig) and len(rig.commands()) == 21
    )
    assert shared.guardian_died and shared.guardian_died
    for descriptor in (*alive, *dying):
        os.close(descriptor)
    del rig, shared  # the dead guardian's mutex goes with its page: this thread's list of mutexes must not lead there
    gc.collect()
    another = SharedState(1 << 12)
    another.take_hold()
    another.let_go()


def test_a_guardian_that_stops_checking_ends_the_run():
    rig = guarded(lambda: rig.shared.look_after(time.monotonic_ns() - round(2e9 * GUARD)))
    outcome = rig.run(200)
    assert (outcome.status, outcome.tick) == ("unguarded", 21) and ends_in_the_safe_stop(rig)


@pytest.mark.hazard("H4d")
def test_a_loop_that_was_paused_with_its_guardian_sends_no_further_command():
    """The guardian resumes first, and grants the loop some time after its own delay."""
    words = ["sh", "-c", f"read tick; sleep {1.5e-9 * PAUSE_LIMIT}; kill -CONT $PPID"]
    resumer = subprocess.Popen(words, stdin=subprocess.PIPE)

    def pause():
        os.write(resumer.stdin.fileno(), b"20\n")
        os.kill(os.getpid(), signal.SIGSTOP)
        rig.shared.look_after(time.monotonic_ns())

    rig = guarded(pause, virtual=False)
    outcome = rig.run(200)
    resumer.communicate()
    assert (outcome.status, outcome.tick) == ("suspended", 20)
    assert len(rig.commands()) == 20 - rig.statistics()["missed"] and ends_in_the_safe_stop(rig)
    assert was_paused(rig.shared) and rig.shared.fenced and time_suspended(rig.shared) > PAUSE_LIMIT


@pytest.mark.hazard("H8f")
def test_a_loop_stops_the_drives_itself_where_the_stop_of_its_guardian_does_not_end():
    shared = SharedState(1 << 20)

    def stop_for_good():
        shared.raise_fence()
        shared.show_stop(True)

    rig = guarded(stop_for_good, shared=shared, guard=20.0)
    began = time.monotonic()
    assert rig.run(50).status == "fenced" and time.monotonic() - began < 10.0
    assert ends_in_the_safe_stop(rig)


def test_without_its_guardian_the_loop_sends_one_round_of_stop_frames():
    rig = guarded(lambda: rig.shared.look_after(0), carried=True)
    rig.run(200)
    assert rig.sent()[-2:] == [NOTHING, DISABLE] and rig.sent().count(DISABLE) == 1


def test_a_run_without_a_guardian_does_not_look_for_one():
    rig = guarded(lambda: rig.shared.look_after(0), guard=0.0)
    assert rig.run(50).status == "ok"


def test_each_tick_updates_the_heartbeat_of_the_loop():
    beats = []
    rig = guarded(lambda: beats.append((rig.shared.beat, time.monotonic_ns())))
    before = time.monotonic_ns()
    rig.run(30)
    [(beat, at)] = beats
    assert before < beat <= at and at < rig.shared.beat < time.monotonic_ns()


@pytest.mark.hazard("H4d")
def test_fence_raised_within_tick_blocks_its_frames():
    rig = guarded(lambda: rig.shared.raise_fence())
    outcome = rig.run(200)
    assert (outcome.status, outcome.tick) == ("fenced", 20) and len(rig.commands()) == 20 and ends_in_the_safe_stop(rig)


@pytest.mark.parametrize("data", [ENABLE, NOTHING, bytes.fromhex("ffff7ff0000007ff")])
def test_a_foreign_command_is_a_fault_before_the_next_own_command(data):
    rig = guarded(lambda: rig.buses["can"].device.send(1, data))
    outcome = rig.run(200)
    assert (outcome.status, outcome.culprit, outcome.tick) == ("foreign command", "knee", 21)
    assert len(rig.commands()) == 21 and ends_in_the_safe_stop(rig)


@pytest.mark.parametrize(
    "identifier, data, extended",
    [
        (1, b"", False),
        (1, NOTHING[:7], False),
        (1, NOTHING + b"!", False),  # as long as no command of ours
        (2, NOTHING, False),
        (1, NOTHING, True),
        (0, NOTHING, False),  # to somebody else
        (1, b"\1" + NOTHING[1:], False),  # a reply
    ],
)
def test_other_frames_are_not_foreign_commands(identifier, data, extended):
    rig = guarded(lambda: rig.buses["can"].device.send(identifier, data, extended))
    assert rig.run(50).status == "ok"


def test_after_the_fence_commands_are_those_of_the_guardian():
    def fence():
        rig.shared.raise_fence()
        rig.buses["can"].device.send(1, DISABLE)

    rig = guarded(fence)
    assert rig.run(50).status == "fenced"


def test_without_a_guardian_a_foreign_command_is_only_counted():
    rig = guarded(lambda: rig.buses["can"].device.send(1, ENABLE), guard=0.0)
    assert rig.run(50).status == "ok" and rig.statistics()["frames"]["malformed"] == 1
