"""`hold_exceptions`: a Python block may raise a few times in a row while its outputs stay, and not once more."""

import json
import math

import numpy as np
import pytest

from blocks.limiters import TorqueLimiter
from blocks.sources import Constant
from cext.memory.shared_state import RECORD_EVENT
from graph import Block, Diagram, DiagramError, Input, Output, Param, compile
from graph.store import content_hash, from_json, to_json
from tests.cext.rigs import Rig, ends_in_the_safe_stop, one_drive


class Flaky(Block):
    """The tick in N·m / 100; raises in some ticks."""

    y = Output("N·m", range=(0.0, 4.0))

    def __init__(self, ticks, error=None, **options):
        self.ticks, self.error = frozenset(ticks), error or ValueError("flaky")
        super().__init__(**options)

    def step(self, tick):
        if tick in self.ticks:
            raise self.error
        return tick / 100.0


def run(ticks, hold, count=30, **options):
    with Diagram("robot", rate=100) as diagram:
        Flaky(ticks, hold_exceptions=hold, name="flaky", **options)
    rig = Rig(diagram)
    return rig.run(count), rig


def test_held_exceptions_keep_the_last_output_until_the_next_good_step():
    outcome, rig = run({5, 6, 7, 10, 11, 12}, hold=3)
    assert outcome.status == "ok"
    expected = [tick / 100.0 for tick in range(30)]
    expected[5:8] = [0.04] * 3
    expected[10:13] = [0.09] * 3
    assert rig["flaky.y"].tolist() == expected
    assert [(path, count, first, str(error)) for path, count, first, error in rig.control.held] == [
        ("flaky", 6, 5, "flaky")
    ]


def test_exceeding_held_exceptions_in_a_row_is_a_fault():
    outcome, rig = run({5, 6, 7, 8}, hold=3)
    assert (outcome.status, outcome.culprit, outcome.tick, str(outcome.error)) == ("exception", "flaky", 8, "flaky")
    assert len(rig.tick) == 8 and rig.control.held[0][1] == 3


def test_the_safe_stop_follows_and_the_commands_until_then_are_those_of_the_last_good_step():
    rig = one_drive(lambda knee: TorqueLimiter(limit=5.0)(Flaky({20, 21, 22}, hold_exceptions=2, name="flaky").y))
    outcome = rig.run(100)
    assert (outcome.status, outcome.culprit, outcome.tick) == ("exception", "flaky", 22) and ends_in_the_safe_stop(rig)
    assert len(rig.commands()) == 22


def test_an_exception_in_the_first_step_is_a_fault_despite_hold_exceptions():
    outcome, _ = run({0}, hold=5)
    assert (outcome.status, outcome.tick) == ("exception", 0)


@pytest.mark.parametrize("error", [SystemExit(4), KeyboardInterrupt()])
def test_program_exit_exceptions_are_never_held(error):
    outcome, rig = run({6}, hold=5, error=error)
    assert (outcome.status, outcome.culprit, outcome.tick, outcome.error) == (
        "exception",
        "flaky",
        6,
        error,
    ) and rig.control.held == []


def test_a_result_that_cannot_be_taken_is_held_too_and_leaves_no_half_of_itself():
    class Pair(Block):
        """Two numbers and a vector; in tick 4 the last of them cannot be."""

        first = Output("1")
        many = Output("1", shape=(3,))
        last = Output("1", range=(0.0, 10.0))

        def step(self, tick):
            return float(tick), np.full(3, float(tick)), 99.0 if tick == 4 else float(tick)

    with Diagram("robot", rate=100) as diagram:
        Pair(hold_exceptions=1, name="pair")
    rig = Rig(diagram)
    assert rig.run(6).status == "ok"
    for port in ("pair.first", "pair.many[1]", "pair.last"):
        assert rig[port].tolist() == [0.0, 1.0, 2.0, 3.0, 3.0, 5.0]
    assert "outside its declared range" in str(rig.control.held[0][3])


def test_a_held_update_keeps_its_changes_to_the_state():
    class Counts(Block):
        """Counts updates, and raises in some of them, before or after."""

        y = Output("1")

        def reset(self):
            self.count = 0

        def step(self):
            return float(self.count)

        def update(self, tick):
            self.count += 1
            if tick in (3, 4):
                raise OSError("late")

    with Diagram("robot", rate=100) as diagram:
        Counts(hold_exceptions=2, name="counts")
    rig = Rig(diagram)
    assert rig.run(8).status == "ok" and rig["counts.y"].tolist() == list(range(8))
    assert [(path, count, first) for path, count, first, _ in rig.control.held] == [("counts", 2, 3)]
    assert rig.run(3).status == "ok" and rig.control.held == []  # of the run before


def test_slow_block_counts_its_steps():
    class Slow(Block):
        """Raises from tick 8 on."""

        y = Output("1")

        def step(self, tick):
            if tick >= 8:
                raise ValueError("no")
            return float(tick)

    with Diagram("robot", rate=100) as diagram:
        Slow(hold_exceptions=2, every=4, name="slow")
    outcome = Rig(diagram).run(100)
    assert (outcome.status, outcome.tick) == ("exception", 16)


def test_only_first_held_exception_is_recorded():
    with Diagram("robot", rate=100) as diagram:
        Flaky({5, 6, 9}, hold_exceptions=3, name="wobbly Ω")
    rig = Rig(diagram, record=False)
    assert rig.executor.run(20).status == "ok"
    told = [json.loads(payload) for kind, payload in rig.shared.drain(1000) if kind == RECORD_EVENT]
    assert told == [{"event": "exception held", "block": "wobbly Ω", "tick": 5}]


def test_nan_is_not_an_exception_and_passes():
    class Gives(Block):
        """NaN in tick 3."""

        y = Output("1")

        def step(self, tick):
            return math.nan if tick == 3 else 1.0

    with Diagram("robot", rate=100) as diagram:
        Gives(hold_exceptions=3, name="gives")
    rig = Rig(diagram)
    assert rig.run(6).status == "ok" and rig.control.held == [] and math.isnan(rig["gives.y"][3])


@pytest.mark.parametrize("wrong", [-1, 1.5, True, "3", None, math.inf])
def test_hold_exceptions_is_an_integer(wrong):
    with Diagram("robot", rate=100), pytest.raises(DiagramError) as raised:
        Flaky((), hold_exceptions=wrong)
    assert raised.value.diagnostics[0].code == "TW010" and "hold_exceptions must be a whole number" in str(raised.value)


def test_a_native_block_rejects_hold_exceptions():
    with Diagram("robot", rate=100), pytest.raises(DiagramError, match="does not run in Python"):
        Constant(1.0, hold_exceptions=3)


def test_a_block_marked_for_numba_that_holds_exceptions_stays_in_python():
    class Inverse(Block):
        """y = 1 / u."""

        jit = True
        u = Input("1")
        scale = Param(1.0, "1")
        y = Output("1")

        def step(self, u):
            return self.scale / u

    with Diagram("robot", rate=100) as diagram:
        Inverse(hold_exceptions=3)(1.0)
    schedule = compile(diagram)
    assert [step.kernel for step in schedule.output if step.name == "inverse"] == [None] and schedule.warnings[
        0
    ].code != "TW023"


def test_hold_exceptions_is_part_of_the_diagrams_text_and_hash():
    def made(hold):
        with Diagram("robot", rate=100) as diagram:
            Flaky((), hold_exceptions=hold)
        return diagram

    assert content_hash(made(0)) != content_hash(made(2)) != content_hash(made(3)) and content_hash(
        made(2)
    ) == content_hash(made(2))
    assert json.loads(to_json(made(2)))["blocks"][0]["hold_exceptions"] == 2
    assert "hold_exceptions" not in json.loads(to_json(made(0)))["blocks"][0]


def test_a_diagram_loaded_from_its_text_holds_as_many():
    with Diagram("robot", rate=100) as diagram:
        Held(hold_exceptions=2, name="held")
    again = from_json(to_json(diagram), trust=(__name__,))
    assert again["held"].hold_exceptions == 2 and content_hash(again) == content_hash(diagram)


class Held(Block):
    """A one."""

    y = Output("1")

    def step(self):
        return 1.0
