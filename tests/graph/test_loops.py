"""The range proof of loops: what a limit inside a loop proves of all of it, and that no run ever leaves what was
proved.
"""

import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from blocks.discrete import Delay, Integrator, UnitDelay
from blocks.filters import Butterworth, Exponential
from blocks.limiters import Saturation, SlewRate
from blocks.linear import StateSpace, TransferFunction
from blocks.logic import Compare, Switch
from blocks.mathematics import Gain, Max, Product, Sum
from blocks.sources import Constant, Sine
from blocks.states import StateMachine
from blocks.tables import LookupTable1D
from blocks.windows import MovingAverage
from graph import Block, Diagram, Input, Interval, Output, subsystem
from graph.compiler import examine
from graph.interval import EVERYTHING
from graph.ranges import DOWNWARD_LIMIT, UPWARD_LIMIT
from tests.blocks.running import run

RATE = 100.0


def proved(diagram):
    """{"path.port": Interval} of every signal of a diagram without errors."""
    found = examine(diagram)
    assert not found.errors, found.errors
    return {signal.path: interval for signal, interval in found.ranges.items()}


def close(low, high):
    return pytest.approx((low, high), rel=1e-12)


def ends(interval):
    return interval.low, interval.high


def test_a_saturation_in_a_loop_bounds_every_delay_in_it():
    for names in ("abcdef", "fedcba", "cafebd"):
        with Diagram("d", RATE) as diagram:
            delays = [UnitDelay(initial=7.0 if name == "c" else 0.0, name=name) for name in names]
            limited = Saturation(-2.0, 5.0, name="limited")(Sum("++")(delays[-1].y, Sine(9.0)()))
            for delay, source in zip(delays, [limited, *(delay.y for delay in delays)]):
                delay(source)
        found = proved(diagram)
        behind = names[names.index("c") :]  # what starts at 7 is seen by every delay behind it
        assert {name: found[f"{name}.y"] for name in names} == {
            name: Interval(-2.0, 7.0 if name in behind else 5.0) for name in names
        }


def test_a_sample_and_hold_loop_stays_in_the_range_of_its_samples():
    with Diagram("d", RATE) as diagram:
        held = UnitDelay(initial=4.0, name="held")
        sampled = Switch(name="sampled")(Compare(">")(Sine()(), 0.0), Constant(3.0)(), held.y)
        held(sampled)
    assert proved(diagram)["sampled.y"] == Interval(3.0, 4.0)


def test_a_running_maximum_has_the_bounds_of_its_input_and_initial_value():
    with Diagram("d", RATE) as diagram:
        before = UnitDelay(initial=-1.0, name="before")
        before(Max(name="peak")(before.y, Sine(2.0)()))
    assert ends(proved(diagram)["peak.y"]) == close(-1.0, 2.0)


def test_an_integrator_with_limits_bounds_the_loop_that_it_closes():
    with Diagram("d", RATE) as diagram:
        angle = Integrator(0.5, -1.0, 3.0, name="angle")
        angle(Gain(-2.0, name="back")(Sum("+-")(angle.y, Sine(1e6)())))
    assert proved(diagram)["angle.y"] == Interval(-1.0, 3.0)


def test_a_growing_loop_is_unbounded_on_that_side_only():
    with Diagram("d", RATE) as diagram:
        total = UnitDelay(initial=2.0, name="total")
        total(Sum("++", name="more")(total.y, Saturation(0.0, 1.0)(Sine()())))
    assert proved(diagram)["total.y"] == Interval(2.0)


def test_a_limit_in_one_loop_bounds_the_loops_behind_it_and_not_the_one_before():
    with Diagram("d", RATE) as diagram:
        free, bounded = UnitDelay(name="free"), UnitDelay(name="bounded")
        free(Sum("++")(free.y, Sine()()))
        bounded(Saturation(-1.0, 1.0)(Sum("++")(bounded.y, free.y)))
    found = proved(diagram)
    assert found["free.y"] == EVERYTHING and found["bounded.y"] == Interval(-1.0, 1.0)


def test_outputs_of_a_state_machine_bound_a_loop_through_its_inputs():
    with Diagram("d", RATE) as diagram:
        before = UnitDelay(name="before")
        machine = StateMachine(
            takes={"u": "1"},
            gives={"y": "1"},
            states={"low": {"y": -1.0}, "high": {"y": 2.0}},
            transitions=(("low", "high", "u <= 0"), ("high", "low", "u > 1")),
            name="machine",
        )
        machine(u=before.y)
        before(Gain(3.0)(machine.y))
    assert ends(proved(diagram)["before.y"]) == close(-3.0, 6.0)


def test_a_loop_at_a_slower_rate_is_proved_as_any_other():
    with Diagram("d", RATE) as diagram:
        with subsystem("slow", every=4, enabled=Compare(">")(Sine()(), 0.0)):
            delay = UnitDelay(initial=1.0, name="delay")
            delay(Saturation(1.0, 2.0)(Gain(1.5)(delay.y)))
        Gain(2.0, name="fast")(delay.y)
    found = proved(diagram)
    assert found["slow/delay.y"] == Interval(0.0, 2.0) and ends(found["fast.y"]) == close(0.0, 4.0)


def test_a_block_without_a_declared_range_leaves_its_loop_unbounded():
    class Silent(Block):
        """Promises nothing."""

        u = Input("any", "input")
        y = Output("any", "output")

        def step(self, u):
            return 0.0

    with Diagram("d", RATE) as diagram:
        delay = UnitDelay(name="delay")
        delay(Silent(name="silent")(delay.y))
    assert proved(diagram)["delay.y"] == EVERYTHING


@pytest.mark.soak
def test_interval_propagation_in_one_large_loop_is_bounded():
    def questions(count):
        asked = []

        class Asked(Gain):
            """A gain that keeps count."""

            def output_range(self, **inputs):
                asked.append(self)
                return super().output_range(**inputs)

        with Diagram("d", RATE) as diagram:
            delays = [UnitDelay(name=f"{k * 7919 % count:04}") for k in range(count)]
            for k, delay in enumerate(delays):
                delay(
                    Sum("++")(Asked(1.5)(delays[k - 1].y), delays[k - 7].y)
                    if k
                    else Saturation()(Sum("++")(delays[-1].y, delays[-7].y))
                )
        examine(diagram)
        assert len(set(asked)) == count - 1
        return len(asked) / count

    few, many = questions(150), questions(600)
    assert many < 1.2 * few and many <= UPWARD_LIMIT + DOWNWARD_LIMIT + 2


# Random diagrams with loops


class Wild(Block):
    """Anything between two numbers, the ends too, and NaN."""

    y = Output("any", "anything")

    def __init__(self, values, low, high):
        self.outputs = {"y": Output("any", "anything", range=(low, high)).named("y")}
        self.values = values
        super().__init__()

    def step(self, tick):
        return self.values[tick % len(self.values)]


MILD = st.floats(-3.0, 3.0)
NUMBERS = st.one_of(
    MILD, st.floats(allow_nan=False), st.sampled_from([0.0, -0.0, 5e-324, 1e308, -1e308, math.inf, -math.inf])
)
SMALL = st.floats(-4.0, 4.0)


@st.composite
def pairs(draw, numbers):
    return sorted((draw(numbers) + 0.0, draw(numbers) + 0.0))  # + 0.0: no negative zero, which is no smaller than zero


@st.composite
def wild(draw):
    low, high = draw(pairs(NUMBERS))
    inside = st.one_of(st.sampled_from([low, high, math.nan]), st.floats(low, high, allow_nan=False))
    return Wild(draw(st.lists(inside, min_size=1, max_size=6)), low, high)


def limited_integrator(draw):
    lower, upper = draw(pairs(SMALL))
    return Integrator(
        draw(st.sampled_from([lower, upper])),
        lower,
        upper,
        draw(st.sampled_from(["forward", "backward", "trapezoidal"])),
    )


def saturation(draw):
    return Saturation(*draw(pairs(NUMBERS)))


def machine(draw):
    values = [{"y": draw(SMALL)} for _ in range(3)]
    return StateMachine(
        takes={"u": "any", "v": "any"},
        gives={"y": "any"},
        states=dict(zip("abc", values)),
        transitions=(("a", "b", "u > v"), ("b", "c", "u < 0 or time_in_state > 0.03"), ("c", "a", "v > 1")),
    )


def chosen(draw):
    """A switch on a comparison of two signals."""
    switch = Switch()
    compare = Compare(draw(st.sampled_from(["<", ">=", "!="])))
    switch(condition=compare.y)
    return switch, [(compare, "a"), (compare, "b"), (switch, "a"), (switch, "b")]


KINDS = {
    "wild": None,
    "delay": lambda draw: UnitDelay(draw(SMALL)),
    "delays": lambda draw: Delay(draw(st.integers(1, 3)), draw(SMALL)),
    "integrator": limited_integrator,
    "free integrator": lambda draw: Integrator(draw(SMALL)),
    "gain": lambda draw: Gain(draw(SMALL)),
    "sum": lambda draw: Sum(draw(st.sampled_from(["++", "+-", "-++"]))),
    "product": lambda draw: Product(),
    "saturation": saturation,
    "switch": chosen,
    "table": lambda draw: LookupTable1D((-1.0, 0.0, 2.0), tuple(draw(SMALL) for _ in range(3))),
    "machine": machine,
    "low-pass": lambda draw: Butterworth(2, draw(st.floats(1.0, 15.0))),
    "exponential": lambda draw: Exponential(0.02),
    "max": lambda draw: Max(),
    "slew": lambda draw: SlewRate(draw(st.floats(0.0, 100.0))),
    "average": lambda draw: MovingAverage(0.03),
    "lag": lambda draw: TransferFunction((draw(SMALL),), (1.0, draw(st.floats(-0.9, 0.9)))),
    "state space": lambda draw: StateSpace(
        ((0.5, 0.4), (-0.4, 0.5)), ((0.0,), (1.0,)), ((1.0, draw(SMALL)),), start=(draw(SMALL), 0.0)
    ),
}
OPEN = {"delay", "delays", "free integrator", "lag", "state space"}


@pytest.mark.hazard("H1a")
@settings(suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])
@given(st.data())
def test_no_signal_of_a_random_diagram_with_loops_leaves_its_proved_range(data):
    draw = data.draw
    kinds = ["wild", *draw(st.lists(st.sampled_from(sorted(KINDS)), min_size=2, max_size=11))]
    with Diagram("random", RATE) as diagram:
        condition = Compare(">")(Sine(frequency=20.0)(), 0.3)
        outputs, inputs = [], []
        for number, kind in enumerate(kinds):
            slow, enabled = draw(st.sampled_from([1, 1, 1, 2, 3])), draw(st.sampled_from([None, None, None, condition]))
            with subsystem(
                f"n{number}", every=slow if kind != "wild" else 1, enabled=enabled if kind != "wild" else None
            ):
                made = draw(wild()) if kind == "wild" else KINDS[kind](draw)
            block, ports = made if isinstance(made, tuple) else (made, [(made, name) for name in made.inputs])
            outputs.append(block.y)
            inputs.append(
                (kind, slow, [(owner, name) for owner, name in ports if name not in ("restart", "condition")])
            )
        for number, (kind, slow, ports) in enumerate(inputs):
            divides = [k for k in range(len(kinds)) if inputs[k][1] % slow == 0 or slow % inputs[k][1] == 0]
            readable = [k for k in divides if kind in OPEN or kinds[k] in OPEN or k < number] or [0]
            for owner, name in ports:
                owner(**{name: outputs[draw(st.sampled_from(readable))]})
    ranges = proved(diagram)
    recording = run(diagram, 24)
    assert recording.outcome.status == "ok", recording.outcome
    for path, interval in ranges.items():
        values = recording[path][~np.isnan(recording[path])]
        outside = values[(values < interval.low) | (values > interval.high)]
        assert not len(outside), (path, interval, outside[:3])
