"""Live parameters of blocks whose output an actuator keeps while their subsystem is disabled: each either bounds that
output at once, or `check` names it among those that wait.
"""

import re

import pytest

from blocks.actuators import CubeMars
from blocks.limiters import TorqueLimiter
from blocks.sources import StepSource
from graph import Device, Diagram, DiagramError, Live, compile, subsystem
from graph.rules import held_bounds_of
from tests.blocks.examples import EXAMPLES
from tests.blocks.test_every_block import LIBRARY

LIMITERS = {
    "TorqueLimiter": {"limit"},
    "RMSTorqueLimiter": {"limit"},
    "Saturation": {"lower", "upper"},
    "PI": {"lower", "upper"},
    "PID": {"lower", "upper"},
}  # and the parameters that bound their held output
REFUSED = {  # live, as their examples and the bounds of `held` are
    "Integrator": {"lower", "upper"},
    "PI": {"lower", "upper", "tracking_time"},
    "PID": {"lower", "upper", "tracking_time"},
    "Playback": {"repeat"},
    "Ramp": {"duration"},
    "TorqueLimiter": {"slew"},
}


def examples_of(kind):
    return (EXAMPLES.get(kind.__name__) or getattr(kind, "examples", ({},)))[0]


def torque_of(kind):
    """The first output that may be a torque, or None."""
    names = [name for name, port in kind.outputs.items() if port.unit in ("N·m", "any") and port.dtype == "float"]
    return names[0] if names and not issubclass(kind, Device) else None


def held(kind, example, live):
    """The messages of `check` on a robot whose actuator gets the block's output, with live parameters.

    live : names
    """
    with Diagram("probe", rate=100):
        values = {name: getattr(kind(**example), name) for name in live}
    with Diagram("d", rate=100) as diagram:
        with subsystem("assist", enabled=StepSource(name="on")()):
            spans = {
                name: Live(value, min=min(value, 0.5 * value), max=max(value, 0.5 * value))
                for name, value in values.items()
            }
            block = kind(name="law", **example | spans)
            block(**{name: port.dtype == "bool" or 0.1 for name, port in block.inputs.items()})
        limiter = TorqueLimiter(limit=5.0)(getattr(block, torque_of(kind)))
        CubeMars("AK80-9", name="knee")(torque_command=limiter)
    return [each.message for each in compile(diagram).warnings if each.code == "TW021"]


def live_of(kind):
    """Names of the parameters that may be live in such a robot."""
    if torque_of(kind) is None:
        return []
    return [p.name for p in kind.parameters.values() if p.numeric and not p.fixed]


@pytest.mark.parametrize("name", [name for name, kind in LIBRARY.items() if live_of(kind)])
def test_each_live_parameter_bounds_the_held_output_or_is_named_by_check(name):
    kind = LIBRARY[name]
    for live in live_of(kind):
        try:
            messages = held(kind, examples_of(kind), [live])
        except (DiagramError, TypeError):
            assert live in REFUSED.get(name, ()), live
        else:
            assert live not in REFUSED.get(name, ()), live
            bounds_or_is_named(name, live, *messages)


def test_the_table_has_blocks_of_the_library():
    assert LIMITERS.keys() | REFUSED.keys() <= {name for name, kind in LIBRARY.items() if live_of(kind)}


def bounds_or_is_named(name, live, message):
    kind = LIBRARY[name]
    waiting = (
        re.findall(r"assist/law\.(\w+)", message.split("live changes of")[-1]) if "live changes" in message else []
    )
    sides = held_bounds_of(kind, kind.held_within).get(torque_of(kind), ())
    bounding = {term for side in sides for term, _ in side.terms}
    assert bounding == LIMITERS.get(name, set()), "a new bound belongs into the table"
    assert (live in waiting) != (live in bounding)
