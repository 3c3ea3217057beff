"""Parameters and optimisers: bounds, the ask-and-tell interface, and states from which an optimiser continues."""

import json
import math
import random
import sys

import numpy as np
import pytest

from runtime.experiments.optimisation.optimisers import OPTIMISERS, make_optimiser, restore_optimiser
from runtime.experiments.optimisation.parameters import Parameter, parse, within_step
from runtime.host.errors import BadInput

TORQUE = [Parameter("profile.peak", 4.0, 12.0), Parameter("profile.timing", 0.48, 0.58, initial=0.5)]


def cost(values):
    return (values["profile.peak"] - 9.0) ** 2 / 16.0 + (values["profile.timing"] - 0.55) ** 2 / 0.0025


@pytest.fixture(params=OPTIMISERS)
def name(request):
    pytest.importorskip({"cma": "cma", "bayesian": "optuna", "random": "numpy"}[request.param])
    return request.param


def test_parameter_is_read_from_the_text_of_an_option():
    assert parse("profile.peak=4:12") == Parameter("profile.peak", 4.0, 12.0)
    assert parse("*/profile.peak=4:12:8") == Parameter("*/profile.peak", 4.0, 12.0, initial=8.0)
    assert parse("k=-1e-3:0").start == -0.0005


@pytest.mark.parametrize("text", ["", "peak", "=4:12", "peak=4", "peak=4:x", "peak=4:12:8:9", "peak:4=12"])
def test_text_that_is_no_parameter_is_rejected_with_an_example(text):
    with pytest.raises(BadInput, match="expected NAME=LOW:HIGH or NAME=LOW:HIGH:INITIAL, as in --over 'profile.peak"):
        parse(text)


@pytest.mark.parametrize(
    "text, message",
    [
        ("peak=12:4", "parameter peak: bounds 12.0 and 4.0: expected a lower and a higher number"),
        ("peak=4:4", "expected a lower and a higher number"),
        ("peak=4:inf", "expected a lower and a higher number"),
        ("peak=4:12:13", "parameter peak: initial value 13.0 is outside its bounds, 4 to 12"),
        ("peak=4:12:nan", "initial value nan is outside its bounds"),
    ],
)
def test_bounds_and_initial_value_are_checked(text, message):
    with pytest.raises(BadInput, match=message):
        parse(text)


def test_largest_step_is_a_number_above_0_and_limits_a_proposal():
    with pytest.raises(BadInput, match="parameter k: largest step 0.0: expected a number above 0"):
        Parameter("k", 0.0, 1.0, largest_step=0.0)
    parameters = [Parameter("k", 0.0, 1.0, largest_step=0.25), Parameter("b", 0.0, 1.0)]
    present = {"k": 0.5, "b": 0.5}
    assert within_step(parameters, present, {"k": 1.0, "b": 1.0}) == {"k": 0.75, "b": 1.0}
    assert within_step(parameters, present, {"k": 0.0, "b": 0.0}) == {"k": 0.25, "b": 0.0}
    assert within_step(parameters, present, {"k": 0.6, "b": 0.5}) == {"k": 0.6, "b": 0.5}


def test_proposals_are_within_the_bounds_and_depend_on_the_seed_alone(name):
    def proposals(seed):
        optimiser = make_optimiser(name, TORQUE, seed=seed, population=6)
        for _ in range(15):
            values = optimiser.ask()
            optimiser.tell(values, -values["profile.peak"])  # its optimum is a bound
            yield values

    first = list(proposals(1))
    np.random.seed(7)
    random.seed(7)
    assert list(proposals(1)) == first != list(proposals(2))
    assert all(4.0 <= one["profile.peak"] <= 12.0 and 0.48 <= one["profile.timing"] <= 0.58 for one in first)
    used = np.random.random()
    np.random.seed(7)
    assert used == np.random.random()  # no optimiser uses numpy.random


def test_points_of_a_generation_are_proposed_before_their_costs(name):
    optimiser = make_optimiser(name, TORQUE, population=6)
    for generation in range(4):
        assert optimiser.generation == generation
        for values in [optimiser.ask() for _ in range(6)]:
            optimiser.tell(values, cost(values))
    assert len(optimiser.told) == 24


def test_optimiser_continues_from_its_state_with_the_same_proposals(name):
    """After proposals without a cost, costs of other values, and failed evaluations."""
    optimiser = make_optimiser(name, TORQUE, seed=3, population=5)
    for number in range(23):
        values = optimiser.ask()
        if number % 7 == 3:
            values = optimiser.ask()  # the one before is skipped
        if number % 5 == 2:
            values = {**values, "profile.peak": 8.0}  # limited by its largest step
        optimiser.tell(values, math.inf if number % 6 == 1 else cost(values))
    state = json.loads(json.dumps(optimiser.state()))
    again = restore_optimiser(state)
    assert again.told == optimiser.told and again.state() == state
    rest = [optimiser.ask() for _ in range(5)]
    assert [again.ask() for _ in range(5)] == rest
    assert restore_optimiser(again.state()).ask() == rest[0]  # proposals without a cost are made again


def test_costs_that_are_no_number_and_values_outside_the_bounds_are_rejected(name):
    optimiser = make_optimiser(name, TORQUE)
    values = optimiser.ask()
    for wrong in (math.nan, -math.inf):
        with pytest.raises(BadInput, match=f"cost = {wrong}: expected a number, or inf for an evaluation that failed"):
            optimiser.tell(values, wrong)
    with pytest.raises(BadInput, match="profile.peak = 12.5: expected a number from 4 to 12"):
        optimiser.tell({**values, "profile.peak": 12.5}, 1.0)
    with pytest.raises(BadInput, match="profile.peak = None: expected a number"):
        optimiser.tell({"profile.timing": 0.5}, 1.0)
    assert optimiser.told == []


def test_optimum_is_found_without_noise(name):
    optimiser = make_optimiser(name, TORQUE, seed=1)
    for _ in range(60):
        values = optimiser.ask()
        optimiser.tell(values, cost(values))
    tolerance = {"cma": 0.02, "bayesian": 0.2, "random": 0.3}[name]
    best = optimiser.optimum()
    assert abs(best["profile.peak"] - 9.0) < 8.0 * tolerance
    assert abs(best["profile.timing"] - 0.55) < 0.1 * tolerance


def test_bayesian_optimisation_starts_from_the_initial_values():
    pytest.importorskip("optuna")
    assert make_optimiser("bayesian", TORQUE).ask() == {"profile.peak": 8.0, "profile.timing": 0.5}


@pytest.mark.parametrize(
    "arguments, message",
    [
        (("cmaes", TORQUE), "no optimiser 'cmaes': did you mean 'cma'?"),
        (("grid", TORQUE), "no optimiser 'grid': expected one of cma, bayesian, random"),
        (("random", []), "no parameter to optimise: add one, as in --over 'profile.peak=4:12'"),
        (("random", TORQUE[:1] * 2), "parameter profile.peak is given twice: remove one"),
        (("random", TORQUE, -1), "seed = -1: expected a whole number, 0 or more"),
        (("random", TORQUE, 0, 1), "population = 1: expected a whole number, 2 or more"),
        (("cma", TORQUE[:1]), "CMA-ES needs two parameters or more: add one, or choose the optimiser bayesian"),
    ],
)
def test_wrong_arguments_are_rejected(arguments, message):
    if arguments[0] == "cma":
        pytest.importorskip("cma")
    with pytest.raises(BadInput) as error:
        make_optimiser(*arguments)
    assert str(error.value) == message


@pytest.mark.parametrize("module, name", [("cma", "cma"), ("optuna", "bayesian")])
def test_missing_package_is_named_with_the_extra_that_installs_it(monkeypatch, module, name):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(BadInput, match=rf"needs {module}: pip install 'tickwork\[optimise\]'"):
        make_optimiser(name, TORQUE)
