"""Series over a stride, and what follows from the motion of the legs: path of the hips, torques of the joints.

A series over the stride is (mean, cosine coefficients, sine coefficients). A series over the stance s, 0 to 1, has the
coefficients of sin(k π s), that of the centre of pressure 1 and s before them. Lengths are in body heights.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from blocks.wearer.mechanics import Complex, Real, inverse_dynamics, pitches_of, support

HARMONICS = 12  # of angles and moments
FORCE_SINES = 12
CENTRE_SINES = 6
PELVIS_HARMONICS = (2, 4, 6)  # of the stride: both legs move the pelvis alike
PHASES = np.arange(200) / 200


def values(series: Sequence[float] | Real) -> Real:
    """Return the values of a series at PHASES."""
    waves = np.zeros(len(PHASES) // 2 + 1, complex)
    waves[0] = series[0]
    waves[1 : len(series) // 2 + 1] = 0.5 * unpacked(series[1:])
    return np.fft.irfft(waves * len(PHASES))


def at_phases(series: Real, phases: Real) -> Real:
    """Return the values of a series at any phases."""
    turns = np.exp(2j * np.pi * np.outer(phases, np.arange(1, len(series) // 2 + 1)))
    return series[0] + (turns @ unpacked(series[1:])).real


def series(curve: Real, harmonics: int = HARMONICS) -> Real:
    """Return the series of a curve over the stride, of evenly spaced values without the last."""
    waves = np.fft.rfft(curve)[: harmonics + 1] / len(curve)
    return np.concatenate([waves[:1].real, packed(waves[1:])])


def sines(stance: Real, count: int) -> Real:
    """Return sin(k π s) of the stance in the columns k = 1 to `count`, and zero outside the stance."""
    inside = (stance >= 0.0) & (stance < 1.0)
    return np.where(inside[:, None], np.sin(np.pi * np.outer(stance, np.arange(1, count + 1))), 0.0)


def centre_basis(stance: Real) -> Real:
    """Return the functions of the centre of pressure in columns: 1, s, sin(k π s)."""
    waves = np.sin(np.pi * np.outer(stance, np.arange(1, CENTRE_SINES + 1)))
    return np.column_stack([np.ones_like(stance), stance, waves])


def ground(entry: dict[str, Any], phase: Real) -> tuple[Complex, Real]:
    """Return (force forward + i up in body weights, centre of pressure in foot lengths) of a foot at phases, 0 to 1."""
    stance = phase / entry["foot_off"]
    waves = sines(stance, FORCE_SINES)
    centre = np.clip(centre_basis(np.minimum(stance, 1.0)) @ entry["centre"], 0.02, 0.95)
    return waves @ entry["forward"] + 1j * np.maximum(waves @ entry["vertical"], 0.0), centre


def balanced(vertical: Real, forward: Real, foot_off: float) -> tuple[Real, Real]:
    """Return the series of a foot's force over the stance that bears half of the body weight and gains no speed."""
    area = np.array([2.0 / (np.pi * k) if k % 2 else 0.0 for k in range(1, FORCE_SINES + 1)])
    vertical = vertical * (0.5 / (foot_off * vertical @ area))
    return vertical, forward - (forward @ area) / (vertical @ area) * vertical


def flat_foot_pitch(angles: Sequence[Real]) -> float:
    """Return the pitch of the pelvis that makes the foot flat from 20 to 35 % of the stride. angles : at PHASES, rad"""
    return -float((angles[0] - angles[1] + angles[2])[40:70].mean())


def pelvis(
    angles: Sequence[Real], pitch: float, load: Real, stride_time: float, stride_length: float, stairs: bool
) -> tuple[Real, Real, float]:
    """Return (series of the hips' height, of their progress ahead of the mean speed, rise per stride).

    Both have the harmonics PELVIS_HARMONICS; the progress has no mean.

    angles : angles of either leg at PHASES; pitch : pitch of the pelvis; load : load on the foot
    stairs : whether each foot stands on a level of its own
    """
    pitches = pitches_of(pitch, angles)
    feet, loads = (pitches, [other(each) for each in pitches]), (load, other(load))
    velocity, height = support(feet, loads, stride_time / len(PHASES))
    k = np.array(PELVIS_HARMONICS)
    rates = np.fft.rfft(velocity.real)[k] / len(PHASES) * (stride_length / stride_time / velocity.real.mean())
    turn = 2j * np.pi * k / stride_time
    up = (np.fft.rfft(velocity.imag)[k] / turn if stairs else np.fft.rfft(height)[k]) / len(PHASES)
    rise = float(velocity.imag.mean()) * stride_time if stairs else 0.0
    return np.concatenate([[height.mean()], packed(up)]), packed(rates / turn), rise


def moments(entry: dict[str, Any], body_height: float) -> list[Real]:
    """Return the series of the torques of hip, knee and ankle in N·m/kg that move the legs as the entry states."""
    curves = [values(each) for each in entry["angles"]]
    force, centre = ground(entry, PHASES)
    k = np.array(PELVIS_HARMONICS)
    turns = np.exp(2j * np.pi * np.outer(PHASES, k))
    path = [(turns @ unpacked(each)).real for each in (entry["pelvis_forward"], entry["pelvis_height"][1:])]
    torques = inverse_dynamics(
        path[0] + 1j * path[1],
        pitches_of(entry["pelvis_pitch"], curves),
        centre,
        force,
        height=body_height,
        dt=entry["stride_time"] / len(PHASES),
        cutoff=2.0 * HARMONICS / entry["stride_time"],
    )
    return [series(each) for each in torques]


def packed(waves: Complex) -> Real:
    """Return the cosine and sine coefficients of complex Fourier coefficients."""
    return np.concatenate([2.0 * waves.real, -2.0 * waves.imag])


def unpacked(coefficients: Sequence[float] | Real) -> Complex:
    """Return twice the complex Fourier coefficients of cosine and sine coefficients."""
    cosines, sines = np.split(np.asarray(coefficients), 2)
    return cosines - 1j * sines


def other(curve: Real) -> Real:
    """Return the curve of the other leg, half a stride away."""
    return np.roll(curve, len(curve) // 2)
