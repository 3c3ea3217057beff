"""Gains of a loop that are tuned offline against its distance from -1 and its damping."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from graph import DiagramError
from runtime.host.errors import BadInput
from runtime.robot.loading.file import load
from runtime.session.loop import Loop

if TYPE_CHECKING:
    import os

    from runtime.robot.loading.overrides import Settings

EVALUATIONS = 40  # for each gain
DECADES = 4  # below half of the rate over which the mean sensitivity is taken


def tune(
    file: str | os.PathLike[str],
    name: str,
    gains: Sequence[str],
    distance: float,
    at: float = 0.0,
    settings: Settings = (),
    amplitude: float | None = None,
    damping: float = 0.4,
) -> tuple[Loop, dict[str, float]]:
    """Return the loop with the least mean of log |1 / (1 + L)| within a distance |1 + L| and a damping, and its gains.

    The mean is over the logarithm of the frequency, in the four decades below half of the rate. The Nelder-Mead method
    varies the logarithms of the gains, from their values in the diagram: it finds a minimum near those.

    name : input at which the loop is opened
    gains : parameters of blocks, "pid.kp", that are not 0
    distance : least |1 + L|, above 0 and below 1
    damping : least damping ratio of the closed loop, at least 0 and at most 0.7

    Raises BadInput, also if no loop near the present gains has this distance and damping.
    """
    from scipy.optimize import minimize

    if not 0.0 < distance < 1.0:
        raise BadInput(f"the distance from -1 must be above 0 and below 1, got {distance:g}")
    if not 0.0 <= damping <= 0.7:
        raise BadInput(f"the damping ratio must be between 0 and 0.7, got {damping:g}")
    _, diagram = load(file, settings)
    start = []
    for gain in gains:
        path, _, parameter = gain.rpartition(".")
        value = getattr(diagram.blocks.get(path), parameter, None)
        value = getattr(value, "value", value)  # a live one
        if not isinstance(value, (int, float)) or isinstance(value, bool) or value == 0.0 or not math.isfinite(value):
            raise BadInput(f"{gain} is {value!r}: name a parameter that is a number other than 0")
        start.append(float(value))

    def loop_of(factors: np.ndarray) -> Loop:
        values = np.array(start) * np.exp(factors)
        own = [(gain, f"{value:.4g}") for gain, value in zip(gains, values)]
        return Loop(file, name, at, [*settings, *own], amplitude)

    def cost(factors: np.ndarray) -> float:
        try:
            loop = loop_of(factors)
        except (BadInput, DiagramError):
            return 1e6  # beyond the bounds of a parameter, or a fault in the run
        if loop.pole >= 1.0 or not loop.linear:
            return 1e3 * (1.0 + loop.pole)
        sensitivity = 1.0 / np.abs(1.0 + loop.response)
        nearest = 1.0 / sensitivity.max()
        counted = loop.frequencies > loop.rate / 2.0 / 10.0**DECADES
        sensitivity, x = np.log(sensitivity[counted]), np.log(loop.frequencies[counted])
        mean = np.sum((sensitivity[1:] + sensitivity[:-1]) / 2.0 * np.diff(x)) / (x[-1] - x[0])
        return float(mean) + 100.0 * (max(0.0, distance - float(nearest)) + max(0.0, damping - loop.damping))

    loop_of(np.zeros(len(start)))  # with its errors
    simplex = np.vstack([np.zeros(len(start)), 0.5 * np.eye(len(start))])
    options = {"maxfev": EVALUATIONS * len(start), "initial_simplex": simplex, "xatol": 0.01, "fatol": 1e-4}
    found = minimize(cost, np.zeros(len(start)), method="Nelder-Mead", options=options)
    best = loop_of(found.x)
    reached = float(np.abs(1.0 + best.response).min())
    if best.pole >= 1.0 or not best.linear or reached < 0.98 * distance or best.damping < 0.98 * damping:
        raise BadInput(
            f"no gains near the present ones have |1 + L| of at least {distance:g} and a damping ratio of at least "
            f"{damping:g} at {name} (reached: {reached:.3g} and {best.damping:.2g}): start from lower gains, or lower "
            "--distance or --damping"
        )
    return best, {gain: float(f"{value:.4g}") for gain, value in zip(gains, np.array(start) * np.exp(found.x))}
