"""Live parameters in the loop: when a change takes effect, how it ramps, what is refused, and what is recorded of
it.
"""

import math
import mmap
import os
import struct

import numpy as np
import pytest

from blocks.controllers import Impedance
from blocks.limiters import TorqueLimiter
from cext.memory.shared_state import RECORD_EVENT, SharedState
from cext.schedule.mailbox_writer import CHANGE_LIMIT, Writer
from graph import Block, Diagram, Live, Output, Param
from tests.blocks.actuators import reference
from tests.cext.rigs import Rig, ends_in_the_safe_stop, one_drive

RATE = 200
SET, MARK, STOP = range(3)


class Poster(Block):
    """Posts from within tick k what the loop then takes at the start of tick k + 1. script : {tick: what to do with a
    Writer}
    """

    y = Output("any")

    def step(self, tick):
        if tick in self.script:
            self.script[tick](self.writer)
        return 0.0


class Settings(Block):
    """A parameter of each type, as a Python block has them."""

    gain = Param(1.0, "1", min=0.0, max=2.0, live=True, slew=20.0)
    turns = Param(3, "1", min=0, max=40, live=True, slew=1.0)
    on = Param(True, "1", min=False, max=True, live=True)
    number = Output("1")
    kind = Output("1", dtype=int)

    def step(self):
        kinds = [type(value) for value in (self.gain, self.turns, self.on)]
        return (self.gain if self.on else -1.0) + 100.0 * self.turns, kinds == [float, int, bool]


def rig(make, script=(), **options):
    """A rig of what `make` wires, with a Poster that follows the script. Live parameters are counted by path."""
    with Diagram("live", rate=RATE) as diagram:
        make()
        poster = Poster(name="z_poster")
    found = Rig(diagram, **options)
    poster.script, poster.writer = dict(script), Writer(found.shared)
    found.names = [live.path for live in found.schedule.live]
    return found


def spring(slew=math.inf, **options):
    """τ = -K · 1 rad: minus the stiffness, which is live."""
    Impedance(stiffness=Live(30.0, max=120.0, slew=slew), name="spring", **options)(position=1.0, velocity=0.0)


def stiffness(found):
    return -found["spring.torque"]


def test_a_change_takes_effect_at_the_start_of_the_recorded_tick():
    found = rig(spring, {9: lambda writer: writer.set([(0, 45.0)])})
    assert found.names[:2] == ["spring.stiffness", "spring.damping"]
    assert not found.run(20).faulted
    np.testing.assert_array_equal(stiffness(found), [30.0] * 10 + [45.0] * 10)
    assert found.changes == [(10, SET, 0, os.getpid(), 0, 45.0, 30.0, math.inf)]


def test_a_change_posted_before_the_run_applies_from_the_first_tick():
    found = rig(spring)
    writer = Writer(found.shared, "keys")
    ticket = writer.set([(0, 60.0)])
    assert writer.answer(ticket) is None
    found.run(3)
    assert list(stiffness(found)) == [60.0] * 3 and found.changes[0].tick == 0 and found.changes[0].origin == 1
    assert writer.answer(ticket) == ("taken", 0, 0)


def test_ramp_steps_by_slew_times_dt_and_ends_exactly():
    found = rig(lambda: spring(slew=50.0), {4: lambda writer: writer.set([(0, 31.1)])})
    found.run(15)
    steps = 50.0 / RATE * np.arange(1, 5)
    np.testing.assert_allclose(stiffness(found), [30.0] * 5 + list(30.0 + steps) + [31.1] * 6, rtol=0, atol=1e-12)
    assert stiffness(found)[9] == 31.1 and found.changes == [(5, SET, 0, os.getpid(), 0, 31.1, 30.0, 50.0)]


def test_a_change_during_a_ramp_starts_from_the_present_value():
    found = rig(
        lambda: spring(slew=200.0),
        {0: lambda writer: writer.set([(0, 100.0)]), 10: lambda writer: writer.set([(0, 35.0)])},
    )
    found.run(20)
    assert [(change.tick, change.before, change.value) for change in found.changes] == [
        (1, 30.0, 100.0),
        (11, 40.0, 35.0),
    ]
    np.testing.assert_allclose(stiffness(found)[8:17], [38, 39, 40, 39, 38, 37, 36, 35, 35], rtol=0, atol=1e-12)


def test_attributes_of_python_blocks_keep_their_types_and_whole_ones_do_not_ramp():
    found = rig(
        lambda: Settings(name="settings"),
        {1: lambda writer: writer.set([(0, 1.25), (1, 7.0), (2, 0.0)]), 8: lambda writer: writer.set([(2, 1.0)])},
    )
    assert found.names == ["settings.gain", "settings.turns", "settings.on"]
    block = found.schedule.live[0].block
    assert not found.run(12).faulted
    assert list(found["settings.number"]) == [301.0] * 2 + [699.0] * 7 + [701.25] * 3
    assert set(found["settings.kind"]) == {1}
    assert (block.gain, block.turns, block.on) == (1.0, 3, True), "a run leaves the diagram as it was built"


def test_a_ramp_of_a_python_parameter_ends_at_its_target():
    found = rig(lambda: Settings(name="settings"), {1: lambda writer: writer.set([(0, 1.25)])})
    found.run(8)
    np.testing.assert_allclose(
        found["settings.number"], [301.0, 301.0, 301.1, 301.2, 301.25, 301.25, 301.25, 301.25], rtol=0, atol=1e-9
    )
    assert found.statistics()["gil_taken"] == 8 + 3, "once a tick for the steps, and once more while the ramp goes"


def test_slow_block_receives_value_at_its_next_step():
    found = rig(lambda: spring(every=4), {1: lambda writer: writer.set([(0, 50.0)])})
    found.run(10)
    assert list(stiffness(found)) == [30.0] * 4 + [50.0] * 6 and found.changes[0].tick == 2


def test_changes_of_one_request_take_effect_together_and_requests_in_order():
    def post(writer):
        for value in (40.0, 41.0, 42.0):
            writer.set([(0, value), (1, value / 10.0)])

    found = rig(spring, {2: post})
    found.run(5)
    assert [(change.tick, change.index, change.value) for change in found.changes] == [
        (3, 0, 40.0),
        (3, 1, 4.0),
        (3, 0, 41.0),
        (3, 1, 4.1),
        (3, 0, 42.0),
        (3, 1, 4.2),
    ]
    assert list(stiffness(found)) == [30.0] * 3 + [42.0] * 2


@pytest.mark.parametrize(
    "changes, verdict",
    [
        ([("spring.stiffness", 120.1)], "out of bounds"),
        ([("spring.stiffness", -1e-9)], "out of bounds"),
        ([("spring.stiffness", math.nan)], "out of bounds"),
        ([("spring.stiffness", math.inf)], "out of bounds"),
        ([("turning.turns", 5.5)], "out of bounds"),
        ([("turning.on", 0.5)], "out of bounds"),
        ([("spring.stiffness", 50.0), ("spring.damping", 1e9)], "out of bounds"),
        ([(99, 1.0)], "unknown"),
        ([(-1, 1.0)], "unknown"),
        ([], "unknown"),
    ],
)
def test_the_loop_rejects_invalid_live_changes(changes, verdict):
    def make():
        spring()
        Settings(name="turning")

    found = rig(make)
    writer = Writer(found.shared)
    ticket = writer.set(
        [(found.names.index(name) if isinstance(name, str) else name, value) for name, value in changes]
    )
    found.run(5)
    assert writer.answer(ticket)[0] == verdict
    assert found.changes == [] and list(stiffness(found)) == [30.0] * 5 and set(found["turning.number"]) == {301.0}


def memory_of(shared):
    return mmap.mmap(shared.fd, 0)


def letter_with(memory, value):
    """Return the offset of the letter with this first value.

    cext/ring/mailbox.pxd: state, number, four words, parameters, values.
    """
    at = memory.find(struct.pack("=d", value))
    assert at >= 0
    return at - 96


SCRIBBLES = {
    "value": (96, struct.pack("=d", 1e9)),
    "nan": (96, struct.pack("=d", math.nan)),
    "index": (32, struct.pack("=i", 1 << 30)),
    "negative index": (32, struct.pack("=i", -5)),
    "count": (24, struct.pack("=i", 1 << 30)),
    "negative count": (24, struct.pack("=i", -1)),
    "kind": (16, struct.pack("=i", 77)),
}


@pytest.mark.parametrize("what", SCRIBBLES)
def test_corrupted_change_request_has_no_effect(what):
    found = rig(spring)
    writer = Writer(found.shared)
    wild = writer.set([(0, 77.125)])
    good = writer.set([(1, 5.5)])
    memory = memory_of(found.shared)
    offset, content = SCRIBBLES[what]
    at = letter_with(memory, 77.125) + offset
    memory[at : at + len(content)] = content
    assert not found.run(5).faulted
    assert writer.answer(wild)[0] in ("out of bounds", "unknown") and writer.answer(good) == ("taken", 0, 0)
    assert list(stiffness(found)) == [30.0] * 5 and [change.index for change in found.changes] == [1]


@pytest.mark.hazard("H1g")
def test_no_mailbox_value_moves_a_command_beyond_the_proved_bounds():
    """The limiter's own limit is live up to 12 N·m; 100 N·m are asked for all the time."""
    rig = one_drive(lambda drive: TorqueLimiter(limit=Live(9.0, max=12.0), name="limiter")(100.0))
    [proof] = [proof for proof in rig.schedule.proofs if proof.port == "torque_command"]
    assert proof.interval.high == 12.0
    index = [live.path for live in rig.schedule.live].index("limiter.limit")
    writer = Writer(rig.shared)
    tickets = {
        value: writer.set([(index, value)]) for value in (12.0 + 1e-9, 1e9, math.inf, math.nan, -math.inf, -1.0, 12.0)
    }
    poked = writer.set([(index, 7.0078125)])
    memory = memory_of(rig.shared)
    at = letter_with(memory, 7.0078125) + 96
    memory[at : at + 8] = struct.pack("=d", 65.0)
    assert not rig.run(300, fade=0.0).faulted
    assert {value for value, ticket in tickets.items() if writer.answer(ticket)[0] == "taken"} == {12.0}
    assert writer.answer(poked)[0] == "out of bounds"
    limits = reference.ranges(velocity=50.0, torque=65.0)
    commands = [reference.read_command(limits, data)["torque"] for data in rig.commands()]
    assert max(commands) == pytest.approx(12.0, abs=130.0 / 4095) and max(rig["limiter.limited"]) == 12.0


def test_a_second_run_starts_from_the_built_values():
    def make():
        spring(slew=50.0)
        Settings(name="settings")

    def change(writer):
        writer.set([(found.names.index("spring.stiffness"), 100.0), (found.names.index("settings.gain"), 2.0)])

    found = rig(make, {3: change})
    found.run(10)
    first = found["spring.torque"].copy(), found["settings.number"].copy()
    assert first[0][-1] < -30.5 and first[1][-1] > 301.0
    found.run(10)
    np.testing.assert_array_equal(first, (found["spring.torque"], found["settings.number"]))
    assert found["spring.torque"][0] == -30.0 and found["settings.number"][0] == 301.0


def test_marks_are_numbered_from_one_in_every_run():
    found = rig(spring, {2: lambda writer: (writer.mark(), writer.mark()), 5: lambda writer: writer.mark()})
    for _ in range(2):
        found.run(9)
        assert [(change.tick, change.kind, change.value) for change in found.changes] == [
            (3, MARK, 1.0),
            (3, MARK, 2.0),
            (6, MARK, 3.0),
        ]


def test_a_stop_ends_the_run_in_the_safe_stop_without_a_fault():
    rig = one_drive(lambda drive: TorqueLimiter(limit=9.0)(Poster(name="poster")()))
    poster = rig.schedule.python_blocks[0]
    poster.script, poster.writer = {49: lambda writer: writer.stop()}, Writer(rig.shared, "keys")
    outcome = rig.run(200)
    assert (outcome.status, outcome.stopped, outcome.signal, outcome.tick) == ("ok", "keys", 0, 50)
    assert list(rig.tick) == list(range(50)) and ends_in_the_safe_stop(rig)
    assert [change[:3] for change in rig.changes] == [(50, STOP, 1)]
    poster.script = {}
    assert not rig.run(20).stopped and len(rig.tick) == 20


def test_stop_is_handled_while_arming_and_change_waits_for_tick_0():
    rig = one_drive(lambda drive: TorqueLimiter(limit=Live(9.0, max=12.0))(1.0), plant=False)  # nobody ever answers
    writer = Writer(rig.shared)
    change = writer.set([(0, 10.0)])
    assert writer.stop() and not writer.stop()
    outcome = rig.run(200)
    assert outcome.stopped == f"set {os.getpid()}" and outcome.tick == -1 and outcome.status == "ok"
    assert writer.answer(change) == ("over", -1, 0)
    assert [change[:2] for change in rig.changes] == [(-1, STOP)]


def test_change_waits_while_ring_is_full():
    shared = SharedState(1 << 12)
    found = rig(spring, shared=shared)
    while shared.push(RECORD_EVENT, b"x" * 8):
        pass
    writer = Writer(shared)
    ticket = writer.set([(0, 50.0)])
    assert not found.executor.run(5).faulted
    assert (
        writer.answer(ticket) == ("over", -1, 0)
        and found.control.values[found.schedule.parameters["spring.stiffness"]] == 30.0
    )
    shared.drain(1 << 20)
    ticket = writer.set([(0, 50.0)])
    found.run(5)
    assert writer.answer(ticket)[0] == "taken" and list(stiffness(found)) == [50.0] * 5


def test_the_page_shows_values_and_targets():
    live = 2, b"two parameters"
    shared = SharedState(1 << 16, live=live)
    found = rig(lambda: spring(slew=200.0), {2: lambda writer: writer.set([(0, 40.0), (1, 2.0)])}, shared=shared)
    seen = {}
    poster = found.schedule.python_blocks[0]
    poster.script |= {tick: lambda writer, tick=tick: seen.update({tick: shared.live_values()}) for tick in (0, 3, 30)}
    found.run(35)
    assert shared.live == b"two parameters" and SharedState(fd=shared.fd).live == shared.live
    assert seen == {0: [(30.0, 30.0), (1.0, 1.0)], 3: [(31.0, 40.0), (1.05, 2.0)], 30: [(40.0, 40.0), (2.0, 2.0)]}


def test_exception_in_attribute_setter_is_a_fault_of_its_block():
    class Guarded(Block):
        """Rejects a gain above 1, which it does not declare."""

        gain = Param(0.5, "1", min=0.0, max=2.0, live=True, slew=math.inf)
        y = Output("1")

        def __setattr__(self, name, value):
            if name == "gain" and value > 1.0:
                raise RuntimeError("too much")
            super().__setattr__(name, value)

        def step(self):
            return self.gain

    found = rig(lambda: Guarded(name="guarded"), {3: lambda writer: writer.set([(0, 1.5)])})
    outcome = found.run(10)
    assert (outcome.status, outcome.culprit, outcome.tick, str(outcome.error)) == (
        "exception",
        "guarded",
        4,
        "too much",
    )


def test_a_request_has_a_limited_number_of_changes():
    writer = Writer(SharedState(1 << 12))
    with pytest.raises(ValueError, match="16 changes"):
        writer.set([(0, 1.0)] * (CHANGE_LIMIT + 1))
