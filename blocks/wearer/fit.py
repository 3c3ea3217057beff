"""Fit the walking adult to a recording: `python -m blocks.wearer.fit WALK.csv PERSON.json`.

The recording is one that the Walker plays. The adult has the median stride of both legs, as the difference from the
average adult at the same walking speed, in 12 harmonics; `Walker(person="PERSON.json")` walks so at every speed.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from blocks.wearer.adults import JOINTS, adult
from blocks.wearer.mechanics import Real
from blocks.wearer.norms import COMPONENTS
from blocks.wearer.recording import PHASES as PHASE_COLUMNS
from blocks.wearer.recording import samples
from blocks.wearer.stride import PHASES, series, values
from blocks.wearer.tables import entry_of

NUMBERS = 33  # of a sample
LEAST_STRIDES = 5  # of each leg
SPEED_STEPS = 8


def strides(file: str) -> tuple[float, list[Real]]:
    """Return (stride time in s, angles of each leg in rad, of shape (strides, 3, len(PHASES))). ValueError, OSError"""
    numbers = samples(file, 70.0, 1.70)
    rows, dt = numbers[1:].reshape(-1, NUMBERS), 1.0 / numbers[0]
    legs: list[Real] = []
    times: list[float] = []
    every = np.arange(len(rows))
    for leg in range(2):
        phase: Real = rows[:, PHASE_COLUMNS][:, leg]
        begins: list[int] = (np.flatnonzero(np.diff(np.floor(phase)) > 0) + 1).tolist()
        whole = [(a, b) for a, b in zip(begins, begins[1:]) if 0.5 <= (b - a) * dt <= 2.5]
        if len(whole) < LEAST_STRIDES:
            raise ValueError(f"{file}: at least {LEAST_STRIDES} strides of each leg are required, got {len(whole)}")
        times += [(b - a) * dt for a, b in whole]
        angles: list[list[Real]] = []
        for a, b in whole:
            ticks = np.interp(math.floor(float(phase[a])) + PHASES, phase[a - 1 : b + 1], every[a - 1 : b + 1])
            angles.append([np.interp(ticks, every, rows[:, 6 * leg + 2 * joint]) for joint in range(3)])
        legs.append(np.array(angles))
    return float(np.median(times)), legs


def fit(file: str) -> tuple[dict[str, list[float]], list[str]]:
    """Return (series of the difference of each angle from the average adult in rad, lines on what does not fit)."""
    stride_time, legs = strides(file)
    medians = np.array([np.median(leg, axis=0) for leg in legs])
    curves, usual_time = medians.mean(axis=0), stride_time
    for _ in range(SPEED_STEPS):  # to the speed at which legs with these angles take strides of that time
        usual_time *= math.sqrt(stride_time / walking(curves, usual_time)[0]["stride_time"])  # a full step oscillates
    made, apart, zero = walking(curves, usual_time)
    return dict(zip(JOINTS, (each.tolist() for each in apart))), list(
        report(stride_time, legs, medians, [values(each) for each in made["angles"]], float(made["speed"]), zero)
    )


def walking(curves: Real, usual_time: float) -> tuple[dict[str, Any], list[Real], float]:
    """Return the adult with angles, series of the difference from the average adult in rad, and zero of the ankle.

    curves : rad, of shape (3, len(PHASES)); usual_time : s, stride time of the average adult at that speed
    """
    entry = entry_of(usual_time)
    apart = [series(curve - values(usual)) for curve, usual in zip(curves, entry["angles"])]
    zero, apart[2][0] = apart[2][0], 0.0
    return adult(entry, np.zeros(len(COMPONENTS[0])), apart), apart, float(zero)


def report(
    stride_time: float, legs: list[Real], medians: Real, fitted: list[Real], speed: float, zero: float
) -> Iterator[str]:
    """Yield the lines on a fit: peaks of the median strides of both legs beside those of the fitted adult."""
    yield f"{len(legs[0])} left and {len(legs[1])} right strides of {stride_time:.2f} s, at {speed:.2f} m/s"
    for joint, curve in enumerate(fitted):
        recorded = np.mean([figures(leg[joint], stride_time) for leg in medians], axis=0)
        ratios = figures(curve, stride_time) / recorded - 1.0
        texts = [
            f"{value:.3g} {unit} ({ratio:+.0%})"
            for value, unit, ratio in zip(recorded, ("°", "rad/s", "rad/s²"), ratios)
        ]
        yield f"  {JOINTS[joint]:<6} range, peak velocity and acceleration, and those of the fit: {', '.join(texts)}"
    yield "not fitted:"
    between = np.degrees(np.sqrt(np.mean((medians[0] - medians[1]) ** 2, axis=1)))
    yield "  difference of left and right (RMS): " + ", ".join(f"{j} {d:.1f}°" for j, d in zip(JOINTS, between))
    within = np.degrees([leg.std(axis=0).mean(axis=1) for leg in legs]).mean(axis=0)
    yield "  variation of the strides (SD): " + ", ".join(f"{j} {d:.1f}°" for j, d in zip(JOINTS, within))
    yield f"  zero of the ankle angle, {np.degrees(zero):+.0f}° from that of the average adult"
    yield "  ground forces and torques: those of the average adult, and what the angles change of them"


def figures(curve: Real, stride_time: float) -> Real:
    """Return range in degrees, peak velocity and peak acceleration of the 12 harmonics of a curve at PHASES."""
    waves = np.fft.rfft(curve)
    waves[13:] = 0.0
    rates = 2j * np.pi * np.arange(len(waves)) / stride_time
    curves = [np.fft.irfft(waves * rates**order) for order in range(3)]
    return np.array([np.degrees(np.ptp(curves[0])), np.abs(curves[1]).max(), np.abs(curves[2]).max()])


def main(arguments: list[str]) -> int:
    """Fit an adult as on the command line. Returns the exit code."""
    if len(arguments) != 2 or not arguments[1].endswith(".json"):
        print("usage: python -m blocks.wearer.fit WALK.csv PERSON.json", file=sys.stderr)
        return 2
    try:
        angles, lines = fit(arguments[0])
        Path(arguments[1]).write_text(json.dumps({"recording": arguments[0], "angles": angles}), encoding="utf-8")
    except (OSError, ValueError) as error:
        print(f"tickwork: {error}", file=sys.stderr)
        return 2
    print("\n".join([*lines, f"{arguments[1]}: use it as Walker(person={arguments[1]!r})"]))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
