"""One trial of a study: a run in virtual time and its objectives, as a row of the table."""

from __future__ import annotations

import math
import os
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from graph import DiagramError
from runtime.experiments.studies.description import read_study
from runtime.experiments.studies.objectives import load
from runtime.host.errors import BadInput
from runtime.record.analysis.trial import Trial
from runtime.session.simulate import simulate

_PACKAGE = str(Path(__file__).parents[2]) + os.sep
Objectives = Mapping[str, Callable[[Trial], float]]


class UserCodeError(Exception):
    """Exception of a diagram or an objective, other than BadInput. The text has its type, its text and its place."""


def trial_row(diagram: Any, run: Mapping[str, Any], objectives: Objectives) -> dict[str, Any]:
    """Run a trial and return {"ticks", "fault", "error", "invalid", objective: number}.

    run : arguments of runtime.run

    After a fault, where the wearer exceeds a limit of people, and where the run or an objective raises BadInput, the
    objectives are None, and `fault`, `invalid` or `error` is the reason. `error` also names objectives that are not
    finite. Raises UserCodeError.
    """
    nothing = dict.fromkeys(["fault", "error", "invalid", *objectives])
    try:
        trial = simulate(diagram, **run)
        if trial.fault is not None:
            culprit = trial.fault.get("culprit")
            text = trial.fault["status"] + (f": {culprit}" if culprit else "")
            return {**nothing, "ticks": len(trial), "fault": text}
        if trial.implausible:
            return {**nothing, "ticks": len(trial), "invalid": trial.implausible}
        values = {name: _number(name, function(trial)) for name, function in objectives.items()}
        wrong = [f"{name} = {value}" for name, value in values.items() if not math.isfinite(value)]
        reason = f"{', '.join(wrong)}: expected a finite number" if wrong else None
        return {**nothing, "ticks": len(trial), "error": reason, **values}
    except BadInput as error:
        return {**nothing, "ticks": 0, "error": str(error)}
    except DiagramError as error:
        return {**nothing, "ticks": 0, "error": str(error.diagnostics[0])}
    except Exception as error:
        raise UserCodeError(f"{type(error).__name__}: {error} ({_place(error)})") from error


def answer(description: Mapping[str, Any], order: tuple[int, dict[str, Any]]) -> dict[str, Any]:
    """Run a trial in another process and return its row, or {"trial", "stop": text} for an exception in user code.

    description : description of the study, as in its TOML file
    order : number of the trial, its parameters
    """
    study = read_study(description)
    objectives = {name: load(name, given) for name, given in study.objectives.items()}
    try:
        return {"trial": order[0], **trial_row(study.diagram, study.run_of(order[1]), objectives)}
    except UserCodeError as error:
        return {"trial": order[0], "stop": str(error)}


def _place(error):
    """Return "file:line" of the last call in code outside of this package."""
    calls = traceback.extract_tb(error.__traceback__)
    place = next((call for call in reversed(calls) if not call.filename.startswith(_PACKAGE)), calls[-1])
    return f"{place.filename}:{place.lineno}"


def _number(name, value):
    try:
        return float(value)
    except (TypeError, ValueError):
        raise TypeError(f"objective {name} returned {value!r}: expected a number") from None
