"""Objectives of a study: functions of a Trial that return one number, and the usual ones.

An objective is named as one of those below, as "module:function", or by an entry point in the group
tickwork.objectives.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from runtime.host.errors import BadInput
from runtime.host.plugins import Plugins
from runtime.record.analysis.legs import legs
from runtime.record.analysis.trial import Trial

NAMES = ("mean", "rms", "peak", "tracking_error", "mean_power", "positive_work", "negative_work", "stride_time")
PLUGINS = Plugins("tickwork.objectives", {name: f"runtime.experiments.studies.objectives:{name}" for name in NAMES})


def load(name: str, given: Any) -> Callable[[Trial], float]:
    """Return an objective with its arguments.

    name : name of the objective, for messages
    given : function or its name, or {"function": one of these, argument: value}

    Raises BadInput.
    """
    arguments = dict(given) if isinstance(given, dict) else {"function": given}
    chosen = arguments.pop("function", None)
    if not callable(chosen) and not isinstance(chosen, str):
        raise BadInput(f'objective {name}: no function given: add one, as in function = "rms"')
    try:
        function = chosen if callable(chosen) else PLUGINS.load(chosen)
    except BadInput as error:
        raise BadInput(f"objective {name}: {error}") from None
    except (ImportError, AttributeError, ValueError) as error:
        raise BadInput(f"objective {name}: cannot import {chosen}: {error}") from None
    signature = inspect.signature(function)
    try:
        signature.bind(None, **arguments)
    except TypeError:
        known = ", ".join(list(signature.parameters)[1:]) or "none"
        given_names = ", ".join(arguments) or "none"
        raise BadInput(f"objective {name}: its arguments are {given_names}, those of {chosen} are {known}") from None
    return partial(function, **arguments)  # pyright: ignore[reportReturnType]  # of any module


def mean(trial: Trial, signal: str, after: float = 0.0) -> float:
    """Return the mean of a signal, in its unit. after : s, start of the interval"""
    return float(np.mean(_values(trial, signal, after)))


def rms(trial: Trial, signal: str, after: float = 0.0) -> float:
    """Return the root mean square of a signal, in its unit. after : s, start of the interval"""
    return _rms(_values(trial, signal, after))


def peak(trial: Trial, signal: str, after: float = 0.0) -> float:
    """Return the largest magnitude of a signal, in its unit. after : s, start of the interval"""
    return float(np.max(np.abs(_values(trial, signal, after))))


def tracking_error(trial: Trial, signal: str, reference: str, after: float = 0.0) -> float:
    """Return the root mean square of signal − reference, in their unit. after : s, start of the interval"""
    return _rms(_values(trial, signal, after) - _values(trial, reference, after))


def mean_power(trial: Trial, joint: str, after: float = 0.0) -> float:
    """Return the mean mechanical power of a joint, torque times velocity, in W.

    joint : block with the signals `torque` and `velocity`, such as "left/knee"
    after : s, start of the interval
    """
    return float(np.mean(_values(trial, f"{joint}.torque", after) * _values(trial, f"{joint}.velocity", after)))


def positive_work(trial: Trial, leg: str) -> float:
    """Return the positive work of a leg's joint in J, mean of its strides. leg : as in `plot --strides`: "left" """
    return _of_leg(trial, leg)["positive_work"]


def negative_work(trial: Trial, leg: str) -> float:
    """Return the negative work of a leg's joint in J, mean of its strides. leg : as in `plot --strides`: "left" """
    return _of_leg(trial, leg)["negative_work"]


def stride_time(trial: Trial, leg: str) -> float:
    """Return the mean duration of a leg's strides in s. leg : as in `plot --strides`: "left" """
    return _of_leg(trial, leg)["stride_time"]


def _rms(values):
    with np.errstate(over="ignore"):  # infinite for a run that diverges
        return float(np.sqrt(np.mean(values**2)))


def _values(trial, signal, after):
    values = np.asarray(trial[signal], float)[trial.time_of(signal) >= after]
    if not len(values):
        raise BadInput(f"{signal} has no sample after {after:g} s: the run lasts {trial.time[-1]:g} s")
    return values


def _of_leg(trial, leg):
    """Return the means of the strides of one leg, by its title or the path of its joint or StrideReport."""
    results = legs(trial)
    for result in results:
        if leg in (result["title"], result["path"]):
            return result
    raise BadInput(f"no leg {leg!r} with complete strides: expected {', '.join(one['title'] for one in results)}")
