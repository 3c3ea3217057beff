"""Optimisations in simulation: their table, the estimate, interruptions, failed runs, and mistakes."""

import math
import re
from xml.etree import ElementTree

import numpy as np
import pytest

import runtime
from runtime.experiments.optimisation import simulated
from runtime.host.errors import OK, BadInput
from tests.runtime.experiments.studies.conftest import folder  # noqa: F401

pytest.importorskip("cma")
parquet = pytest.importorskip("pyarrow.parquet")

COSTS = """\
import numpy as np
from pathlib import Path


def distance(trial):
    sine = 3.2 * np.sin(2.0 * np.pi * trial.time_of("gain.y") + 0.4)
    return float(np.mean((trial["gain.y"] - sine) ** 2) + 0.01 * abs(trial["noise.y"][0]))


def counted(trial):
    with open("count", "a") as file:
        file.write("x")
    return distance(trial)


def interrupted(trial):
    if len(Path("count").read_text() if Path("count").exists() else "") == 13 and not Path("raised").exists():
        Path("raised").touch()
        raise KeyError("interrupted")
    return counted(trial)


def partly(trial):
    return distance(trial) if trial["gain.y"].max() > 2.5 else float("nan")


def never(trial):
    return float("inf")
"""
OPTIMISATION = """\
diagram = "sine.py"
duration = 0.5
[objectives]
distance = "sine_costs:distance"
[optimise]
over = { gain = [0, 5, 4], "sine.phase" = [-1, 1] }
generations = 2
population = 4
"""


@pytest.fixture(autouse=True)
def costs(folder):  # noqa: F811
    (folder / "sine_costs.py").write_text(COSTS)
    return folder


def optimise(cost="sine_costs:distance", **changes):
    given = {"duration": 0.5, "over": {"gain": [0, 5, 4], "sine.phase": [-1, 1]}, "generations": 2, "population": 4}
    return runtime.optimise("sine.py", objectives={"distance": cost}, **{"workers": 0, **given, **changes})


@pytest.mark.soak
def test_table_has_a_row_per_run_with_the_cost_of_each_evaluation_as_their_mean(costs):
    result = optimise(seeds=[1, 2], output="table.parquet")
    table = parquet.read_table(costs / "table.parquet").to_pydict()
    names = ["trial", "generation", "evaluation", "gain", "sine.phase", "seed", "distance"]
    names += ["ticks", "fault", "error", "invalid"]
    assert list(table) == names and len(table["trial"]) == (2 * 4 + 2) * 2
    assert table["generation"] == [0] * 8 + [1] * 8 + [2] * 4 and table["seed"] == [1, 2] * 10
    assert table["gain"][-1] == 4.0 and table["sine.phase"][-1] == 0.0, "the initial values are evaluated at the end"
    means = np.reshape(table["distance"], (-1, 2)).mean(axis=1)
    assert result.costs.tolist() == pytest.approx(means.tolist(), rel=1e-15)
    assert len(set(means)) == 10, "each generation has proposals of its own"
    again = optimise(seeds=[1, 2], output="table.parquet")
    assert again.columns == result.columns and again.optimum == result.optimum, "the finished table is read"


def test_lowest_cost_is_that_of_the_hidden_optimum_and_can_be_run_again():
    result = optimise(generations=6, population=6)
    assert abs(result.optimum["gain"] - 3.2) < 0.02 * 5.0
    assert abs(result.optimum["sine.phase"] - 0.4) < 0.02 * 2.0
    best = int(np.argmin(result.costs))
    assert result.study.proposals[best] == result.optimum
    assert result.run(best)["gain.y"].max() == pytest.approx(3.2, abs=0.1)
    title, initial, lowest = result.summary()
    assert title == "38 evaluations of 1 run each, 0 failed"
    assert "initial" in initial and "evaluation 37: gain=4, sine.phase=0" in initial and "lowest" in lowest


def test_interrupted_optimisation_runs_only_the_missing_trials_and_gives_the_same_table(costs):
    with pytest.raises(BadInput, match=r"trial 13 \(gain=[\d.]+, sine.phase=[-\d.]+, seed=2\): KeyError"):
        optimise("sine_costs:interrupted", seeds=[1, 2], output="interrupted.parquet")
    optimise("sine_costs:interrupted", seeds=[1, 2], output="interrupted.parquet")
    assert len((costs / "count").read_text()) == 20
    optimise("sine_costs:interrupted", seeds=[1, 2], output="whole.parquet")
    assert (costs / "interrupted.parquet").read_bytes() == (costs / "whole.parquet").read_bytes()


def test_optimisation_does_not_continue_with_another_version_of_the_optimiser(costs, monkeypatch):
    with pytest.raises(BadInput, match="KeyError"):
        optimise("sine_costs:interrupted", seeds=[1, 2], output="interrupted.parquet")
    monkeypatch.setattr(simulated, "version", lambda package: "0.1")
    with pytest.raises(BadInput, match="differs in the version of numpy, the version of cma"):
        optimise("sine_costs:interrupted", seeds=[1, 2], output="interrupted.parquet")


@pytest.mark.soak
def test_evaluation_fails_without_a_number_from_each_of_its_runs(costs):
    result = optimise("sine_costs:partly", population=6)
    assert 0 < np.sum(result.costs == math.inf) < 12 and result.costs.min() < 1.0
    title, failure, *_ = result.summary()
    first = int(np.flatnonzero(result.costs == math.inf)[0])
    assert title.endswith(f"{np.sum(result.costs == math.inf)} failed")
    assert failure == f"  first failure: evaluation {first}: distance = nan: expected a finite number"
    assert [each is not None for each in result["error"]] == (result.costs == math.inf).tolist()
    [path] = result.plot().save("optimisation.svg")
    words = {text.text for text in ElementTree.parse(path).iter("{http://www.w3.org/2000/svg}text")}
    assert {"12: estimate", "13: initial"} <= words and list(result["evaluation"][-2:]) == [12, 13], "as the table"
    assert {"failed", "lowest so far", "distance", "gain", "sine.phase"} <= words
    with pytest.raises(
        BadInput,
        match="no proposal of generation 0 has a cost .distance = inf: expected a finite number.: correct the bounds",
    ):
        optimise("sine_costs:never")
    with pytest.raises(BadInput, match="trial 0 .*setting gian="):
        optimise(over={"gian": [0, 5], "sine.phase": [-1, 1]})


MISTAKES = {
    "a misspelt key": ("generations", "generatons", "optimise: unknown key 'generatons'; did you mean 'generations'"),
    "a misspelt cost": ("[optimise]", '[optimise]\ncost = "distnce"', "cost = 'distnce': .*did you mean 'distance'"),
    "two objectives": ("[objectives]", '[objectives]\na = "sine_costs:never"', "cost: not given: .* a, distance"),
    "one limit": ("[0, 5, 4]", "[5]", r"over: gain = \[5\]: expected \[LOW, HIGH\] or \[LOW, HIGH, INITIAL\]"),
    "a text as a limit": ("[0, 5, 4]", '[0, "5"]', "parameter gain: bounds 0 and '5': expected"),
    "no parameter": ('gain = [0, 5, 4], "sine.phase" = [-1, 1]', "", "no parameter to optimise"),
    "no generation": ("generations = 2", "generations = 0", "generations = 0: expected a whole number, 1 or more"),
    "a misspelt optimiser": (
        "population",
        'optimiser = "cmaes"\npopulation',
        "no optimiser 'cmaes': did you mean 'cma'",
    ),
    "a parameter of the grid": ("[objectives]", "[grid]\ngain = [1]\n[objectives]", "'gain' is given in two tables"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistake_in_an_optimisation_is_named(mistake, costs, command_line):
    before, after, phrase = MISTAKES[mistake]
    assert before in OPTIMISATION
    (costs / "study.toml").write_text(OPTIMISATION.replace(before, after, 1))
    assert re.search(phrase, command_line.refused("study", "study.toml", "--workers", "1"))


def test_command_writes_the_table_of_a_call_bit_for_bit_with_a_picture_and_reads_a_finished_one(costs, command_line):
    (costs / "study.toml").write_text(OPTIMISATION.replace('distance"', 'counted"'))
    code, out, err = command_line("study", "study.toml", "--workers", "2")
    assert (code, err) == (OK, "") and "10 evaluations of 1 run each" in out
    assert out.endswith("study.parquet\nstudy.png\n") and (costs / "study.png").stat().st_size > 10_000
    assert command_line("study", "study.toml") == (OK, out, "")
    assert len((costs / "count").read_text()) == 10
    optimise("sine_costs:counted", output="here.parquet")
    assert (costs / "study.parquet").read_bytes() == (costs / "here.parquet").read_bytes()
    (costs / "study.toml").write_text(OPTIMISATION.replace("[0, 5, 4]", "[0, 6, 4]"))
    assert "differs in objectives, optimise" in command_line("study", "study.toml")[2]
