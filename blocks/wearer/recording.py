"""Recorded walking as the motion of a walking adult."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from textwrap import shorten

import numpy as np

from blocks.wearer.body import SHANK_LENGTH, THIGH_LENGTH

# Columns by joint, left with `lt` and `l`, right with `rt` and `r`: of CSV files in degrees, and of OpenSim.
COLUMNS = {
    "hip": ("hip_flexion_{0}t_deg", "hip_flexion_{0}"),
    "knee": ("knee_flexion_{0}t_deg", "knee_angle_{0}"),
    "ankle": ("ankle_dorsiflexion_{0}t_deg", "ankle_angle_{0}"),
}
CONTACTS = ("contact_{0}t", "contact_{0}")
CUTOFF = 15.0  # Hz, above which the angles have no more than noise
SEAM = 0.3  # s, over which the end passes into the beginning
STRIDES = 0.5, 2.5  # s, shortest and longest stride


def samples(file: str) -> tuple[np.ndarray, float]:
    """Return (samples in the order of the kernel, median stride time in s, 0 without strides) of a file.

    file : CSV with the columns of COLUMNS, or OpenSim's .mot. ValueError or OSError if the file cannot be used.
    """
    names, table = read(file)
    times = table[:, find(("time",), names, file)]
    steps = np.diff(times)
    columns = [find([c.format(side) for c in each], names, file) for side in "lr" for each in COLUMNS.values()]
    if len(times) < 50 or np.any(steps <= 0.0) or np.any(np.abs(steps - np.median(steps)) > 0.5 * np.median(steps)):
        raise ValueError(f"{file}: at least 50 samples at even times are required")
    dt = (times[-1] - times[0]) / (len(times) - 1)
    angles = np.radians(table[:, columns])
    for knee in (1, 4):  # OpenSim's older models extend the knee in the positive direction
        if angles[:, knee].mean() < 0.0:
            angles[:, knee] *= -1.0
    angles, velocities = smooth(closed(angles, max(2, round(SEAM / dt))), dt)
    count = len(angles)
    phases, walking, times_of_strides = [], [], []
    reaches = [ahead(angles[:, 3 * leg : 3 * leg + 3]) for leg in (0, 1)]
    for leg, side in enumerate("lr"):
        contact = [names.index(c.format(side)) for c in CONTACTS if c.format(side) in names]
        apart = reaches[leg] - reaches[1 - leg]
        strikes = struck(table[:count, contact[0]]) if contact else furthest(apart, dt)
        phase, walks, durations = of_strikes(strikes, count, dt)
        phases.append(phase)
        walking.append(walks)
        times_of_strides.extend(durations)
    blur = np.ones(max(1, round(0.3 / dt))) / max(1, round(0.3 / dt))
    stride = np.convolve(np.pad(np.minimum(*walking), len(blur), mode="edge"), blur, mode="same")[
        len(blur) : -len(blur)
    ]
    pairs = np.stack([angles, velocities], axis=2).reshape(count, 12)
    rows = np.column_stack([pairs, *phases, stride])
    return np.concatenate([[1.0 / dt], rows.ravel()]), float(np.median(times_of_strides)) if times_of_strides else 0.0


def read(file: str) -> tuple[list[str], np.ndarray]:
    """Return (names of the columns, table of numbers) of a CSV file, or of a .mot file behind its header."""
    lines = Path(file).read_text(encoding="utf-8-sig").splitlines()
    ends = [number for number, line in enumerate(lines) if line.strip() == "endheader"]
    if any(re.fullmatch(r"\s*inDegrees\s*=\s*no\s*", line) for line in lines[: ends[0] if ends else 0]):
        raise ValueError(f"{file} is in radians: write it in degrees")
    lines = [line for line in lines[ends[0] + 1 if ends else 0 :] if line.strip()]
    split = re.compile(r"\s*[,;\t]\s*|\s+")
    names = split.split(lines[0].strip()) if lines else []
    try:
        table = np.array([[float(cell or "nan") for cell in split.split(line.strip())] for line in lines[1:]])
    except ValueError as error:
        raise ValueError(f"{file} contains text between numbers: {error}") from None
    if table.ndim != 2 or table.shape[1:] != (len(names),):
        raise ValueError(f"{file}: every row must have as many numbers as the header has names")
    return names, table


def find(candidates: Sequence[str], names: Sequence[str], file: str) -> int:
    """Return the index of the first candidate among the names. ValueError"""
    for candidate in candidates:
        if candidate in names:
            return names.index(candidate)
    available = shorten(", ".join(names), 200, placeholder=" ...") or "none"
    raise ValueError(f"{file} has no column {' or '.join(map(repr, candidates))}; it has {available}")


def closed(angles: np.ndarray, seam: int) -> np.ndarray:
    """Return the angles cut where they best continue with their beginning, and faded into it over `seam` samples."""
    if not np.all(np.isfinite(angles)):
        raise ValueError("the recording has missing angles")
    last = len(angles) - seam
    first = max(last // 2, last - 4 * 2 * seam)
    misfit = [np.sum((angles[k : k + seam] - angles[:seam]) ** 2) for k in range(first, last + 1)]
    cut = first + int(np.argmin(misfit))
    x = (np.arange(seam) / seam)[:, None]
    fade = x**3 * (10.0 - 15.0 * x + 6.0 * x**2)
    start = (1.0 - fade) * angles[cut : cut + seam] + fade * angles[:seam]
    return np.concatenate([start, angles[seam:cut]])


def smooth(angles: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (angles, velocities) below CUTOFF of a repeated recording, its first sample again at the end."""
    frequencies = np.fft.rfftfreq(len(angles), dt)
    gain = 1.0 / (1.0 + (frequencies / CUTOFF) ** 8)
    waves = np.fft.rfft(angles, axis=0) * gain[:, None]
    turn = 2j * np.pi * frequencies
    found = [np.fft.irfft(each, len(angles), axis=0) for each in (waves, waves * turn[:, None])]
    return np.concatenate([found[0], found[0][:1]]), np.concatenate([found[1], found[1][:1]])


def ahead(angles: np.ndarray) -> np.ndarray:
    """Return how far the ankle is in front of the hip, in body heights."""
    return THIGH_LENGTH * np.sin(angles[:, 0]) + SHANK_LENGTH * np.sin(angles[:, 0] - angles[:, 1])


def furthest(apart: np.ndarray, dt: float) -> np.ndarray:
    """Return the samples at which the foot is furthest in front of the other, and far. apart : body heights

    (Zeni et al. 2008, Gait & Posture 27:710-714)
    """
    window = round(0.5 * STRIDES[0] / dt)
    padded = np.pad(apart, window, mode="wrap")
    highest = np.lib.stride_tricks.sliding_window_view(padded, 2 * window + 1).max(axis=1)
    return np.flatnonzero((apart == highest) & (apart > 0.1))


def struck(contact: np.ndarray) -> np.ndarray:
    """Return the samples at which a contact begins."""
    on = contact > 0.5 * contact.max()
    return np.flatnonzero(~on[:-1] & on[1:]) + 1


def of_strikes(strikes: np.ndarray, count: int, dt: float) -> tuple[np.ndarray, np.ndarray, list[float]]:
    """Return (phase in strides, 1 within strides and 0 outside, durations in s) of a leg from its strikes."""
    phase, walking = np.zeros(count), np.zeros(count)
    durations = np.diff(strikes) * dt
    good = (durations >= STRIDES[0]) & (durations <= STRIDES[1])
    if not np.any(good):
        return phase, walking, []
    usual = float(np.median(durations[good])) / dt
    knots = np.concatenate([[strikes[0] - usual], strikes, [strikes[-1] + usual]])
    phase = np.interp(np.arange(count), knots, np.arange(len(knots)))
    for begin, end, walks in zip(strikes, strikes[1:], good):
        walking[begin:end] = walks
    walking[max(0, round(strikes[0] - usual)) : strikes[0]] = 1.0
    walking[strikes[-1] : round(strikes[-1] + usual)] = 1.0
    return phase, walking, list(durations[good])
