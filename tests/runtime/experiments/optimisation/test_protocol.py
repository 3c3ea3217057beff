"""Optimisation with a wearer in virtual time: its sequence, its keys, and what may fail on the way."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from runtime.experiments.optimisation.cart import Cart
from runtime.experiments.optimisation.costs import CartCost, Cost, Missing, SignalCost, Typed
from runtime.experiments.optimisation.intervals import of_conditions
from runtime.experiments.optimisation.metabolic import Estimate
from runtime.experiments.optimisation.optimisers import Random, restore_optimiser
from runtime.experiments.optimisation.protocol import STAGE_TIME, Settings
from tests.runtime.experiments.optimisation.wearers import (
    INITIAL,
    LOWEST,
    OPTIMUM,
    PARAMETERS,
    PROFILE,
    ZERO,
    Experiment,
    Wearer,
    cma,
)

EVALUATION = ["proposal", "change", "measurement"]


def test_hidden_optimum_is_approached_with_noisy_breaths():
    experiment = Experiment(cma(1), Wearer(noise=0.08), evaluations=36, validations=2, zero=True).run()
    found = experiment.last("found")["values"]
    for each in PARAMETERS:
        assert abs(found[each.name] - OPTIMUM[each.name]) < 0.12 * (each.high - each.low)
    results = {name: [] for name in ("found", "initial", "zero")}
    for name, estimate in experiment.protocol.validated:
        results[name].append(estimate.value)
    means = {name: np.mean(values) for name, values in results.items()}
    assert means == pytest.approx({"found": LOWEST, "initial": INITIAL, "zero": ZERO}, abs=25)
    assert experiment.wearer.targets == found and experiment.protocol.over and experiment.protocol.finished
    assert experiment.events[0]["lines"][0] == "tickwork: 42 measurements of 150 s: 105 min"


@pytest.mark.parametrize("seed", range(4))
def test_profile_of_four_parameters_is_found_within_evaluations_of_literature(seed):
    """Four generations of eight, two minutes each (Zhang et al. 2017). A breath deviates by 10 %, a cost by 2.5 %."""
    wearer = Wearer(noise=0.10, seed=100 + seed, parameters=PROFILE)
    experiment = Experiment(cma(seed, PROFILE, population=8), wearer, evaluations=32, settle=1.0, measure=119.0).run()
    errors = [event["error"] / event["cost"] for event in experiment.events if event["step"] == "measurement"]
    assert np.median(errors) == pytest.approx(0.025, abs=0.01)
    wearer.values = experiment.last("found")["values"]
    assert wearer.cost() < 1.05 * LOWEST
    assert experiment.wearer.time < 70 * 60


def test_each_evaluation_ramps_settles_and_measures():
    experiment = Experiment(evaluations=2).run()
    assert experiment.steps() == ["begin", *EVALUATION, *EVALUATION, "found"]
    proposal, change, measurement = experiment.events[1:4]
    assert proposal["values"] == change["values"] == measurement["values"] == experiment.optimiser.told[0][0]
    assert measurement["cost"] == experiment.optimiser.told[0][1]
    assert 0.0 < change["time"] - proposal["time"] <= 1.5  # the ramp
    assert 150.0 <= measurement["time"] - change["time"] <= 154.0
    assert measurement["samples"] == pytest.approx(40, abs=1) and experiment.saved == 3
    assert measurement["lines"][0].startswith("tickwork: evaluation 1 of 2: ")


def test_cost_without_noise_is_that_of_steady_state():
    experiment = Experiment(evaluations=4).run()
    for values, cost in experiment.optimiser.told:
        experiment.wearer.values = values
        assert cost == pytest.approx(experiment.wearer.cost(), rel=2e-3)


@pytest.mark.hazard("H16b")
def test_proposals_are_within_largest_step_of_accepted_values():
    limited = [replace(PARAMETERS[0], largest_step=1.0), PARAMETERS[1]]
    experiment = Experiment(Random(limited, seed=5), evaluations=8).run()
    peaks = [6.0, *(values["peak"] for values, _ in experiment.optimiser.told)]
    steps = np.abs(np.diff(peaks))
    assert steps.max() <= 1.0 + 1e-12 and (steps > 0.99).sum() >= 3


def test_distant_values_are_reached_by_largest_steps():
    limited = [replace(PARAMETERS[0], largest_step=1.0), PARAMETERS[1]]
    experiment = Experiment(Random(limited, seed=5), evaluations=0, accepted={"peak": 6.0, "timing": 0.44})
    experiment.wearer.hold({"peak": 6.0, "timing": 0.44})
    experiment.optimiser.tell({"peak": 9.5, "timing": 0.44}, 100.0)
    experiment.run()
    assert [values["peak"] for values in experiment.wearer.history] == [6.0, 7.0, 8.0, 9.0, 9.5]
    assert experiment.wearer.time >= 3 * STAGE_TIME


@pytest.mark.hazard("H16b")
def test_first_ramp_starts_at_present_values_of_robot():
    limited = [replace(PARAMETERS[0], largest_step=1.0), PARAMETERS[1]]
    experiment = Experiment(Random(limited, seed=5), evaluations=0)
    experiment.wearer.hold({"peak": 9.0, "timing": 0.44})  # the initial value is 6
    experiment.run()
    assert [values["peak"] for values in experiment.wearer.history] == [8.0, 7.0, 6.0, 6.0]


@pytest.mark.hazard("H16b")
@pytest.mark.parametrize("key", "yn")
def test_values_changed_by_operator_are_left_by_largest_steps(key):
    limited = [replace(PARAMETERS[0], largest_step=1.0), PARAMETERS[1]]
    experiment = Experiment(Random(limited, seed=5), evaluations=1)
    experiment.wearer.hold({"peak": 6.0, "timing": 0.44})
    experiment.run(until=lambda: experiment.protocol.phase == "measure")
    goal = experiment.wearer.targets["peak"] if key == "y" else 6.0
    experiment.wearer.hold({"peak": 9.9})  # with a key
    experiment.run(20)
    assert experiment.steps()[-1] == "interfered"
    experiment.wearer.history.clear()
    experiment.press(key)
    experiment.run(until=lambda: experiment.wearer.values["peak"] == goal)
    peaks = [9.9, *(values["peak"] for values in experiment.wearer.history)]
    assert len(peaks) > 3 and np.abs(np.diff(peaks)).max() <= 1.0 + 1e-9


@pytest.mark.hazard("H16c")
def test_each_change_waits_for_confirmation():
    experiment = Experiment(evaluations=1, confirm=True).run(300)
    assert experiment.steps() == ["begin"] and experiment.wearer.history == []
    experiment.press("y")
    experiment.run(300)
    assert experiment.steps() == ["begin", "proposal"] and experiment.wearer.targets["peak"] == 6.0
    assert experiment.protocol.status == "1/1 y applies, n skips"
    experiment.press("y")
    experiment.run(300)
    assert experiment.steps() == ["begin", *EVALUATION, "found"]


@pytest.mark.hazard("H16c")
def test_a_key_from_before_the_question_is_ignored_and_the_operator_is_asked_to_press_it_again():
    experiment = Experiment(evaluations=1, confirm=True).run(300)
    experiment.protocol.press("y", experiment.protocol.question - 1)
    experiment.run(300)
    assert experiment.steps() == ["begin", "ignored"] and experiment.wearer.history == []
    assert experiment.last("ignored")["lines"][0].endswith("too long ago: press it again")


def test_skipped_proposal_has_no_cost_and_another_follows():
    experiment = Experiment(evaluations=1)
    experiment.run(until=lambda: experiment.protocol.phase == "measure")
    first = experiment.last("proposal")["values"]
    experiment.press("n")
    experiment.run(until=lambda: experiment.protocol.phase == "settle")
    assert experiment.steps() == ["begin", "proposal", "change", "skipped", "proposal", "change"]
    assert experiment.last("proposal")["values"] != first
    assert experiment.wearer.history[2] == {"peak": 6.0, "timing": 0.44}  # the accepted ones before the next
    experiment.run()
    assert len(experiment.optimiser.told) == 1 and experiment.optimiser.told[0][0] != first


def test_pause_holds_parameters_and_measures_again():
    experiment = Experiment(evaluations=1)
    experiment.run(until=lambda: experiment.protocol.phase == "measure")
    experiment.press("p")
    held = dict(experiment.wearer.targets)
    experiment.run(500)
    assert experiment.steps()[-1] == "paused" and experiment.wearer.targets == held
    assert experiment.protocol.status == "1/1 paused, p continues"
    experiment.press("p")
    experiment.run()
    assert experiment.steps() == [
        "begin",
        "proposal",
        "change",
        "paused",
        "continued",
        "change",
        "measurement",
        "found",
    ]
    events = experiment.events
    assert events[6]["time"] - events[4]["time"] >= 150.0


def test_repeated_measurement_begins_again():
    experiment = Experiment(evaluations=1)
    experiment.run(until=lambda: experiment.protocol.phase == "measure").press("r")
    experiment.run()
    assert experiment.steps() == ["begin", "proposal", "change", "repeated", "change", "measurement", "found"]


@pytest.mark.hazard("H16d")
def test_silent_cart_ramps_back_and_waits_for_operator_after_repetitions():
    experiment = Experiment(evaluations=1)
    experiment.run(until=lambda: experiment.protocol.phase == "settle")
    experiment.wearer.silent = True
    began = experiment.wearer.time
    experiment.run(until=lambda: "missing" in experiment.steps())
    assert experiment.wearer.time - began < 35.0  # before the end of the measurement
    assert experiment.last("missing")["reason"] == "no sample of metabolic.tsv for 30 s"
    experiment.run(2.0)
    assert experiment.wearer.history[2] == {"peak": 6.0, "timing": 0.44}
    experiment.run(1000)
    assert experiment.steps("missing") == ["missing"] * 3 and experiment.protocol.phase == "confirm"
    assert experiment.wearer.targets == {"peak": 6.0, "timing": 0.44} and experiment.optimiser.told == []
    experiment.wearer.silent = False
    experiment.press("y")
    experiment.run()
    assert len(experiment.optimiser.told) == 1


def test_table_that_cannot_be_read_is_a_missing_measurement():
    experiment = Experiment(evaluations=1, attended=False)
    experiment.wearer.lines = b"time\tVO2 (mL/min/kg)\tVCO2\n"
    experiment.run()
    assert experiment.last("missing")["reason"].startswith("metabolic.tsv, line 1: column 'VO2 (mL/min/kg)' (oxygen): ")
    assert experiment.steps()[-1] == "abandoned" and not experiment.protocol.finished


def test_lines_with_wrong_units_are_the_reason_of_a_missing_measurement():
    experiment = Experiment(evaluations=1, attended=False)
    experiment.wearer.silent = True
    experiment.run(until=lambda: experiment.protocol.phase == "settle")
    experiment.wearer.lines = b"9\t6\n10\t5.5\n"  # kcal/min instead of W
    experiment.run(until=lambda: "missing" in experiment.steps())
    assert experiment.last("missing")["reason"] == (
        "no sample of metabolic.tsv for 30 s; 2 lines rejected, such as '10\\t5.5', whose 5.5 W is outside the range "
        "of 20 to 3000 W: compare the units of the header with the numbers"
    )


@pytest.mark.hazard("H16d")
def test_an_estimate_that_no_adult_has_is_a_missing_measurement():
    cost = CartCost(Cart(lambda: b"", "metabolic.tsv"), 42.0)
    for time in np.arange(1.0, 120.0, 3.0):
        cost.add(time, 20.0 + 300.0 * math.exp(-time / 42.0) - 60.0 * -math.expm1(-time / 42.0))
    with pytest.raises(Missing, match=r"metabolic.tsv: an estimate of -40 W is outside the range of 20 to 3000 W"):
        cost.estimate(0.0, 0.0, 120.0)


def test_silent_cart_ends_unattended_optimisation():
    experiment = Experiment(evaluations=1, attended=False)
    experiment.wearer.silent = True
    experiment.run(1000)
    assert experiment.protocol.over and experiment.steps()[-1] == "abandoned"
    assert experiment.last("abandoned")["reason"] == "a confirmation is needed, and no terminal is attached"
    assert experiment.wearer.targets == {"peak": 6.0, "timing": 0.44}


class Given(Cost):
    """Cost that gives these estimates in turn."""

    name = "cost"

    def __init__(self, *values):
        self.values = list(values)

    def estimate(self, begin, start, stop):
        value = self.values.pop(0)
        if isinstance(value, Exception):
            raise value
        return Estimate(value, math.nan, 1)


@pytest.mark.parametrize("value", [math.nan, math.inf])
@pytest.mark.hazard("H16d")
def test_cost_that_is_not_finite_is_missing(value):
    signal = SignalCost("cost", "W")
    for time in np.arange(0.0, 200.0):
        signal.add(time, value)
    with pytest.raises(Missing, match=f"cost was {value}"):
        signal.estimate(0.0, 30.0, 150.0)
    experiment = Experiment(cost=Given(Missing(f"cost was {value}"), 5.0), evaluations=1).run()
    assert experiment.steps() == ["begin", "proposal", "change", "missing", "change", "measurement", "found"]
    assert experiment.optimiser.told[0][1] == 5.0


def test_refused_change_keeps_accepted_parameters():
    experiment = Experiment(evaluations=1)
    experiment.run(until=lambda: experiment.steps() == ["begin"] and experiment.wearer.has_arrived())
    experiment.wearer.rejects = True
    experiment.run(100)
    assert experiment.last("missing")["reason"] == "the run rejected peak: out of bounds"
    assert experiment.protocol.phase == "confirm" and experiment.wearer.targets["peak"] == 6.0
    experiment.wearer.rejects = False
    experiment.press("y")
    experiment.run()
    assert experiment.protocol.over and len(experiment.optimiser.told) == 1


@pytest.mark.hazard("H16f")
def test_change_by_another_process_is_not_overridden():
    experiment = Experiment(evaluations=1)
    experiment.run(until=lambda: experiment.protocol.phase == "measure")
    experiment.wearer.targets["peak"] = 4.0  # the operator lowers it with a key
    experiment.run(500)
    assert experiment.last("interfered")["path"] == "left/peak" and experiment.wearer.targets["peak"] == 4.0
    experiment.press("y")
    experiment.run()
    assert len(experiment.optimiser.told) == 1


def test_fault_during_measurement_discards_it():
    experiment = Experiment(evaluations=1)
    experiment.run(until=lambda: experiment.protocol.phase == "measure")
    experiment.wearer.running = False
    experiment.run(60)
    assert experiment.last("missing")["reason"] == "the robot was not running"
    assert experiment.optimiser.told == []
    experiment.wearer.running = True
    experiment.press("y")
    experiment.run()
    assert len(experiment.optimiser.told) == 1


def test_typed_cost_is_asked_again_until_it_is_a_number():
    experiment = Experiment(cost=Typed(), evaluations=1)
    experiment.run(until=lambda: experiment.protocol.typing)
    for key in ("5", "-", "enter"):
        experiment.press(key)
    assert experiment.last("question")["lines"] == [
        "tickwork: '5-': expected a finite number; type the cost, then Enter"
    ]
    for key in ("6", "\x7f", "7", ",", "5"):
        experiment.press(key)
    assert experiment.protocol.status == "1/1 type the cost, then Enter: 7,5_"
    experiment.press("enter")
    experiment.run()
    assert experiment.optimiser.told[0][1] == 7.5


class Exact(Cost):
    """Cost of the wearer without noise."""

    def __init__(self, wearer):
        self.wearer = wearer

    def estimate(self, begin, start, stop):
        return Estimate(self.wearer.cost(), math.nan, 1)


def test_interrupted_optimisation_continues_bit_for_bit():
    wearers = [Wearer() for _ in range(3)]
    whole = Experiment(cma(4), wearers[0], Exact(wearers[0]), evaluations=14).run()
    first = Experiment(cma(4), wearers[1], Exact(wearers[1]), evaluations=14)
    first.run(until=lambda: len(first.optimiser.told) == 8)
    first.run(40)  # in the middle of the ninth evaluation
    optimiser = restore_optimiser(json.loads(json.dumps(first.optimiser.state())))
    second = Experiment(
        optimiser, wearers[2], Exact(wearers[2]), evaluations=14, accepted=first.protocol.accepted
    ).run()
    assert second.optimiser.told == whole.optimiser.told and len(whole.optimiser.told) == 14
    assert second.wearer.history[0] == whole.optimiser.told[7][0]  # the last accepted parameters
    assert second.last("found")["values"] == whole.last("found")["values"]


def test_validation_order_is_random_balanced_and_reproducible():
    settings = Settings(10, 60.0, 120.0, validations=3, zero=True, seed=7)
    order = settings.order()
    assert order == settings.order() and order != replace(settings, seed=8).order()
    assert [sorted(order[first : first + 3]) for first in (0, 3, 6)] == [["found", "initial", "zero"]] * 3


def test_validation_is_blinded_in_terminal_and_named_in_recording():
    experiment = Experiment(evaluations=1, validations=1, zero=True).run()
    trials = [event for event in experiment.events if "condition" in event]
    assert sorted({event["condition"] for event in trials}) == ["found", "initial", "zero"]
    assert not any(name in line for event in trials for line in event["lines"] for name in ("found", "initial", "zero"))


def test_measurements_of_conditions_are_intervals_of_recording():
    experiment = Experiment(evaluations=2, validations=2).run()
    events = [{**event, "tick": round(100 * event["time"])} for event in experiment.events]
    trials = {event["condition"]: event["time"] for event in events if "condition" in event}
    assert of_conditions(events, 100.0, 120.0) == {name: (end - 120.0, end) for name, end in trials.items()}
    evaluations = [event for event in events if "condition" not in event]
    ends = [event["time"] for event in evaluations if event["step"] == "measurement"]
    lowest = 1 + min((0, 1), key=lambda place: experiment.optimiser.told[place][1])
    assert of_conditions(evaluations, 100.0, 120.0) == {
        f"evaluation {number}": (ends[number - 1] - 120.0, ends[number - 1]) for number in {1, lowest}
    }
    assert of_conditions([], 100.0, 120.0) == {}


def test_continued_validation_measures_only_missing_trials():
    whole = Experiment(evaluations=1, validations=1, zero=True).run()
    part = Experiment(
        restore_optimiser(whole.optimiser.state()),
        evaluations=1,
        validations=1,
        zero=True,
        accepted=whole.protocol.initial,
        validated=whole.protocol.validated[:2],
    ).run()
    assert [name for name, _ in part.protocol.validated] == [name for name, _ in whole.protocol.validated]
    assert part.steps() == ["begin", "validation", "change", "measurement", "found"]


def test_initial_parameters_are_measured_before_each_generation_and_survive_an_interruption():
    experiment = Experiment(cma(1, population=4), evaluations=8, reference=4, validations=1).run()
    assert experiment.events[0]["lines"][0] == "tickwork: 13 measurements of 150 s: 32 min"
    steps = experiment.steps("measurement", "reference measurement")
    kinds = [step == "measurement" for step in steps]
    assert kinds == [False, *[True] * 4, False, *[True] * 4, False, True, True]
    assert [place for place, _ in experiment.optimiser.references] == [0, 4, 8]
    assert [cost for _, cost in experiment.optimiser.references] == pytest.approx([INITIAL] * 3, rel=2e-3)
    assert experiment.last("proposal")["values"] == experiment.optimiser.told[-1][0]
    state = json.loads(json.dumps(experiment.optimiser.state()))
    assert restore_optimiser(state).references == experiment.optimiser.references
    skipped = Experiment(evaluations=2, reference=2)
    skipped.run(until=lambda: skipped.protocol.phase == "measure").press("n")
    skipped.run()
    assert [math.isnan(cost) for _, cost in skipped.optimiser.references] == [True, False]


def test_a_rest_break_waits_for_its_time_and_the_operator_and_does_not_count_as_walking():
    experiment = Experiment(evaluations=4, rest_every=290.0, rest=300.0)
    experiment.run(until=lambda: experiment.protocol.phase == "rest")
    begun, walked = experiment.wearer.time, experiment.protocol.walked
    assert len(experiment.optimiser.told) == 2 and walked == pytest.approx(303.0, abs=8.0)
    assert experiment.last("rest")["lines"] == [
        "tickwork: rest break of 5 min: the wearer stands or sits; then y: the wearer walks again"
    ]
    experiment.press("y")  # too early
    experiment.run(700.0)
    assert experiment.protocol.phase == "rest" and experiment.protocol.walked == walked
    assert experiment.protocol.status == "3/4 rest, then y continues 0 s"
    experiment.press("y")
    experiment.run(until=lambda: len(experiment.optimiser.told) == 3)
    assert experiment.wearer.time - begun > 840.0
    unattended = Experiment(evaluations=4, rest_every=290.0, rest=300.0, attended=False).run()
    assert unattended.steps("rest") == ["rest"] and unattended.protocol.finished


@pytest.mark.hazard("H16b")
def test_no_measurement_begins_that_would_exceed_the_limit_of_walking():
    experiment = Experiment(evaluations=20, reference=3, validations=1, walking_limit=1800.0).run()
    assert experiment.events[0]["lines"][0].endswith("; the limit of 30 min of walking allows fewer evaluations")
    told = len(experiment.optimiser.told)
    assert experiment.last("limit")["lines"] == [
        f"tickwork: the limit of 30 min of walking ends the evaluations after {told} of 20"
    ]
    assert 5 <= told <= 7 and len(experiment.protocol.validated) == 2 and experiment.protocol.finished
    assert 1500.0 < experiment.protocol.walked <= 1800.0
    waiting = Experiment(evaluations=1, confirm=True, walking_limit=200.0).run(100.0)
    waiting.press("y")
    waiting.run(300.0)  # the proposal waits for the operator while the wearer walks
    assert waiting.last("limit")["lines"][0].startswith("tickwork: the limit of 3.33333 min of walking is reached. Let")
    waiting.press("y")
    waiting.run(300.0)
    assert waiting.optimiser.told == [] and waiting.protocol.over


def test_signal_cost_is_mean_over_whole_strides():
    cost = SignalCost("left/knee.power", "W", strides=True)
    for time in np.arange(0.0, 20.0, 0.01):
        phase = time / 1.1 % 1.0
        cost.add(time, 10.0 * (phase < 0.5), phase)
    estimate = cost.estimate(0.0, 3.0, 19.0)
    assert estimate.value == pytest.approx(5.0, abs=0.05) and estimate.count == 14
    with pytest.raises(Missing, match="no complete stride in the measurement"):
        cost.estimate(0.0, 3.0, 4.0)
    whole = SignalCost("left/knee.power", "W")
    for time in np.arange(0.0, 20.0, 0.01):
        whole.add(time, 3.0 + math.sin(time))
    assert whole.estimate(0.0, 0.0, 20.0).error > 0.1  # not that of 2000 independent samples
    whole.forget(before=15.0)
    assert len(whole.times) == 500
