"""Adults who differ from the average, alike in every stride and at every walking speed."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any, TypeGuard

import numpy as np

from blocks.wearer.mechanics import Real, pitches_of, support
from blocks.wearer.norms import BODY_HEIGHT, COMPONENTS
from blocks.wearer.stride import (
    FORCE_SINES,
    HARMONICS,
    PHASES,
    balanced,
    centre_basis,
    flat_foot_pitch,
    ground,
    moments,
    other,
    pelvis,
    series,
    sines,
    values,
)
from cext.user_files import read_small

# Shares of the variance between adults: constant over the stride, and harmonics 1 to 3. As the mean of the curves of
# four adults about the average, see docs/explanation/wearer.md.
OFFSET_SHARE, HARMONIC_SHARES = 0.5, (0.3, 0.15, 0.05)
WEIGHTS = 1 + 2 * len(HARMONIC_SHARES)  # of a curve
CURVES = 6  # angles of hip, knee and ankle, vertical and forward force, centre of pressure
CENTRE_DEVIATION = 0.07  # foot lengths, so that torques of the ankle differ as between adults
STANCE = np.linspace(0.0, 1.0, 101)
STANCE_WAVES = sines(STANCE, FORCE_SINES)
DRAW_LIMIT, SCORE_LIMIT = 2.0, 5.0  # standard deviations, of drawn and of given scores
JOINTS = ("hip", "knee", "ankle")
KNEE_LIMIT = np.radians(-8.0)  # rad, largest extension of the knee while walking


def family(entries: Sequence[dict[str, Any]], person: Any) -> list[dict[str, Any]]:
    """Return the series of an adult at the speeds of the entries.

    person : scores of the first components in standard deviations, a seed that draws all of them, 0 for the average, or
    the path of a file of blocks.wearer.fit. A drawn adult whose knee would extend further than KNEE_LIMIT comes closer
    to the average. ValueError or OSError
    """
    if isinstance(person, str) and person.endswith(".json"):
        return [adult(entry, np.zeros(WEIGHTS * CURVES), read(person)) for entry in entries]
    scores = scores_of(person)
    if not np.any(scores):
        return list(entries)
    while True:
        adults = [adult(entry, scores @ COMPONENTS[: len(scores)]) for entry in entries]
        if not is_seed(person) or min(values(each["angles"][1]).min() for each in adults) > KNEE_LIMIT:
            return adults
        scores = 0.9 * scores


def read(file: str) -> list[Real]:
    """Return how the angles of a fitted adult differ from the average, as series in rad. ValueError or OSError"""
    try:
        deviations = [np.array(json.loads(read_small(file))["angles"][joint], float) for joint in JOINTS]
        if any(each.shape != (1 + 2 * HARMONICS,) or not np.all(np.isfinite(each)) for each in deviations):
            raise ValueError
    except (ValueError, KeyError, TypeError, RecursionError):
        raise ValueError(
            f"{file} is not a fitted adult: make one with python -m blocks.wearer.fit WALK.csv {file}"
        ) from None
    return deviations


def is_seed(person: object) -> TypeGuard[float]:
    """Return whether an adult is stated by a seed."""
    return isinstance(person, (int, float, np.integer))


def scores_of(person: Any) -> Real:
    """Return the scores of an adult. person : as in `family`. ValueError"""
    if is_seed(person):
        if not 0 <= person < 2**32 or person != int(person):
            raise ValueError(f"person must be a whole number from 0 to {2**32 - 1} or scores, got {person!r}")
        if not person:
            return np.zeros(0)
        random = np.random.RandomState(int(person))  # NumPy guarantees these numbers for all its versions
        return np.clip(random.normal(size=len(COMPONENTS)), -DRAW_LIMIT, DRAW_LIMIT)
    try:
        scores = np.array(person.split() if isinstance(person, str) else person, float)
    except (TypeError, ValueError):
        scores = np.full(1, np.nan)
    if scores.ndim != 1 or len(scores) > len(COMPONENTS) or not np.all(np.abs(scores) <= SCORE_LIMIT):
        allowed = f"at most {len(COMPONENTS)} scores from {-SCORE_LIMIT:g} to {SCORE_LIMIT:g}"
        raise ValueError(f"person must be a seed, or {allowed}, got {person!r}")
    return scores


def shape(phases: Real) -> Real:
    """Return curves of a unit variance over the stride in the columns of their weights."""
    turn = 2.0 * np.pi * np.outer(phases, np.arange(1, len(HARMONIC_SHARES) + 1))
    waves = np.stack([np.cos(turn), np.sin(turn)], axis=2) * np.sqrt(HARMONIC_SHARES)[:, None]
    return np.column_stack([np.full(len(phases), np.sqrt(OFFSET_SHARE)), waves.reshape(len(phases), -1)])


def spread(deviation: Real) -> Real:
    """Return curves with the standard deviation over the stride of an angle, in the columns of their weights.

    The first one is constant, so that an offset of the hip is one of the pelvis and does not move the leg.
    """
    waves = shape(PHASES)
    offset = min(np.sqrt(OFFSET_SHARE) * deviation.mean(), deviation.min())
    rest = np.sqrt(np.maximum(deviation**2 - offset**2, 0.0) / (1.0 - OFFSET_SHARE))
    return np.column_stack([np.full(len(PHASES), offset), rest[:, None] * waves[:, 1:]])


def reach(curves: list[Real], pitch: float, load: Real) -> float:
    """Return the length in body heights of a stride in which a loaded foot does not slip. curves : angles at PHASES"""
    pitches = pitches_of(pitch, curves)
    velocity, _ = support((pitches, [other(each) for each in pitches]), (load, other(load)), 1.0 / len(PHASES))
    return float(velocity.real.mean())


def fit(basis: Real, curve: Real) -> Real:
    """Return the least-squares weights of the columns of a basis for a curve."""
    return np.asarray(np.linalg.pinv(basis) @ curve, float)


def adult(entry: dict[str, Any], weights: Real, more: Sequence[Real] = ()) -> dict[str, Any]:
    """Return the series of an adult at the speed of an entry.

    weights : WEIGHTS of each of the CURVES; more : series in rad that are added to the angles

    The pelvis has the pitch with which the foot is flat in mid-stance; the strides are as long as the legs make them;
    the torques of the joints change by half of what inverse dynamics gives, as those of the average are half of it.
    """
    parts = np.split(weights, CURVES)
    average = [values(each) for each in entry["angles"]]
    deviations = [values(each) for each in entry["angle_deviations"]]
    curves = [curve + spread(sd) @ part for curve, sd, part in zip(average, deviations, parts)]
    curves = [curve + values(each) for curve, each in zip(curves, more)] if more else curves
    waves = shape(STANCE * entry["foot_off"])
    vertical, forward = (
        np.array(entry[name])
        + np.linalg.pinv(STANCE_WAVES) @ ((STANCE_WAVES @ entry[f"{name}_deviation"]) * (waves @ part))
        for name, part in zip(("vertical", "forward"), parts[3:5])
    )
    vertical, forward = balanced(vertical, forward, entry["foot_off"])
    pitch = flat_foot_pitch(curves)
    load = ground(entry, PHASES)[0].imag
    stride_time = entry["stride_time"] * reach(curves, pitch, load) / reach(average, entry["pelvis_pitch"], load)
    stride_length = entry["speed"] / BODY_HEIGHT * stride_time
    height, ahead, _ = pelvis(curves, pitch, load, stride_time, stride_length, stairs=False)
    person = entry | {
        "stride_time": stride_time,
        "pelvis_pitch": pitch,
        "angles": [series(each) for each in curves],
        "vertical": vertical,
        "forward": forward,
        "centre": np.array(entry["centre"])
        + np.linalg.pinv(centre_basis(STANCE)) @ (CENTRE_DEVIATION * waves @ parts[5]),
        "pelvis_height": height,
        "pelvis_forward": ahead,
    }
    changes = zip(entry["moments"], moments(person, BODY_HEIGHT), moments(entry, BODY_HEIGHT))
    return person | {"moments": [mean + 0.5 * (own - usual) for mean, own, usual in changes]}
