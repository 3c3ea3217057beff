"""State of an optimisation in a file, which is rejected if its parameters or costs cannot be those of a run."""

import json

import pytest

from runtime.experiments.optimisation.parameters import Parameter
from runtime.experiments.optimisation.state_file import first, read
from runtime.host.errors import BadInput

PEAK = Parameter("peak", 4.0, 10.0)
ABOUT = {"optimiser": "random", "seed": 0, "population": 2, "over": [vars(PEAK)]}
MISTAKES = {
    "accepted parameters outside the bounds": (
        lambda state: state.update(accepted={"peak": 11.0}),
        "peak = 11.0 of 'accepted': expected a number from 4 to 10",
    ),
    "accepted parameters that are not a number": (
        lambda state: state.update(accepted={"peak": float("nan")}),
        "peak = nan of 'accepted': expected a number from 4 to 10",
    ),
    "no accepted parameters": (lambda state: state.update(accepted={}), "the names of 'accepted' are not those of"),
    "an evaluation outside the bounds": (
        lambda state: state["optimiser"]["told"][0][1].update(peak=50.0),
        "peak = 50.0 of a cost: expected a number from 4 to 10",
    ),
    "a cost that is text": (lambda state: state["optimiser"]["told"][0].__setitem__(2, "x"), "could not convert"),
    "a cost that is not a number": (
        lambda state: state["optimiser"]["told"][0].__setitem__(2, float("nan")),
        "cost = nan: expected a finite number",
    ),
    "other bounds": (
        lambda state: state["optimiser"]["parameters"][0].update(high=100.0),
        "the parameters of 'optimiser' are not those of 'over'",
    ),
    "no optimiser": (lambda state: state.pop("optimiser"), "missing 'optimiser'"),
    "no validation trials": (lambda state: state.pop("validated"), "missing 'validated'"),
}


def written(folder, state):
    path = folder / "a.optimisation.json"
    path.write_text(json.dumps(state))
    return path


def state_of_one_evaluation():
    state = json.loads(json.dumps(first(ABOUT, [PEAK])))
    state["optimiser"]["told"] = [[1, {"peak": 5.0}, 300.0]]
    return state | {"accepted": {"peak": 5.0}, "validated": [["zero", [None, None, 0]], ["found", [1.0, 0.1, 9]]]}


def test_state_is_read_as_it_was_written(tmp_path):
    state = read(written(tmp_path, state_of_one_evaluation()), ABOUT)
    assert state["accepted"] == {"peak": 5.0} and state["validated"][1] == ["found", [1.0, 0.1, 9]]


@pytest.mark.hazard("H16a")
@pytest.mark.parametrize("mistake", MISTAKES)
def test_state_that_was_changed_by_hand_is_rejected(mistake, tmp_path):
    change, reason = MISTAKES[mistake]
    state = state_of_one_evaluation()
    change(state)
    path = written(tmp_path, state)
    with pytest.raises(BadInput) as error:
        read(path, ABOUT)
    assert str(error.value).startswith(f"--resume {path}: its content was changed or is damaged: {reason}")


def test_other_bounds_are_named_as_the_option_has_them(tmp_path):
    path = written(tmp_path, state_of_one_evaluation())
    with pytest.raises(BadInput) as error:
        read(path, {**ABOUT, "over": [vars(Parameter("peak", 4.0, 12.0, largest_step=2.0, initial=5.0))]})
    assert "it was made with over peak=4:10, now peak=4:12:5 (largest step 2)" in str(error.value)
