"""The mailbox between processes: every letter is taken once, in its writer's order, whoever else writes or dies."""

import mmap
import os
import struct
import time
from collections import defaultdict

import pytest

from blocks.controllers import Impedance
from cext.memory.shared_state import SharedState
from cext.schedule.mailbox_writer import Writer
from graph import Block, Diagram, Output
from tests.cext.rigs import Rig
from tests.forking import exit_code, fork

pytestmark = pytest.mark.timing

WRITERS, LETTERS_EACH, ROOM = 4, 60, 32


def springs(count, **options):
    with Diagram("springs", rate=2000) as diagram:
        for number in range(count):
            Impedance(name=f"spring_{number}")(position=1.0, velocity=0.0)
    return Rig(diagram, **options)


def patient(look):
    """What `look` gives once it is something."""
    while (found := look()) is None:
        time.sleep(0.0002)
    return found


def write_and_wait(shared, index, told):
    """Letter after letter, each once the one before is answered. The reported ticks go into a pipe."""
    writer = Writer(shared)
    for number in range(1, LETTERS_EACH + 1):
        ticket = patient(lambda: writer.set([(index, number / 10.0)]))
        answer = patient(lambda: writer.answer(ticket))
        assert answer[0] == "taken"
        os.write(told, struct.pack("=q", answer[1]))


def test_concurrent_writers_receive_the_recorded_ticks():
    rig = springs(WRITERS, virtual=False)
    parameters = [index for index, live in enumerate(rig.schedule.live) if live.name == "damping"]
    pipes = {index: os.pipe() for index in parameters}

    def keeper():
        children = [fork(lambda: write_and_wait(rig.shared, index, pipes[index][1])) for index in parameters]
        ends = [exit_code(child) == 0 for child in children]
        Writer(rig.shared).stop()
        assert all(ends)

    child = fork(keeper)
    outcome = rig.run(20_000)
    assert exit_code(child) == 0 and outcome.stopped
    recorded = defaultdict(list)
    for change in rig.changes[:-1]:
        recorded[change.index].append((change.value, change.tick))
    assert len({change.writer for change in rig.changes}) == WRITERS + 1
    for index, (reader, writer) in pipes.items():
        told = struct.unpack(f"={LETTERS_EACH}q", os.read(reader, 1 << 16))
        assert recorded[index] == [(number / 10.0, tick) for number, tick in enumerate(told, 1)]
        # a writer that is answered while the loop still takes letters may be answered twice in a tick
        assert list(told) == sorted(told)
        os.close(reader)
        os.close(writer)


def test_full_mailbox_refuses_until_requests_are_answered():
    rig = springs(1)
    writer = Writer(rig.shared)
    tickets = [writer.set([(0, float(number))]) for number in range(ROOM)]
    assert sorted(tickets) == list(range(ROOM)) and writer.set([(0, 1.0)]) is None and writer.mark() is None
    rig.run(3)
    assert [change.value for change in rig.changes] == [float(number) for number in range(ROOM)]
    assert writer.set([(0, 1.0)]) is None, "answers that nobody has read keep their place"
    assert {writer.answer(ticket) for ticket in tickets} == {("taken", 0, 0)}
    assert writer.set([(0, 1.0)]) is not None


def test_a_request_that_a_run_has_not_taken_is_answered_at_its_end():
    class Late(Block):
        y = Output("1")

        def step(self, tick):
            if tick == 9:
                tickets.append(writer.set([(0, 1.0)]))
            return 0.0

    tickets = []
    with Diagram("springs", rate=2000) as diagram:
        Impedance(name="spring")(position=1.0, velocity=0.0)
        Late(name="late")
    rig = Rig(diagram)
    writer = Writer(rig.shared)
    assert rig.run(10).status == "ok" and rig.changes == []
    assert writer.answer(tickets[0]) == ("over", -1, 0)


def test_withdrawn_request_is_never_applied():
    rig = springs(1)
    writer = Writer(rig.shared)
    first, second = writer.set([(0, 40.0)]), writer.set([(0, 50.0)])
    assert writer.withdraw(second) and not writer.withdraw(second)
    rig.run(3)
    assert [change.value for change in rig.changes] == [40.0]
    assert not writer.withdraw(first) and writer.answer(first) == ("taken", 0, 0)


def test_requests_of_dead_processes_are_reclaimed():
    rig = springs(1)

    def post_and_die():
        writer = Writer(rig.shared)
        for number in range(ROOM):
            writer.set([(0, float(number))])

    assert exit_code(fork(post_and_die)) == 0
    writer = Writer(rig.shared)
    assert writer.set([(0, 1.0)]) is None, "they are complete, and wait for the loop"
    rig.run(2)
    assert len(rig.changes) == ROOM
    assert [writer.set([(0, 1.0)]) is not None for _ in range(ROOM + 1)] == [True] * ROOM + [False]


def test_request_left_incomplete_by_dead_process_blocks_no_other():
    rig = springs(1)
    dead = fork(lambda: None)
    assert exit_code(dead) == 0
    writer = Writer(rig.shared)
    for _number in range(ROOM):
        writer.set([(0, 64.0078125)])
    memory = mmap.mmap(rig.shared.fd, 0)
    posted, half = struct.pack("=Q", os.getpid() << 32 | 1 << 8 | 2), struct.pack("=Q", dead << 32 | 1 << 8 | 1)
    at = memory.find(posted)
    memory[at : at + 8] = half  # as if killed between claiming and posting
    rig.run(2)
    assert len(rig.changes) == ROOM - 1
    assert writer.set([(0, 50.0)]) is not None


def test_the_idle_mailbox_of_a_page_changes_nothing_between_runs():
    shared = SharedState(1 << 20)
    rig = springs(2, shared=shared)
    rig.run(50)
    first = {name: values.copy() for name, values in rig.signals.items()}
    rig.run(50)
    assert all((first[name] == values).all() for name, values in rig.signals.items()) and rig.changes == []
