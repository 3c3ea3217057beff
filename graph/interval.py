"""Closed intervals of real numbers: bounds of a signal that the compiler has proved.

Ends are rounded outward, so that a proof holds in floating point.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


def _down(value: float) -> float:
    return math.nextafter(value, -math.inf)


def _up(value: float) -> float:
    return math.nextafter(value, math.inf)


@dataclass(frozen=True)
class Interval:
    """All x with low <= x <= high, and NaN, which passes every block and is a fault at the actuator.

    Raises ValueError unless low <= high.
    """

    low: float = -math.inf
    high: float = math.inf

    def __post_init__(self) -> None:
        if not self.low <= self.high:
            raise ValueError(f"an interval from {self.low} to {self.high} is empty")

    @classmethod
    def point(cls, value: float) -> Interval:
        """Return the interval of one number, or all numbers for NaN."""
        return cls() if math.isnan(value) else cls(float(value), float(value))

    @property
    def bounded(self) -> bool:
        """Whether both ends are finite."""
        return math.isfinite(self.low) and math.isfinite(self.high)

    def __contains__(self, other: float | Interval) -> bool:
        """Return whether a number, or every number of another interval, lies in this one."""
        if isinstance(other, Interval):
            return self.low <= other.low and other.high <= self.high
        return self.low <= other <= self.high

    def __neg__(self) -> Interval:
        return Interval(-self.high, -self.low)

    def __add__(self, other: Interval) -> Interval:
        low, high = self.low + other.low, self.high + other.high
        if math.isnan(low) or math.isnan(high):
            return EVERYTHING  # an infinity less itself: NaN, or whatever else the ends hold
        return Interval(  # a sum with 0 is exact
            low if self.low == 0.0 or other.low == 0.0 else _down(low),
            high if self.high == 0.0 or other.high == 0.0 else _up(high),
        )

    def __sub__(self, other: Interval) -> Interval:
        return self + -other

    def __mul__(self, other: Interval) -> Interval:
        corners = [_times(a, b) for a in (self.low, self.high) for b in (other.low, other.high)]
        low, high = min(corners), max(corners)
        exact = 1.0 in (abs(self.low), abs(other.low)) and (self.low == self.high or other.low == other.high)
        return Interval(low, high) if exact else Interval(_down(low) if low else 0.0, _up(high) if high else 0.0)

    def __truediv__(self, other: Interval) -> Interval:
        """Return the quotient: all numbers if the divisor may be zero, as 1 / 0 and 1 / -0 are opposite infinities."""
        if 0.0 in other:
            return Interval()
        corners = [
            a / b
            for a in (self.low, self.high)
            for b in (other.low, other.high)
            if not (math.isinf(a) and math.isinf(b))
        ]
        return Interval(min(corners), max(corners)) if corners else Interval()

    def __or__(self, other: Interval) -> Interval:
        """Return the smallest interval that contains both."""
        return Interval(min(self.low, other.low), max(self.high, other.high))

    def __and__(self, other: Interval) -> Interval:
        """Return the intersection, or the nearer end of this interval if they do not meet."""
        low, high = max(self.low, other.low), min(self.high, other.high)
        return Interval(low, high) if low <= high else Interval.point(self.low if other.high < self.low else self.high)

    def widened(self, before: Interval) -> Interval:
        """Return this interval, with each end that lies outside an earlier interval at infinity."""
        return Interval(
            self.low if self.low >= before.low else -math.inf, self.high if self.high <= before.high else math.inf
        )

    def __abs__(self) -> Interval:
        low = 0.0 if 0.0 in self else min(abs(self.low), abs(self.high))
        return Interval(low, max(abs(self.low), abs(self.high)))

    def __str__(self) -> str:
        return f"[{self.low:g}, {self.high:g}]"


def _times(a: float, b: float) -> float:
    return 0.0 if a == 0.0 or b == 0.0 else a * b  # a bound of 0 times an infinite one is 0


EVERYTHING = Interval()
