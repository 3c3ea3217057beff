"""Other processes that write to the mailbox without rest, correctly or not: they never arm a robot, and never move a
value out of its bounds.

Each run is in a process of its own, so that damage to its memory is seen as its death.
"""

import mmap
import os
import random
import signal
import struct
import time

import pytest

from blocks.controllers import Impedance
from cext.memory.shared_state import SharedState
from cext.schedule.mailbox_writer import Writer
from graph import Diagram, Live
from tests.cext.rigs import Rig, one_drive
from tests.forking import exit_code, fork

pytestmark = pytest.mark.paced

LETTERS, LETTER_BYTES = 32, 240
KIND, COUNT, PARAMETER, VALUE = 16, 24, 32, 96  # offsets in a letter of cext/ring/mailbox.pxd
CONFIRM = 3  # a kind of request that is not a letter
SECONDS = 1.5
LONG = pytest.param(30.0, marks=pytest.mark.soak)


def letters_of(shared):
    """(memory of the page, offset of its first letter)"""
    memory = mmap.mmap(shared.fd, 0)
    writer = Writer(shared)
    ticket = writer.set([(0, 77.125)])
    at = memory.find(struct.pack("=d", 77.125)) - VALUE
    assert ticket == 0 and writer.withdraw(ticket)
    return memory, at


class Attack:
    """A process that calls act(writer, memory, offset of a letter, random) for letters at random until it is killed."""

    def __init__(self, shared, memory, first, act):
        def work():
            chance, writer = random.Random(os.getpid()), Writer(shared)
            while True:
                act(writer, memory, first + LETTER_BYTES * chance.randrange(LETTERS), chance)

        self.pid = fork(work)

    def end(self):
        os.kill(self.pid, signal.SIGKILL)
        os.waitpid(self.pid, 0)


def post_and_withdraw(writer, memory, letter, chance):
    """Set a value in bounds, and take it back, by a correct writer."""
    ticket = writer.set([(0, 5.0)])
    if ticket is not None and not writer.withdraw(ticket):
        while writer.answer(ticket) is None:
            pass


def damage_kind(writer, memory, letter, chance):
    memory[letter + KIND : letter + KIND + 4] = struct.pack("=i", chance.choice((CONFIRM, CONFIRM, 4, 0, 77)))


def damage_content(writer, memory, letter, chance):
    """Change what a posted letter requests."""
    offset, content = chance.choice(
        (
            (VALUE, struct.pack("=d", chance.choice((10001.0, float("nan"), -1e300)))),
            (PARAMETER, struct.pack("=i", chance.choice((1 << 30, -5, 1)))),
            (COUNT, struct.pack("=i", chance.choice((1 << 30, -1, 16)))),
            (KIND, struct.pack("=i", chance.choice((0, 1, 2, CONFIRM, 4, 77)))),
        )
    )
    memory[letter + offset : letter + offset + len(content)] = content


def stop_after(shared, seconds):
    """A process that stops the run."""

    def work(writer, memory, letter, chance):
        time.sleep(seconds)
        while True:
            writer.stop()
            time.sleep(0.001)

    return Attack(shared, None, 0, work)


@pytest.mark.hazard("H4a")
@pytest.mark.parametrize("seconds", [SECONDS, LONG])
@pytest.mark.parametrize(
    "attacks",
    [pytest.param((post_and_withdraw,), marks=pytest.mark.soak), (post_and_withdraw, damage_kind)],
    ids=["correct", "with damaged kinds"],
)
def test_another_process_that_posts_changes_never_arms_a_robot_that_waits(seconds, attacks):
    def work():
        shared = SharedState(1 << 22)
        rig = one_drive(lambda drive: 1.0, rate=1000, virtual=False, options={"shared": shared})
        memory, first = letters_of(shared)
        for letter in range(LETTERS):  # as left by earlier requests
            place = first + letter * LETTER_BYTES + KIND
            memory[place : place + 4] = struct.pack("=i", CONFIRM)
        running = [Attack(shared, memory, first, act) for act in attacks] + [stop_after(shared, seconds)]
        try:
            outcome = rig.run(200_000, answered=lambda: None, confirm=True)
        finally:
            for attack in running:
                attack.end()
        assert len(rig.tick) == 0 and outcome.tick == -1 and CONFIRM not in {change.kind for change in rig.changes}
        # on a machine that is too busy for 1000 Hz the run may end early instead
        assert outcome.stopped or outcome.status in ("silent", "no answer"), outcome

    assert exit_code(fork(work)) == 0


@pytest.mark.parametrize("seconds", [SECONDS, LONG])
def test_no_damage_to_a_letter_moves_a_value_out_of_bounds(seconds):
    def work():
        with Diagram("springs", rate=2000) as diagram:
            Impedance(stiffness=Live(3.0, max=10.0), damping=Live(1.0, max=10.0), name="spring")(
                position=1.0, velocity=1.0
            )
        shared = SharedState(1 << 24)
        rig = Rig(diagram, shared=shared, virtual=False)
        memory, first = letters_of(shared)
        running = [Attack(shared, memory, first, act) for act in (post_and_withdraw, damage_content, damage_content)]
        running.append(stop_after(shared, seconds))
        try:
            outcome = rig.run(200_000)
        finally:
            for attack in running:
                attack.end()
        assert outcome.status == "ok" and rig.time[-1] > 0.8 * seconds, "no damaged letter stops it"
        assert rig["spring.torque"].min() >= -20.0 and rig["spring.torque"].max() <= 0.0
        assert all(0.0 <= change.value <= 10.0 for change in rig.changes if change.kind == 0)

    assert exit_code(fork(work)) == 0
