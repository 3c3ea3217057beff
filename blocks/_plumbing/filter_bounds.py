"""Range proof of linear systems: output bounds for arbitrary inputs within an interval.

The bound is the 1-norm of the impulse response, split by sign: with P and N the sums of the positive and the negative
parts of h, an input in [low, high] (including 0, the initial state) gives an output in [P low - N high, P high - N
low], and both ends can be approached arbitrarily closely. Rounding is added to the bound: each rounding of the kernel
is a small disturbance of a state or an output, and the response to these disturbances is summed in the same way.
(Desoer and Vidyasagar, Feedback Systems, 1975, 2.4; Jackson, On the interaction of roundoff noise and dynamic range in
digital filters, 1970.)
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from msgspec import Struct

from cext.kernels.filter_bounds import impulse_sums
from graph.interval import EVERYTHING, Interval

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

EPSILON = 2.0**-52
TINY = 1e-290  # absorbs underflow
HUGE = 1e307  # above which an intermediate result may overflow
ZERO = Interval.point(0.0)


def with_zero(interval: Interval) -> Interval:
    """Return the union of the interval and 0, the initial state."""
    return interval | Interval.point(0.0)


def design_at(block: Any) -> Any:
    """Return the block's design(dt), or None if the rate is unknown or unsuitable.

    `prepare` reports an unsuitable rate.
    """
    try:
        return None if block.dt is None else block.design(block.dt)
    except ValueError:
        return None


class Reach(Struct, frozen=True):
    """Bounds of the effect of inputs on outputs.

    positive, negative : (p, m), sums of the two parts of each impulse response
    slack : (p, m), rounding error for inputs up to 1
    free : (p, 2), smallest and largest response to the initial state alone
    largest : m floats, bound of all intermediate results for inputs up to 1
    """

    positive: np.ndarray
    negative: np.ndarray
    slack: np.ndarray
    free: np.ndarray
    largest: tuple[float, ...]

    def interval(self, inputs: Sequence[Interval]) -> Interval | None:
        """Return the Interval of all outputs together. inputs : one Interval per input"""
        union, inputs = None, [with_zero(u) for u in inputs]
        if not sum(size * max(-u.low, u.high) for size, u in zip(self.largest, inputs)) < HUGE:
            return EVERYTHING
        underflow = TINY * any(u != ZERO for u in inputs)  # of products with inputs that are denormal numbers
        for row in range(len(self.positive)):
            low, high = self.free[row]
            for column, u in enumerate(inputs):
                p, n = self.positive[row, column], self.negative[row, column]
                slack = self.slack[row, column] * max(-u.low, u.high)
                low += p * u.low - n * u.high - slack
                high += p * u.high - n * u.low + slack
            rounding = 8.0 * EPSILON * max(-low, high) + underflow  # of the sums in this method
            one = Interval(float(low - rounding), float(high + rounding))
            union = one if union is None else union | one
        return union


def reach_of_state_space(
    a: ArrayLike, b: ArrayLike, c: ArrayLike, d: ArrayLike, start: ArrayLike | None = None
) -> Reach | None:
    """Return the Reach of x' = A x + B u, y = C x + D u from x = start, or None without a bound.

    Valid for any order of summation in the kernel.
    """
    A, B, C, D = (np.ascontiguousarray(matrix, dtype=float) for matrix in (a, b, c, d))
    n, m = B.shape
    start = np.zeros(n) if start is None else np.asarray(start, dtype=float)
    if not stable(A):
        return None
    sums = impulse_sums(A, np.column_stack([B, start]), C)
    if sums is None:
        return None
    positive, negative, highest, lowest, states, steps = sums
    pushed = (positive + negative)[:, :n]  # response to a disturbance of each state
    moved, moved_by_start = (
        states[:, n : n + m],
        states[:, -1:],
    )  # effect of each input, and of the start, on each state
    unit = (n + m + 2) * EPSILON
    slack = unit * (pushed @ (np.abs(A) @ moved + np.abs(B)) + np.abs(C) @ moved + np.abs(D))
    slack_of_start = unit * (pushed @ (np.abs(A) @ moved_by_start) + np.abs(C) @ moved_by_start)
    D_positive, D_negative = np.maximum(D, 0.0), np.maximum(-D, 0.0)
    total = positive[:, n : n + m] + negative[:, n : n + m] + np.abs(D)
    slack = 4.0 * slack + steps * EPSILON * total + TINY * (1.0 + pushed.sum())
    free = np.column_stack([lowest[:, -1:] - 4.0 * slack_of_start, highest[:, -1:] + 4.0 * slack_of_start])
    if np.any(slack > 1e-3 * total + TINY * 1e3 * (1.0 + pushed.sum())):
        return None
    largest = (np.abs(A) @ moved + np.abs(B)).sum(axis=0) + (np.abs(C) @ moved + np.abs(D)).sum(axis=0)
    return Reach(
        positive[:, n : n + m] + D_positive, negative[:, n : n + m] + D_negative, slack, free, tuple(largest.tolist())
    )


@lru_cache(maxsize=256)
def reach_of_cascade(sections: tuple[tuple[tuple[float, ...], tuple[float, ...]], ...]) -> Reach | None:
    """Return the Reach of sections in series, from zero or steady state, or None without a bound.

    Each section is (b, a) with a[0] = 1 in transposed direct form II.

    sections : tuple of pairs of equally long tuples, coefficients of z^0, z^-1, ...
    """
    count, n = len(sections), sum(len(b) - 1 for b, _ in sections)
    # Every signal is a row of weights of the states, the input, and the rounding error of each section's output.
    signals = np.eye(n + 1 + count)
    signal, first = signals[n], 0
    nexts: list[np.ndarray] = []
    results: list[np.ndarray] = []
    for index, (b, a) in enumerate(sections):
        order = len(b) - 1
        z = list(signals[first : first + order]) + [np.zeros_like(signal)]
        output = b[0] * signal + z[0] + signals[n + 1 + index]
        nexts += [b[i + 1] * signal - a[i + 1] * output + z[i + 1] for i in range(order)]
        signal, first = output, first + order
        results.append(output)
    outputs = np.array(results)
    A, E = (np.array(nexts)[:, :n], np.array(nexts)[:, n:]) if n else (np.zeros((0, 0)), np.zeros((0, 1 + count)))
    C, D = outputs[:, :n], outputs[:, n:]
    if not stable(A):
        return None
    bounds = impulse_sums(np.ascontiguousarray(A), np.ascontiguousarray(E), np.ascontiguousarray(C))
    if bounds is None:
        return None
    positive, negative, _, _, states, steps = bounds
    positive[:, n:] += np.maximum(D, 0.0)
    negative[:, n:] += np.maximum(-D, 0.0)
    sums = positive + negative
    reached = sums[:, n]  # output of each section, for inputs up to 1
    state, pushed = states[:, n], sums[-1]  # each state, and the output for a disturbance of each signal
    slack, largest, first = 0.0, 0.0, 0
    for index, (b, a) in enumerate(sections):
        order = len(b) - 1
        x, y = (1.0 if index == 0 else reached[index - 1]), reached[index]
        z = np.append(state[first : first + order], 0.0)
        slack += pushed[n + 1 + index] * (abs(b[0]) * x + y)
        slack += sum(pushed[first + i] * 2.0 * (abs(b[i + 1]) * x + abs(a[i + 1]) * y + z[i + 1]) for i in range(order))
        largest = max(
            largest, abs(b[0]) * x + y, *(abs(b[i + 1]) * x + abs(a[i + 1]) * y + z[i + 1] for i in range(order))
        )
        first += order
    # A steady-state start has a few rounding errors, and each section propagates its error.
    slack = 8.0 * (count + 1) * EPSILON * slack + steps * EPSILON * reached[-1] + TINY * (1.0 + pushed.sum())
    if slack > 1e-3 * reached[-1] + TINY * 1e3 * (1.0 + pushed.sum()):
        return None
    return Reach(
        positive[-1:, n : n + 1],
        negative[-1:, n : n + 1],
        np.array([[slack]]),
        np.zeros((1, 2)),
        (2.0 * float(largest),),
    )


def stable(A: np.ndarray) -> bool:
    """Return whether every eigenvalue is inside the unit circle by a margin that allows summation."""
    return A.size == 0 or float(np.max(np.abs(np.linalg.eigvals(A)))) < 1.0 - 1e-9
