"""Rules between parameters in the loop: refused requests, rules at each tick of a ramp, and ramps that always end."""

import math
import random

import numpy as np
import pytest

from blocks.limiters import Saturation, TemperatureDerating
from blocks.sources import Sine
from cext.schedule.mailbox_writer import Writer
from graph import Block, Diagram, Live, Output, Param
from tests.cext.rigs import Rig
from tests.cext.schedule.test_live import Poster
from tests.soaking import soaked

RATE = 200


class Trio(Block):
    """Three live parameters in a Python block, with a rule between each two and one of all three."""

    rules = ("a <= b <= c", "a + b + c <= 3")

    a = Param(0.0, "1", "smallest", min=-1.0, max=1.0)
    b = Param(0.0, "1", "middle", min=-1.0, max=1.0)
    c = Param(0.0, "1", "largest", min=-1.0, max=2.0)
    y_a = Output("1", "a")
    y_b = Output("1", "b")
    y_c = Output("1", "c")

    def step(self):
        return self.a, self.b, self.c


class Shown(Block):
    """Live parameters of a native block in the arena, as signals of a Python block of the same values."""

    rules = ("low < high", "2 * low + 1 <= roof")

    low = Param(0.0, "1", "lower end", min=-10.0, max=10.0)
    high = Param(1.0, "1", "upper end", min=-10.0, max=10.0)
    roof = Param(5.0, "1", "bound of twice the lower end", min=-30.0, max=30.0)
    y_low = Output("1", "low")
    y_high = Output("1", "high")
    y_roof = Output("1", "roof")

    def step(self):
        return self.low, self.high, self.roof


def rig(make, script=()):
    """A rig of what `make` wires, with a Poster that follows the script."""
    with Diagram("rules", rate=RATE) as diagram:
        make()
        poster = Poster(name="z_poster")
    found = Rig(diagram)
    poster.script, poster.writer = dict(script), (writer := Writer(found.shared))
    found.answer = lambda ticket: writer.answer(ticket)[0]
    found.index = {live.path: number for number, live in enumerate(found.schedule.live)}
    return found


def saturation(**slews):
    """A saturation of ± 1 with live limits."""
    ends = {
        name: Live(value, min=-10.0, max=10.0, slew=slews.get(name, math.inf))
        for name, value in (("lower", -1.0), ("upper", 1.0))
    }
    Saturation(**ends, name="sat")(Sine(amplitude=20.0, frequency=50.0, name="sine").y)


def test_a_request_that_breaks_a_rule_is_refused_and_changes_nothing():
    answers = []

    def post(writer):
        answers.append(writer.set([(0, 5.0)]))

    found = rig(saturation, {3: post})
    found.run(20)
    assert found.answer(answers[0]) == "against a rule"
    assert np.abs(found["sat.y"]).max() == 1.0 and found.changes == []


def test_a_request_that_moves_both_ends_beyond_each_other_is_taken():
    found = rig(saturation, {3: lambda writer: writer.set([(0, 5.0), (1, 7.0)])})
    found.run(40)
    assert (found["sat.y"][20:].min(), found["sat.y"][20:].max()) == (5.0, 7.0)


def test_a_request_is_checked_against_the_targets_of_the_others_and_not_their_present_values():
    answers = []
    found = rig(
        lambda: saturation(upper=1.0),
        {
            3: lambda writer: writer.set([(1, 5.0)]),
            6: lambda writer: answers.append(writer.set([(0, 4.0)])),
            9: lambda writer: answers.append(writer.set([(1, 3.0)])),
        },
    )
    found.run(20)
    assert [found.answer(ticket) for ticket in answers] == ["taken", "against a rule"]


def test_a_rule_with_a_fixed_parameter_bounds_the_live_one():
    answers = []

    def make():
        Saturation(lower=Live(-1.0, min=-10.0, max=10.0, slew=math.inf), upper=3.0, name="sat")(
            Sine(amplitude=20.0, frequency=50.0, name="sine").y
        )

    found = rig(
        make,
        {
            3: lambda writer: answers.append(writer.set([(0, 5.0)])),
            6: lambda writer: answers.append(writer.set([(0, 3.0)])),
        },
    )
    found.run(20)
    assert [found.answer(ticket) for ticket in answers] == ["against a rule", "taken"]


def test_the_last_of_two_values_for_one_parameter_counts():
    answers = []
    found = rig(saturation, {3: lambda writer: answers.append(writer.set([(0, 5.0), (0, 0.5)]))})
    found.run(20)
    assert found.answer(answers[0]) == "taken" and found["sat.y"][10:].min() == 0.5


def test_a_fast_ramp_waits_for_a_slow_one_and_both_arrive():
    """The lower end would pass the upper one in the second tick of its ramp."""
    found = rig(
        lambda: Trio(a=Live(0.0, slew=math.inf), b=Live(0.0, slew=2.0), c=Live(0.0, slew=1.0), name="trio"),
        {3: lambda writer: writer.set([(0, 0.5), (1, 0.75), (2, 1.0)])},
    )
    found.run(2 * RATE)
    a, b, c = found["trio.y_a"], found["trio.y_b"], found["trio.y_c"]
    assert (a[-1], b[-1], c[-1]) == (0.5, 0.75, 1.0)
    assert np.all(a <= b) and np.all(b <= c) and np.all(np.diff(c) <= 1.0 / RATE + 1e-15)


@pytest.mark.hazard("H1g")
@pytest.mark.parametrize("seed", soaked(range(10), but=[0, 1, 2]))
def test_random_ramps_keep_every_rule_at_each_tick_and_end(seed):
    """25 requests of random values at random ticks, with slews from 0.3 to infinity per second."""
    draw = random.Random(seed)
    slews = [draw.choice((0.3, 1.0, 7.0, 40.0, math.inf)) for _ in range(6)]
    spans = {"trio.a": 1.0, "trio.b": 1.0, "trio.c": 2.0, "shown.low": 10.0, "shown.high": 10.0, "shown.roof": 30.0}

    def make():
        Trio(*(Live(0.0, slew=slew) for slew in slews[:3]), name="trio")
        Shown(Live(0.0, slew=slews[3]), Live(1.0, slew=slews[4]), Live(5.0, slew=slews[5]), name="shown")

    def request(writer):
        chosen = draw.sample(list(spans), draw.randint(1, 6))
        writer.set([(found.index[path], draw.uniform(-0.3, 1.0) * spans[path]) for path in chosen])

    found = rig(make, {draw.randrange(1500): request for _ in range(25)})
    found.run(25000)
    a, b, c = found["trio.y_a"], found["trio.y_b"], found["trio.y_c"]
    low, high, roof = found["shown.y_low"], found["shown.y_high"], found["shown.y_roof"]
    assert np.all(a <= b) and np.all(b <= c) and np.all(a + b + c <= 3.0)
    assert np.all(low < high) and np.all(2.0 * low + 1.0 <= roof)
    signals = dict(zip(spans, (a, b, c, low, high, roof)))
    targets = {found.schedule.live[change.index].path: change.value for change in found.changes}
    assert targets and all(signals[path][-1] == value for path, value in targets.items())
    for signal, slew in zip(signals.values(), slews):
        assert slew == math.inf or np.abs(np.diff(signal)).max() <= slew / RATE * (1.0 + 1e-12) + 1e-14


def test_two_ramps_tied_to_each_other_move_together():
    """Equality, as two rules: neither may move before the other."""

    class Tied(Block):
        rules = ("x <= y", "y <= x", "3 * x <= z", "z <= 3 * x")

        x = Param(0.1, "1", "one", min=0.0, max=1.0)
        y = Param(0.1, "1", "the same", min=0.0, max=1.0)
        z = Param(0.1 * 3, "1", "three times", min=0.0, max=3.0)
        x_now = Output("1", "x")
        y_now = Output("1", "y")
        z_now = Output("1", "z")

        def step(self):
            return self.x, self.y, self.z

    found = rig(
        lambda: Tied(Live(0.1, slew=0.7), Live(0.1, slew=0.3), Live(3 * 0.1, slew=5.0), name="tied"),
        {3: lambda writer: writer.set([(0, 0.7), (1, 0.7), (2, 3 * 0.7)])},
    )
    found.run(3 * RATE)
    x, y, z = found["tied.x_now"], found["tied.y_now"], found["tied.z_now"]
    assert (x[-1], y[-1], z[-1]) == (0.7, 0.7, 3 * 0.7)
    np.testing.assert_array_equal(x, y)
    np.testing.assert_allclose(z, 3 * x, rtol=1e-12)
    assert np.diff(y).max() <= 0.3 / RATE * (1.0 + 1e-12)


def test_a_script_is_checked_tick_by_tick_against_the_rules():
    found = rig(saturation)
    found.control.live.follow([(3, 0, 5.0, math.inf), (3, 1, 7.0, math.inf)])
    found.run(30)
    assert found["sat.y"][10:].min() == 5.0
    with pytest.raises(ValueError, match=r"sat: lower must be at most upper \(1\), got 5"):
        found.control.live.follow([(3, 0, 5.0, math.inf), (4, 1, 7.0, math.inf)])


def test_assign_takes_several_changes_together():
    found = rig(saturation)
    with pytest.raises(ValueError, match=r"sat: lower must be at most upper \(1\), got 5"):
        found.control.live.assign([(0, 5.0)])
    assert found.control.live.assign([(0, 5.0), (1, 7.0)]) == [-1.0, 1.0]


def test_a_strict_rule_keeps_its_ends_apart():
    def make():
        TemperatureDerating(full=Live(80.0, min=0.0, max=200.0), none=Live(100.0, min=0.0, max=200.0), name="derating")(
            1.0, 90.0
        )

    answers = []
    found = rig(
        make,
        {
            3: lambda writer: answers.append(writer.set([(0, 100.0)])),
            5: lambda writer: answers.append(writer.set([(1, 20.0), (0, 10.0)])),
        },
    )
    found.run(2 * RATE)
    assert [found.answer(ticket) for ticket in answers] == ["against a rule", "taken"]
    assert np.all(np.isfinite(found["derating.derated"]))
