"""Rules between the parameters of a block: how they are written, when they are checked, and what they bound."""

import math

import pytest

from blocks.controllers import PID
from blocks.limiters import Saturation, TemperatureDerating
from graph import Block, Diagram, DiagramError, Interval, Live, Output, Param, compile
from runtime.host.errors import BadInput
from runtime.robot.loading.overrides import restore, set_block_parameters


class Gait(Block):
    """Every form of a rule."""

    rules = ("shortest < longest", "rise + fall <= 1", "2 * dt <= shortest / 2", "hold > -1")

    shortest = Param(0.5, "s", "shortest")
    longest = Param(2.0, "s", "longest")
    rise = Param(0.3, "1", "rise")
    fall = Param(0.2, "1", "fall")
    hold = Param(None, "N", "may be left out", dtype=float)
    y = Output("1", "out")

    def step(self):
        return 0.0


@pytest.mark.parametrize(
    "parameters, message",
    [
        ({"shortest": 2.0}, "shortest must be below longest (2 s), got 2 s"),
        ({"rise": 0.9}, "rise + fall must be at most 1, got 1.1"),
        ({"hold": -1.0}, "hold must be above -1 N, got -1 N"),
    ],
)
def test_a_rule_is_checked_when_the_block_is_made_and_names_both_sides(parameters, message):
    with pytest.raises(DiagramError) as caught:
        Gait(**parameters)
    assert [found.message for found in caught.value.diagnostics] == [message]


def test_a_rule_with_the_sampling_period_is_checked_at_the_rate_of_the_diagram():
    message = r"2 \* dt must be at most shortest / 2 \(0.15 s\), got 0.2 s"
    with Diagram("slow", rate=10.0), pytest.raises(DiagramError, match=message):
        Gait(shortest=0.3)
    with Diagram("slowed", rate=100.0) as diagram:
        Gait(shortest=0.3)
    diagram.rate = 10.0
    with pytest.raises(DiagramError, match=message):
        compile(diagram)


def test_the_rules_of_a_base_class_hold_in_its_subclasses():
    class Late(Gait):
        rules = ("hold >= fall",)

        def step(self):
            return 1.0

    for parameters in ({"shortest": 3.0}, {"hold": 0.1}):
        with pytest.raises(DiagramError):
            Late(**parameters)
    assert Late(hold=0.2).hold == 0.2


@pytest.mark.parametrize(
    "rules, message",
    [
        ("low <= high", r'Bad.rules is a string: write a tuple, as in rules = \("low <= high",\)'),
        (("low",), "Bad.rules: 'low' is not a comparison with <, <=, > or >=, as in \"lower <= upper\""),
        (("low == high",), "Bad.rules: 'low == high' is not a comparison"),
        (("low <",), "Bad.rules: 'low <' is not a comparison"),
        (("low < middle",), "Bad: 'low < middle': 'middle' is not a numeric parameter of the class"),
        (("low < word",), "'word' is not a numeric parameter"),
        (("low * high < 1",), r"'low \* high' is not linear in the parameters"),
        (("abs(low) < high",), r"'abs\(low\)' is not linear"),
        (("dt < 1",), "'dt < 1' compares two sides without a parameter"),
    ],
)
def test_a_rule_that_is_no_linear_comparison_of_parameters_is_an_error_of_the_class(rules, message):
    body = {"low": Param(0.0, "1"), "high": Param(1.0, "1"), "word": Param("", "1"), "rules": rules}
    with pytest.raises(TypeError, match=message):
        type("Bad", (Block,), body)


def test_several_settings_of_one_block_obey_its_rules_together_in_any_order():
    with Diagram("set", rate=100.0) as diagram:
        Saturation(name="sat")(0.0)
    replaced = []
    set_block_parameters(diagram, [("sat.lower", "5"), ("sat.upper", "7")], replaced)
    assert (diagram["sat"].lower, diagram["sat"].upper) == (5.0, 7.0)
    restore(replaced)
    assert (diagram["sat"].lower, diagram["sat"].upper) == (-1.0, 1.0)
    with pytest.raises(BadInput) as caught:
        set_block_parameters(diagram, [("sat.lower", "5"), ("sat.upper", "3")])
    assert str(caught.value) == "setting sat.lower=5, sat.upper=3: lower must be at most upper (3), got 5"


def test_a_rule_narrows_the_range_that_the_proof_uses():
    """The loop keeps the live upper end at -5 or more."""
    block = Saturation(lower=-5.0, upper=Live(3.0, min=-20.0, max=12.0))
    assert block.span("upper") == Interval(-5.0, 12.0)
    assert block.output_range(u=Interval(-100.0, 100.0)) == Interval(-5.0, 12.0)
    both = PID(kp=1.0, lower=Live(-1.0, min=-9.0, max=9.0), upper=Live(1.0, min=-2.0, max=5.0))
    assert (both.span("lower"), both.span("upper")) == (Interval(-9.0, 5.0), Interval(-2.0, 5.0))


class Undeclared(Block):
    """Checks in `configure` what it does not declare."""

    low = Param(0.0, "1", "low", min=-10.0, max=10.0)
    high = Param(1.0, "1", "high", min=-10.0, max=10.0)
    y = Output("1", "out")

    def configure(self):
        if self.low > self.high - 0.5:
            raise ValueError(f"low, {self.low:g}, is too close to high, {self.high:g}")

    def step(self):
        return self.high - self.low


class Sampled(Block):
    """Checks in `prepare` what depends on the rate."""

    cutoff = Param(1.0, "Hz", "cutoff", min=0.0, max=1000.0)
    y = Output("1", "out")

    def prepare(self, dt):
        if dt is not None and self.cutoff >= 0.5 / dt:
            raise ValueError(f"cutoff must be below half the rate, {0.5 / dt:g} Hz, got {self.cutoff:g} Hz")

    def step(self):
        return self.cutoff


def compiled(make):
    with Diagram("live", rate=100.0) as diagram:
        make()
    try:
        compile(diagram)
    except DiagramError as error:
        return [found.message for found in error.diagnostics]
    return []


@pytest.mark.parametrize("rules", [(), ("low <= high",), ("low < high",)])
def test_live_bounds_that_a_block_rejects_without_a_rule_are_an_error_of_the_compile(rules):
    kind = type("Third", (Undeclared,), {"rules": rules})
    (message,) = compiled(lambda: kind(low=Live(0.0), high=Live(1.0), name="third"))
    assert message.startswith("its live bounds allow low=") and "which it rejects: low, " in message
    assert compiled(lambda: kind(low=Live(0.0, max=0.5), high=Live(1.0, min=1.0), name="third")) == []
    declared = type("Third", (Undeclared,), {"rules": ("low <= high - 0.5",)})
    assert compiled(lambda: declared(low=Live(0.0), high=Live(1.0), name="third")) == []


def test_live_bounds_that_a_block_rejects_at_its_rate_are_an_error_of_the_compile():
    (message,) = compiled(lambda: Sampled(cutoff=Live(1.0), name="sampled"))
    assert message == (
        "its live bounds allow cutoff=1000, which it rejects: cutoff must be below half the rate, 50 Hz, got 1000 Hz"
    )
    assert compiled(lambda: Sampled(cutoff=Live(1.0, max=49.0), name="sampled")) == []


def test_a_rule_between_a_ramp_and_a_step_is_an_error_of_the_compile():
    class Counted(Block):
        rules = ("share <= count",)

        share = Param(0.5, "1", "share", min=0.0, max=5.0)
        count = Param(1, "1", "count", min=0, max=5)
        y = Output("1", "out")

        def step(self):
            return self.share

    (message,) = compiled(lambda: Counted(share=Live(0.5), count=Live(1), name="counted"))
    assert message.startswith("a rule relates share, which ramps, to count, which steps")
    assert compiled(lambda: Counted(share=Live(0.5, slew=math.inf), count=Live(1), name="counted")) == []
    assert compiled(lambda: Counted(share=0.5, count=Live(1), name="counted")) == []


def test_the_schedule_has_the_rules_of_live_parameters_with_the_others_as_constants():
    with Diagram("live", rate=100.0) as diagram:
        TemperatureDerating(full=Live(60.0, min=0.0, max=200.0), none=90.0, name="derating")(1.0, 20.0)
        Saturation(lower=Live(0.0, min=-1.0, max=1.0), upper=math.inf, name="open")(0.0)
        Saturation(name="fixed")(0.0)
    schedule = compile(diagram)
    assert [live.path for live in schedule.live] == ["derating.full", "open.lower"]
    (entry,) = schedule.live_rules
    assert entry.path == "derating" and entry.rule.keys == [0]
    assert entry.rule.sentence({0: 95.0}.__getitem__) == "full must be below none (90 °C), got 95 °C"
