"""Arguments of the functions of `runtime` of a wrong type: one line with the name, the value and what is expected."""

import numpy as np
import pytest

import runtime
from blocks.sources import Constant
from graph import Diagram
from runtime.host.arguments import EXPECTED
from runtime.host.errors import BadInput, UnknownName

OBJECTIVES = {"a": lambda trial: 1.0}


def build(gain=1.0):
    with Diagram("d", rate=200) as diagram:
        Constant(gain, name="c")()
    return diagram


def study(**named):
    return runtime.study(build, 0.05, OBJECTIVES, workers=0, **named)


def optimise(over=None, **named):
    return runtime.optimise(build, 0.05, OBJECTIVES, {"gain": [0, 1]} if over is None else over, workers=0, **named)


WRONG = {  # {argument: (call, values)}
    "settings": (lambda value: runtime.run(build, 0.05, settings=value), (3, "x", [1], {3: 1.0})),
    "plant_signals": (lambda value: runtime.run(build, 0.05, plant_signals=value), (None, 3, [1], b"x")),
    "subject": (lambda value: runtime.run(build, 0.05, subject=value), (3, [], "", "a\0b", b"x")),
    "rig": (lambda value: runtime.check(build, rig=value), (3, [], "")),
    "output": (lambda value: study(output=value), (3, [], "")),
    "grid": (lambda value: study(grid=value), (3, "x", [1], {3: [1]})),
    "sample": (lambda value: study(sample=value, samples=2), (3, "x", {"gain": 3}, {"gain": "x"})),
    "samples": (lambda value: study(samples=value), (None, "x", 1.5, 10**400)),
    "seeds": (lambda value: study(seeds=value), (None, 3, "x")),
    "over": (optimise, (3, "x", [1])),
    "optimiser": (lambda value: optimise(optimiser=value), (None, 3, [])),
    "cost": (lambda value: optimise(cost=value), (None, 3, [1])),
    "population": (lambda value: optimise(population=value), (None, "x", 10**400)),
    "inputs": (lambda value: runtime.linearise(build, value, []), (None, 3, "c.y", [1])),
    "at": (lambda value: runtime.linearise(build, [], [], at=value), (None, "x", 10**400)),
    "duration": (lambda value: runtime.connect("d.py", duration=value), ("x", [], float("nan"))),
}


@pytest.mark.parametrize("name, value", [(name, value) for name, (_, values) in WRONG.items() for value in values])
def test_a_wrong_argument_is_named_with_its_value_and_what_is_expected(name, value):
    call, _ = WRONG[name]
    with pytest.raises(BadInput, match=f"{name}") as caught:
        call(value)
    assert "expected" in str(caught.value) or "invalid" in str(caught.value)
    assert len(str(caught.value)) < 500


def test_trim_takes_dicts():
    for inputs, outputs in ((["c.y"], {}), ({}, ["c.y"]), (3, {})):
        with pytest.raises(BadInput, match="puts are {.*}, .* got"):
            runtime.trim(build, inputs, outputs)


def test_a_run_that_is_advanced_rejects_what_is_no_name_and_no_time():
    with runtime.simulate(build) as sim:
        for name in (None, 3, ["c.y"]):
            with pytest.raises(UnknownName, match="is not the name of a signal or parameter"):
                sim[name]
            with pytest.raises(BadInput, match="changes=.*: expected a dict"):
                sim[name] = 1.0
        for seconds in ("x", [], 10**400, float("nan")):
            with pytest.raises(BadInput, match="expected a whole number of ticks"):
                sim.step(seconds)


def test_every_test_of_an_argument_accepts_or_rejects_any_value():
    for name, (is_valid, _) in EXPECTED.items():
        for value in (None, 3, "x", [], {}, {1: 2}, np.array(1.0), np.zeros(2), 10**400, float("nan"), object(), b"x"):
            assert is_valid(value) in (True, False), name


@pytest.mark.parametrize(
    "name, words", [("plot", r"runtime.load\('trials'\).plot"), ("start", "runtime.connect"), ("x", "run")]
)
def test_a_function_that_there_is_not_is_answered_with_the_one_there_is(name, words):
    with pytest.raises(AttributeError, match=f"runtime has no '{name}': .*{words}"):
        getattr(runtime, name)
