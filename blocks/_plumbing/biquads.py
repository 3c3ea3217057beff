"""Biquad cascades and closed-form filter designs.

A biquad is (b0, b1, b2, a1, a2) of H(z) = (b0 + b1/z + b2/z²) / (1 + a1/z + a2/z²). The bilinear transform with
prewarping preserves the design frequencies; 1/K is its factor between s and (z - 1)/(z + 1). (Oppenheim and Schafer,
Discrete-Time Signal Processing, 7.1; Orfanidis, Introduction to Signal Processing, 11.)
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from blocks._plumbing.filter_bounds import design_at, reach_of_cascade
from cext.kernels import linear as kernels
from graph import Block, Input, Memory, Output
from graph.interval import EVERYTHING

if TYPE_CHECKING:
    from blocks._plumbing.filter_bounds import Reach
    from graph.interval import Interval


class Biquads(Block):
    """Base of filters that are biquad cascades. Subclasses define `design(dt)`, which returns the biquads."""

    u = Input("any", "raw signal", shape=...)
    y = Output("any", "filtered signal", shape=...)
    sections = Memory(0.0, "coefficients b0 b1 b2 a1 a2 of each biquad")
    delays = Memory(0.0, "two delays per biquad and element")
    rest = Memory(0.0, "gain and two delays of each biquad in steady state for an input of 1")
    design: Callable[[float], Any]

    abstract = True
    smooth = ("u",)
    kernel = kernels.biquads
    settle_kernel = kernels.biquads_at_rest

    def prepare(self, dt: float) -> None:
        sections = self.design(dt)
        self.sections = [coefficient for section in sections for coefficient in section]
        self.delays = [0.0] * (2 * len(sections) * self.width)
        self.rest = at_rest(sections)

    def output_range(self, u: Interval) -> Interval | None:
        sections = design_at(self)
        bounds = None if sections is None else reach(sections)
        return EVERYTHING if bounds is None else bounds.interval([u])


def butterworth(order: int, cutoff: Any, btype: str, dt: Any) -> list[tuple[float, ...]]:
    """Return a Butterworth filter with one biquad per pair of poles.

    cutoff : Hz, a pair for band filters; btype : as in scipy.signal.butter; dt : s
    """
    if btype == "lowpass":
        return [lowpass(damping, math.tan(math.pi * cutoff * dt)) for damping in dampings(order)]
    if btype == "highpass":
        return [highpass(damping, math.tan(math.pi * cutoff * dt)) for damping in dampings(order)]
    low, high = (math.tan(math.pi * edge * dt) for edge in cutoff)
    return [
        section
        for pole in prototype_poles(order)
        for section in band(pole, high - low, low * high, btype == "bandpass")
    ]


def dampings(order: int) -> list[float]:
    """Return 1/Q of each pair of poles, infinite for the single pole of an odd order."""
    pairs = [2.0 * math.sin(math.pi * (2 * pair + 1) / (2 * order)) for pair in range(order // 2)]
    return pairs + [math.inf] * (order % 2)


def lowpass(damping: float, K: float) -> tuple[float, ...]:
    """Discretise 1 / (s² + damping s + 1), or 1 / (s + 1) for an infinite damping."""
    if damping == math.inf:
        gain = K / (1.0 + K)
        return gain, gain, 0.0, (K - 1.0) / (1.0 + K), 0.0
    norm = 1.0 / (1.0 + damping * K + K * K)
    gain = K * K * norm
    return gain, 2.0 * gain, gain, 2.0 * (K * K - 1.0) * norm, (1.0 - damping * K + K * K) * norm


def highpass(damping: float, K: float) -> tuple[float, ...]:
    """Discretise s² / (s² + damping s + 1), or s / (s + 1) for an infinite damping."""
    if damping == math.inf:
        gain = 1.0 / (1.0 + K)
        return gain, -gain, 0.0, (K - 1.0) / (1.0 + K), 0.0
    norm = 1.0 / (1.0 + damping * K + K * K)
    return norm, -2.0 * norm, norm, 2.0 * (K * K - 1.0) * norm, (1.0 - damping * K + K * K) * norm


def prototype_poles(order: int) -> list[complex]:
    """Return the poles of the 1 rad/s analogue low-pass in the upper half plane, the real one last."""
    poles = [cmath.exp(1j * math.pi * (0.5 + (2 * pair + 1) / (2 * order))) for pair in range(order // 2)]
    return poles + [-1.0 + 0.0j] * (order % 2)


def band(pole: complex, width: float, square: float, passes: bool) -> list[tuple[float, ...]]:
    """Return the biquads of a prototype pole and its conjugate in a band filter: two, or one for a real pole.

    s becomes (s² + square) / (width s) for a band-pass and its reciprocal for a band-stop; square is the square of the
    prewarped centre frequency. Each has unit gain at the centre, or at 0 and the Nyquist frequency.
    """
    middle = 0.5 * width * (pole if passes else 1.0 / pole)  # half the sum of the two new poles
    root = cmath.sqrt(middle * middle - square)
    if pole.imag == 0.0:
        quadratics = [(-2.0 * middle.real, square)]  # s² + c1 s + c0, for real or complex roots
    else:
        larger = max(middle + root, middle - root, key=abs)  # the other from their product, without cancellation
        quadratics = [(-2.0 * s.real, abs(s) ** 2) for s in (larger, square / larger)]
    cosine = (1.0 - square) / (1.0 + square)  # of the digital centre frequency
    sections: list[tuple[float, ...]] = []
    for c1, c0 in quadratics:
        norm = 1.0 / (1.0 + c1 + c0)
        a1, a2 = 2.0 * (c0 - 1.0) * norm, (1.0 - c1 + c0) * norm
        if passes:
            turn = complex(cosine, -math.sqrt(1.0 - cosine * cosine))  # 1/z at the centre
            gain = abs((1.0 + a1 * turn + a2 * turn * turn) / (1.0 - turn * turn))
            sections.append((gain, 0.0, -gain, a1, a2))
        else:
            gain = (1.0 + a1 + a2) / (2.0 - 2.0 * cosine)
            sections.append((gain, -2.0 * cosine * gain, gain, a1, a2))
    return sections


def notch(frequency: float, q: float, dt: float) -> tuple[float, ...]:
    """Return the biquad of a notch with a -3 dB bandwidth of frequency / q, as scipy.signal.iirnotch.

    frequency : Hz; dt : s
    """
    w = 2.0 * math.pi * frequency * dt
    gain = 1.0 / (1.0 + math.tan(0.5 * w / q))
    return gain, -2.0 * gain * math.cos(w), gain, -2.0 * gain * math.cos(w), 2.0 * gain - 1.0


def reach(sections: Sequence[tuple[float, ...]]) -> Reach | None:
    """Return the Reach (blocks._plumbing.filter_bounds) of a cascade of biquads, or None if it has no bound."""
    return reach_of_cascade(tuple(((b0, b1, b2), (1.0, a1, a2)) for b0, b1, b2, a1, a2 in sections))


def at_rest(sections: Sequence[tuple[float, ...]]) -> list[float]:
    """Return for each biquad the gain at frequency 0 and its two steady-state delays for an input of 1.

    The sums are exact before one rounding, because 1 + a1 + a2 nearly cancels. Zeros for an integrator, which has no
    such state, including systems that differ from an integrator by rounding only.
    """
    steady: list[float] = []
    for b0, b1, b2, a1, a2 in sections:
        below = math.fsum((1.0, a1, a2))
        if abs(below) <= 1e-14 * (1.0 + abs(a1) + abs(a2)):
            steady += [0.0, 0.0, 0.0]
            continue
        gain = math.fsum((b0, b1, b2)) / below
        steady += [gain, (b1 + b2) - gain * (a1 + a2), b2 - gain * a2]
    return steady
