"""Warnings of torques that a disabled subsystem holds and that reach an actuator, whatever they are combined with."""

import pytest

from blocks.actuators import CubeMars
from blocks.controllers import Impedance
from blocks.discrete import UnitDelay
from blocks.filters import Exponential
from blocks.limiters import Saturation, TorqueLimiter
from blocks.logic import And, Compare, Not, Selector, Switch
from blocks.mathematics import Abs, Gain, Max
from blocks.sources import Sine, StepSource
from blocks.vectors import Dot
from graph import Block, Diagram, Input, Output, compile, stack, subsystem


class Blend(Block):
    """A block of one's own, which states no range."""

    first = Input("any")
    second = Input("any")
    y = Output("any")

    def step(self, first, second):
        return 0.5 * first + 0.5 * second


def held(combine, limit=5.0):
    """The outputs that `check` says are held, with the conditions. combine : called with (torque, other, enabled)"""
    with Diagram("d", rate=100) as diagram:
        enabled, other = StepSource(name="on")(), Sine(unit="N·m", name="other")()
        with subsystem("assist", enabled=enabled):
            torque = TorqueLimiter(limit=2.0, name="last")(Gain(1.0, unit="N·m", name="law")(1.0))
        command = combine(torque, other, enabled)
        CubeMars("AK80-9", name="knee")(torque_command=TorqueLimiter(limit=limit)(command))
    found = [warning for warning in compile(diagram).warnings if warning.code == "TW021"]
    assert all((warning.path, warning.port) == ("knee", "torque_command") for warning in found)
    return [warning.message.split(";")[0] for warning in found]


WAYS = {
    "added": lambda torque, other, enabled: torque + other,
    "subtracted": lambda torque, other, enabled: other - torque,
    "a share of a torque": lambda torque, other, enabled: Gain(0.5, unit="1/N/m")(torque) * other,
    "scaled by a signal": lambda torque, other, enabled: torque * Sine()(),
    "divided by a signal": lambda torque, other, enabled: torque / (2.0 + Sine()()),
    "the larger of two": lambda torque, other, enabled: Max()(torque, other),
    "clipped, then added": lambda torque, other, enabled: Saturation(lower=1.0, upper=1.5)(torque) + other,
    "filtered and delayed, then added": lambda torque, other, enabled: UnitDelay()(Exponential()(torque)) + other,
    "added to itself one tick before": lambda torque, other, enabled: fed_back(torque),
    "selected by another condition": lambda torque, other, enabled: Switch()(StepSource()(), torque, other),
    "selected while the other is not": lambda torque, other, enabled: Switch()(enabled, other, torque),
    "one of several": lambda torque, other, enabled: Selector()(index=1, u0=other, u1=torque),
    "an element of a vector": lambda torque, other, enabled: Dot()(stack(torque, other), [1.0, 1.0]),
    "in a block of one's own": lambda torque, other, enabled: Blend()(torque, other),
    "in another subsystem": lambda torque, other, enabled: inside(torque + 0.0, other),
}
GATES = {
    "selected by the condition": lambda torque, other, enabled: Switch()(enabled, torque, other),
    "selected by its negation": lambda torque, other, enabled: Switch()(Not()(enabled), other, torque),
    "selected by the condition and another": lambda torque, other, enabled: Switch()(
        And()(enabled, StepSource()()), torque, 0.0
    ),
    "selected, then added": lambda torque, other, enabled: Switch()(enabled, torque, 0.0) + other,
    "multiplied by the condition": lambda torque, other, enabled: torque * enabled + other,
    "a position for a law": lambda torque, other, enabled: Impedance()(
        position=Sine()(), velocity=0.0, equilibrium=Gain(1.0, unit="rad/N/m")(torque)
    ),
    "one that decides, not a torque": lambda torque, other, enabled: Switch()(
        Compare(">")(Abs()(torque), 1.0), other, 0.0
    ),
}


def fed_back(torque):
    delay = UnitDelay()
    total = torque + 0.5 * delay.y
    delay(total)
    return total


def inside(torque, other):
    with subsystem("outer", enabled=StepSource(name="outer_on")()):
        return Gain(1.0, name="sum")(torque + other)


@pytest.mark.hazard("H1g")
@pytest.mark.parametrize("way", WAYS)
def test_a_held_torque_is_named_whatever_it_is_combined_with(way):
    assert "assist/last.limited keeps its last value while on.y is false" in held(WAYS[way])


@pytest.mark.parametrize("way", GATES)
def test_a_torque_that_does_not_reach_the_motor_while_it_is_held_is_not_named(way):
    assert held(GATES[way]) == []
