"""State of an optimisation with a wearer as a JSON file, from which it continues.

version     2
about       settings that a continued optimisation must share: diagram, over, cost, settle, measure, ...
optimiser   state of the optimiser, with every cost, and the costs of the reference
errors      standard errors of these costs, null if unknown
accepted    last parameters whose cost was measured
validated   [[condition, [cost, standard error, samples]], ...] of the validation trials
found       the optimum that the optimiser estimates
intervals   {parameter: [low, high]}, in which it lies with a probability of 95 %; empty before a fit determines one
finished    whether all measurements were made
"""

from __future__ import annotations

import json
import math
import os
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from runtime.experiments.optimisation.finding import intervals
from runtime.host.errors import BadInput
from runtime.record.recorder.report import PARTIAL, write_json

if TYPE_CHECKING:
    from collections.abc import Iterable

    from runtime.experiments.optimisation.parameters import Parameter
    from runtime.experiments.optimisation.protocol import Protocol

VERSION = 2


class StateFile:
    """File of the state.

    path : path of the file
    state : as `first` or `read` returns it
    """

    def __init__(self, path: str | os.PathLike[str], state: dict[str, Any]) -> None:
        self.path, self.state = os.fspath(path), state

    def save(self, protocol: Protocol) -> None:
        """Replace the file, so that it is complete whenever the computer fails. Raises OSError."""
        optimiser, fit = protocol.optimiser, protocol.optimiser.fit()
        self.state = {
            **self.state,
            "optimiser": optimiser.state(),
            "errors": [*self.state["errors"], *protocol.errors],
            "accepted": protocol.accepted,
            "validated": [[name, [each.value, each.error, each.count]] for name, each in protocol.validated],
            "found": optimiser.optimum(fit),
            "intervals": intervals(optimiser.parameters, fit),
            "finished": protocol.finished,
        }
        protocol.errors.clear()
        with suppress(FileNotFoundError):  # of a process that was killed
            os.unlink(self.path + PARTIAL)
        write_json(self.path, self.state)


def first(about: dict[str, Any], parameters: Iterable[Parameter]) -> dict[str, Any]:
    """Return the state before the first evaluation, with the optimiser, seed and population of `about`."""
    return {
        "version": VERSION,
        "about": about,
        "optimiser": {
            **{name: about[name] for name in ("optimiser", "seed", "population")},
            "parameters": [vars(parameter) for parameter in parameters],
            "told": [],
            "references": [],
        },
        "errors": [],
        "accepted": None,
        "validated": [],
        "found": None,
        "intervals": {},
        "finished": False,
    }


def read(path: str | os.PathLike[str], about: dict[str, Any]) -> dict[str, Any]:
    """Return the state in a file.

    about : settings of this optimisation, which those of the file must equal

    Raises BadInput.
    """
    try:
        with open(path, encoding="utf-8") as file:
            state = json.load(file)
        if state["version"] != VERSION:
            raise BadInput(f"{path}: version {state['version']} of the state; this release reads version {VERSION}")
        known = state["about"]
    except OSError as error:
        raise BadInput(f"--resume {path}: {error.strerror}") from None
    except (ValueError, KeyError, TypeError):
        raise BadInput(f"--resume {path}: this is not the state of an optimisation, *.optimisation.json") from None
    differing = [name for name in {**known, **about} if known.get(name) != about.get(name)]
    if differing:
        changes = "; ".join(
            f"{name} {_value_text(known.get(name))}, now {_value_text(about.get(name))}" for name in differing
        )
        raise BadInput(f"--resume {path}: it was made with {changes}. Pass the same options, or begin without --resume")
    try:
        _check(state)
        state["validated"] = [
            [name, [math.nan if number is None else float(number) for number in (value, error)] + [int(samples)]]
            for name, (value, error, samples) in state["validated"]
        ]
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        reason = f"missing {error}" if isinstance(error, KeyError) else error
        raise BadInput(f"--resume {path}: its content was changed or is damaged: {reason}") from None
    return state


def _value_text(value):
    """Return a setting as text: parameters by their names, bounds and initial value, as the option --over has them."""
    if not isinstance(value, list) or not all(isinstance(each, dict) for each in value) or not value:
        return repr(value)

    def in_words(each):
        numbers = [number for key in ("low", "high", "initial") if (number := each.get(key)) is not None]
        step = each.get("largest_step")
        bounds = ":".join(f"{number:g}" if isinstance(number, float) else str(number) for number in numbers)
        return f"{each.get('name')}={bounds}" + (f" (largest step {step:g})" if isinstance(step, float) else "")

    return ", ".join(map(in_words, value))


def _check(state):
    """Raise ValueError, KeyError or TypeError for a state that no optimisation has written.

    The parameters that it restores must be within the bounds of the optimisation.
    """
    over = state["about"]["over"]
    if state["optimiser"]["parameters"] != over:
        raise ValueError("the parameters of 'optimiser' are not those of 'over'")
    places = [("a cost", values) for _, values, _ in state["optimiser"]["told"]]
    if state["accepted"] is not None:
        places.append(("'accepted'", state["accepted"]))
    for place, values in places:
        if sorted(values) != sorted(parameter["name"] for parameter in over):
            raise ValueError(f"the names of {place} are not those of 'over'")
        for parameter in over:
            value, low, high = values[parameter["name"]], parameter["low"], parameter["high"]
            if not low <= value <= high:
                raise ValueError(
                    f"{parameter['name']} = {value!r} of {place}: expected a number from {low:g} to {high:g}"
                )
    for _, _, cost in state["optimiser"]["told"]:
        if not float(cost) < math.inf:
            raise ValueError(f"cost = {cost!r}: expected a finite number")
    list(state["errors"])
