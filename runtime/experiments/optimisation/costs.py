"""Costs that are measured during a run: a metabolic cart, a signal of the diagram, or a number that is typed."""

from __future__ import annotations

import math

import numpy as np

from runtime.experiments.optimisation.cart import Cart
from runtime.experiments.optimisation.metabolic import (
    HIGHEST_POWER,
    LOWEST_POWER,
    Estimate,
    mean,
    plausible,
    steady_state,
)
from runtime.host.console.styles import count
from runtime.host.errors import BadInput

CART_SILENCE, SIGNAL_SILENCE = 30.0, 2.0  # s without a sample after which a measurement is missing
CART_SAMPLES = 10  # in a measurement: fewer breaths give no useful estimate
BLOCKS = 10  # of a signal without strides, whose means give its standard error
WRAP = 0.5  # decrease of a gait phase, from 0 to 1, at which a stride begins


class Missing(Exception):
    """A measurement that has no result. The text is the reason."""


class Cost:
    """Cost of a wearer's evaluations.

    name : name of the source in messages
    unit : unit of the cost, "" without one
    typed : whether the operator types the cost
    """

    name, unit, typed = "", "", False

    def take(self, now: float) -> None:
        """Take the samples that have arrived. now : s"""

    def forget(self, before: float) -> None:
        """Remove the samples before a time in s."""

    def check(self, now: float, begin: float) -> None:
        """Raise Missing once a measurement that has begun at a time in s cannot succeed any more."""

    def complete(self, now: float, stop: float) -> bool:
        """Return whether no sample from before `stop` is expected any more. Times in s"""
        return True

    def estimate(self, begin: float, start: float, stop: float) -> Estimate:
        """Return the cost. Raises Missing.

        begin, start, stop : times of the change, and of the start and the end of the measurement, in s
        """
        raise NotImplementedError


class Typed(Cost):
    """Number that the operator types, such as a rating."""

    name, typed = "the typed cost", True


class Sampled(Cost):
    """Cost estimated from samples. silence : s without a sample after which a measurement is missing"""

    silence = SIGNAL_SILENCE

    def __init__(self) -> None:
        self.times: list[float] = []
        self.rows: list[tuple[float, ...]] = []

    def add(self, time: float, *values: float) -> None:
        """Add a sample. time : s"""
        self.times.append(time)
        self.rows.append(values)

    def forget(self, before: float) -> None:
        count = sum(time < before for time in self.times)
        del self.times[:count], self.rows[:count]

    def check(self, now: float, begin: float) -> None:
        last = max(self.times[-1] if self.times else begin, begin)
        if now - last > self.silence:
            raise Missing(f"no sample of {self.name} for {self.silence:g} s")

    def complete(self, now: float, stop: float) -> bool:
        return bool(self.times and self.times[-1] >= stop) or now - stop > self.silence

    def estimate(self, begin: float, start: float, stop: float) -> Estimate:
        chosen = [(time, row) for time, row in zip(self.times, self.rows) if start <= time <= stop]
        times, rows = np.array([time for time, _ in chosen]), np.array([row for _, row in chosen])
        if not np.isfinite(rows).all():
            raise Missing(f"{self.name} was {rows[~np.isfinite(rows)][0]}")
        try:
            if len(times) == 0:
                raise ValueError("no samples in the measurement")
            return self.fit(times - begin, rows)
        except ValueError as error:
            raise Missing(f"{self.name}: {error}") from None

    def fit(self, times: np.ndarray, rows: np.ndarray) -> Estimate:
        """Return the estimate of samples. Raises ValueError where they give none.

        times : s since the change
        rows : array (samples, values)
        """
        raise NotImplementedError


class CartCost(Sampled):
    """Metabolic power in W, fitted as a first-order response.

    cart : source of the samples
    time_constant : time constant of the response in s
    """

    unit, silence = "W", CART_SILENCE

    def __init__(self, cart: Cart, time_constant: float) -> None:
        super().__init__()
        self.cart, self.name, self.time_constant = cart, cart.name, time_constant
        self.problem = ""  # of a table that cannot be read
        self.before = 0  # lines rejected before the measurement

    def take(self, now: float) -> None:
        try:
            for time, watts in self.cart.take(now):
                self.add(time, watts)
        except BadInput as error:
            self.problem = str(error)

    def check(self, now: float, begin: float) -> None:
        if self.problem:
            raise Missing(self.problem)
        try:
            super().check(now, begin)
        except Missing as error:
            raise Missing(f"{error}{self.rejection()}") from None

    def forget(self, before: float) -> None:
        super().forget(before)
        self.before = self.cart.table.rejected

    def rejection(self) -> str:
        """Return how many lines were rejected in the measurement, and one with the reason; "" if there were none."""
        number = self.cart.table.rejected - self.before
        return f"; {count(number, 'line')} rejected, such as {self.cart.table.reason}" if number else ""

    def fit(self, times: np.ndarray, rows: np.ndarray) -> Estimate:
        if len(times) < CART_SAMPLES:
            raise ValueError(f"{len(times)} valid samples, expected {CART_SAMPLES} or more{self.rejection()}")
        estimate = steady_state(times, rows[:, 0], self.time_constant)
        if not plausible(estimate.value):
            raise ValueError(
                f"an estimate of {estimate.value:.4g} W is outside the range of {LOWEST_POWER:g} to {HIGHEST_POWER:g} W"
            )
        return estimate


class SignalCost(Sampled):
    """Mean of a signal over the time of the measurement, or over its whole strides.

    name, unit : name and unit of the signal
    time_constant : s, of a signal that is fitted as a first-order response; None for the mean
    strides : whether the samples have a gait phase as second value, 0 at heel strike and 1 before the next
    """

    def __init__(self, name: str, unit: str, time_constant: float | None = None, strides: bool = False) -> None:
        super().__init__()
        self.name, self.unit = name, "" if unit in ("1", "any") else unit
        self.time_constant, self.strides = time_constant, strides

    def fit(self, times: np.ndarray, rows: np.ndarray) -> Estimate:
        values = rows[:, 0]
        if self.time_constant is not None:
            return steady_state(times, values, self.time_constant)
        if not self.strides:
            estimate = mean(values)
            return Estimate(estimate.value, blocks_error(values), estimate.count)
        begins = np.flatnonzero(np.diff(rows[:, 1]) < -WRAP) + 1
        if len(begins) < 2:
            raise ValueError("no complete stride in the measurement")
        return mean([float(np.mean(values[first:last])) for first, last in zip(begins, begins[1:])])


def blocks_error(values: np.ndarray) -> float:
    """Return the standard error of the mean of correlated samples, from the means of consecutive blocks."""
    if len(values) < 2 * BLOCKS:
        return math.nan
    return mean([float(np.mean(block)) for block in np.array_split(values, BLOCKS)]).error
