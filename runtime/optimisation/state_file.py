"""State of an optimisation with a wearer as a JSON file, from which it continues.

version     1
about       settings that a continued optimisation must share: diagram, over, cost, settle, measure, ...
optimiser   state of the optimiser, with every cost
errors      standard errors of these costs, null if unknown
accepted    last parameters whose cost was measured
validated   [[condition, [cost, standard error, samples]], ...] of the validation trials
found       the optimum that the optimiser estimates
finished    whether all measurements were made
"""

from __future__ import annotations

import json
import math
import os
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from runtime.base.errors import BadInput
from runtime.recorder.report import PARTIAL, write_json

if TYPE_CHECKING:
    from collections.abc import Iterable

    from runtime.optimisation.parameters import Parameter
    from runtime.optimisation.protocol import Protocol

VERSION = 1


class StateFile:
    """File of the state.

    path : of the file
    state : as `first` or `read` returns it
    """

    def __init__(self, path: str | os.PathLike[str], state: dict[str, Any]) -> None:
        self.path, self.state = os.fspath(path), state

    def save(self, protocol: Protocol) -> None:
        """Replace the file, so that it is complete whenever the computer fails. Raises OSError."""
        self.state = {
            **self.state,
            "optimiser": protocol.optimiser.state(),
            "errors": [*self.state["errors"], *protocol.errors],
            "accepted": protocol.accepted,
            "validated": [[name, [each.value, each.error, each.count]] for name, each in protocol.validated],
            "found": protocol.optimiser.optimum(),
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
        },
        "errors": [],
        "accepted": None,
        "validated": [],
        "found": None,
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
        changes = "; ".join(f"{name} {known.get(name)!r}, now {about.get(name)!r}" for name in differing)
        raise BadInput(f"--resume {path}: it was made with {changes}. Pass the same options, or begin without --resume")
    state["validated"] = [
        [name, [math.nan if number is None else number for number in numbers]] for name, numbers in state["validated"]
    ]
    return state
