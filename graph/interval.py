"""Closed intervals of real numbers: what the compiler knows of a wire. Ends are rounded outward, so that what is proved
holds in floating point.
"""

import math
from dataclasses import dataclass


def _down(value):
    return math.nextafter(value, -math.inf)


def _up(value):
    return math.nextafter(value, math.inf)


@dataclass(frozen=True)
class Interval:
    """All x with low <= x <= high, or NaN: a NaN passes every block and is a fault at the actuator."""

    low: float = -math.inf
    high: float = math.inf

    def __post_init__(self):
        if not self.low <= self.high:
            raise ValueError(f"an interval from {self.low} to {self.high} is empty")

    @classmethod
    def point(cls, value):
        """The interval of a number; everything, for NaN."""
        return cls() if math.isnan(value) else cls(float(value), float(value))

    @property
    def bounded(self):
        return math.isfinite(self.low) and math.isfinite(self.high)

    def __contains__(self, other):
        """Whether a number, or every number of another interval, lies in this one."""
        if isinstance(other, Interval):
            return self.low <= other.low and other.high <= self.high
        return self.low <= other <= self.high

    def __neg__(self):
        return Interval(-self.high, -self.low)

    def __add__(self, other):
        low, high = self.low + other.low, self.high + other.high
        if math.isnan(low) or math.isnan(high):
            return EVERYTHING  # an infinity less itself: NaN, or whatever else the ends hold
        return Interval(  # a sum with 0 is exact
            low if self.low == 0.0 or other.low == 0.0 else _down(low),
            high if self.high == 0.0 or other.high == 0.0 else _up(high),
        )

    def __sub__(self, other):
        return self + -other

    def __mul__(self, other):
        corners = [_times(a, b) for a in (self.low, self.high) for b in (other.low, other.high)]
        low, high = min(corners), max(corners)
        exact = 1.0 in (abs(self.low), abs(other.low)) and (self.low == self.high or other.low == other.high)
        return Interval(low, high) if exact else Interval(_down(low) if low else 0.0, _up(high) if high else 0.0)

    def __truediv__(self, other):
        """Everything where the divisor may be zero: 1 / 0 and 1 / -0 are both ends of the line. Division never falls
        between its ends.
        """
        if 0.0 in other:
            return Interval()
        corners = [
            a / b
            for a in (self.low, self.high)
            for b in (other.low, other.high)
            if not (math.isinf(a) and math.isinf(b))
        ]
        return Interval(min(corners), max(corners)) if corners else Interval()

    def __or__(self, other):
        """The smallest interval that holds both."""
        return Interval(min(self.low, other.low), max(self.high, other.high))

    def __and__(self, other):
        """What lies in both; the nearer end of this one where nothing does."""
        low, high = max(self.low, other.low), min(self.high, other.high)
        return Interval(low, high) if low <= high else Interval.point(self.low if other.high < self.low else self.high)

    def widened(self, before):
        """This interval, with every end that lies outside an earlier one at infinity."""
        return Interval(
            self.low if self.low >= before.low else -math.inf, self.high if self.high <= before.high else math.inf
        )

    def __abs__(self):
        low = 0.0 if 0.0 in self else min(abs(self.low), abs(self.high))
        return Interval(low, max(abs(self.low), abs(self.high)))

    def __str__(self):
        return f"[{self.low:g}, {self.high:g}]"


def _times(a, b):
    return 0.0 if a == 0.0 or b == 0.0 else a * b  # a bound of 0 times an infinite one is 0


EVERYTHING = Interval()
