"""Recorded walking as the motion of a walking adult.

Everything that the file has is played: joint angles, pitch of the pelvis, ground forces and joint torques. The rest
follows from the angles: strides, the path of the hips over the loaded feet, and the torques by inverse dynamics.
"""

from __future__ import annotations

import os
from functools import lru_cache

import numpy as np
from msgspec import Struct
from msgspec.structs import asdict, replace

from blocks._plumbing.csv_columns import Table, read_table
from blocks.wearer.body import GRAVITY, SHANK_LENGTH, THIGH_LENGTH
from blocks.wearer.mechanics import Complex, Real, inverse_dynamics, pitches_of, support
from blocks.wearer.norms import BODY_HEIGHT
from blocks.wearer.periodic import closed, end_of, integral, moving_average, smooth
from blocks.wearer.stride import at_phases, ground
from blocks.wearer.stride import moments as moments_of
from blocks.wearer.tables import STANDING_CENTRE, entry_of

# Columns by joint, left with `lt` and `l`, right with `rt` and `r`: of CSV files in degrees, and of OpenSim.
ANGLES = (
    ("hip_flexion_{0}t_deg", "hip_flexion_{0}"),
    ("knee_flexion_{0}t_deg", "knee_angle_{0}"),
    ("ankle_dorsiflexion_{0}t_deg", "ankle_angle_{0}"),
)
CONTACT = ("contact_{0}t", "contact_{0}")
PELVIS = ("pelvis_tilt_deg", "pelvis_tilt")
THIGH = ("thigh_pitch_{0}t_deg",)
MOMENTS = ("hip_extensor_moment_{0}t_Nm_kg", "knee_extensor_moment_{0}t_Nm_kg", "ankle_plantarflexor_moment_{0}t_Nm_kg")
FORCES = ("grf_vertical_{0}t", "grf_forward_{0}t")  # with the unit: _bw, _N_kg or _N
CUTOFF = 15.0  # Hz, above which the angles have no more than noise
PELVIS_CUTOFF = 6.0  # Hz
RATE_LIMIT = 200.0  # Hz of the samples: twice what the angles need
SEAM = 0.3  # s, over which the end passes into the beginning
STRIDES = 0.5, 2.5  # s, shortest and longest stride
REACH = 0.1  # body heights, least distance of the ankle in front of the other at a strike, or of the hip
LANDING = 0.15  # s, longest time from the furthest reach to the fastest rotation of the foot to the ground
LEAST_SWING = 0.15  # s without contact before a strike
STANCE_LOAD = 0.05  # body weights, from which a recorded force is a contact
TORQUE_SHARE = 0.25  # of the difference by inverse dynamics: errors of the angles make most of the rest
LEAST_LOAD = 1e-3  # body weights, that keeps the path of the hips defined while neither foot is loaded
PHASES = slice(18, 20)  # of a sample


class Leg(Struct, frozen=True):
    """Recorded curves of a leg, over time in the first axis."""

    angles: Real  # of hip, knee and ankle, rad
    moments: Real | None  # in the direction of flexion, N·m/kg
    vertical: Real | None  # force of the ground, body weights
    forward: Real | None
    contact: Real | None  # 1 where the foot is on the ground
    thigh: Real | None  # pitch, rad


class Strides(Struct, frozen=True):
    """Strides of a leg."""

    phase: Real  # unwrapped, in strides
    walking: Real  # 1 within strides and 0 outside
    durations: list[float]  # s


def samples(file: str, mass: float, height: float) -> Real:
    """Return the rate in Hz and the samples of a file in the order of the kernel.

    file : CSV with the columns above, or OpenSim's .mot; mass, height : body mass in kg, height in m. ValueError or
    OSError if the file cannot be used.
    """
    state = os.stat(file)
    return _samples(file, mass, height, (os.path.abspath(file), state.st_mtime_ns, state.st_size)).copy()


@lru_cache(maxsize=4)  # it takes as long as the simulation of ten seconds
def _samples(file: str, mass: float, height: float, state: tuple[str, int, int]) -> Real:
    table = read_table(file)
    times = table.times()
    recorded = [side for side in "lr" if any(name.format(side) in table.names for name in ANGLES[0])] or ["l"]
    legs = [leg_of(table, side, mass) for side in recorded]
    pitch = pelvis_pitch(table, legs)
    check_times(file, times)
    dt = float(times[-1] - times[0]) / (len(times) - 1)

    # 1. A motion that repeats, and the strides of both legs.
    seam = max(2, round(SEAM / dt))
    every = max(1, round(1.0 / (dt * RATE_LIMIT)))  # samples that are kept
    cut = end_of(np.column_stack([leg.angles for leg in legs]), seam) // every * every
    legs = [closed_leg(leg, cut, seam, dt) for leg in legs]
    strides = [strides_of(strikes_of(leg, other, dt), cut, dt) for leg, other in zip(legs, legs[::-1])]
    if len(legs) == 1:
        shifted = half_a_stride_later(legs[0], strides[0])
        legs, strides = [legs[0], shifted[0]], [strides[0], shifted[1]]
        if recorded == ["r"]:
            legs, strides = legs[::-1], strides[::-1]
    walk = moving_average(np.minimum(strides[0].walking, strides[1].walking), round(0.3 / dt))
    durations = [duration for each in strides for duration in each.durations]
    stride_time = float(np.median(durations)) if durations else 0.0
    # 2. Ground.
    forces, centres = zip(*(ground_of(leg, each, walk, stride_time) for leg, each in zip(legs, strides)))
    # 3. Pelvis: pitch, and path over the loaded feet.
    pitch = flat_feet(legs, strides, walk) if pitch is None else closed(pitch, cut, seam)
    pitch, pitch_rate = smooth(pitch, dt, CUTOFF)
    pitches = [pitches_of(pitch, list(leg.angles.T)) for leg in legs]
    velocity, level = support(pitches, [force.imag + LEAST_LOAD for force in forces], dt)
    speed, speed_rate = smooth(velocity.real, dt, PELVIS_CUTOFF)
    level, level_rate = smooth(level, dt, PELVIS_CUTOFF)
    hips = integral(speed, dt) + 1j * level
    # 4. Torques, and the samples.
    torques = [
        np.column_stack(inverse_dynamics(hips, each, centre, force, height=height, dt=dt, cutoff=CUTOFF))
        for each, centre, force in zip(pitches, centres, forces)
    ]
    moments = [
        average_moments(each, stride_time, walk, torque) if leg.moments is None else leg.moments
        for leg, each, torque in zip(legs, strides, torques)
    ]
    angles = [curve for leg in legs for angle in leg.angles.T for curve in smooth(angle, dt, np.inf)]
    mean_speed = moving_average(speed, round((stride_time or 1.0) / dt))
    rows = np.column_stack(
        [
            *(*angles, pitch, pitch_rate, height * level, height * level_rate, height * speed, height * speed_rate),
            *(each.phase for each in strides),
            *moments,
            *(force.imag for force in forces),
            *(force.real for force in forces),
            *centres,
            height * walk * mean_speed,
        ]
    )
    again = rows[:1].copy()  # the first sample again, at the end
    again[:, PHASES] = [2.0 * each.phase[-1] - each.phase[-2] for each in strides]
    return np.concatenate([[1.0 / (dt * every)], rows[::every].ravel(), again.ravel()])


def check_times(file: str, times: Real) -> None:
    """Raise ValueError unless there are at least 50 samples at even times. times : s"""
    if len(times) < 50:
        raise ValueError(f"{file}: at least 50 samples are required, got {len(times)}")
    steps = np.diff(times)
    usual = float(np.median(steps))
    uneven = ~(np.abs(steps - usual) <= 0.5 * usual)
    if np.any(uneven):
        k = int(np.argmax(uneven))
        raise ValueError(
            f"{file}: the time step after {times[k]:g} s is {steps[k]:.3g} s, but the median step is {usual:.3g} s: "
            "fill the gaps, or keep only a part without one"
        )


def leg_of(table: Table, side: str, mass: float) -> Leg:
    """Return the columns of one leg in a file. ValueError"""

    def first(names: tuple[str, ...]) -> Real | None:
        available = [name for name in (each.format(side) for each in names) if name in table.names]
        return column(table, *available) if available else None

    angles = np.radians([column(table, *(name.format(side) for name in names)) for names in ANGLES]).T
    if angles[:, 1].mean() < 0.0:  # OpenSim's older models extend the knee in the positive direction
        angles[:, 1] *= -1.0
    torques = [curve for curve in (first((name,)) for name in MOMENTS) if curve is not None]
    scales = (("_bw", 1.0), ("_N_kg", 1.0 / GRAVITY), ("_N", 1.0 / (mass * GRAVITY)))
    vertical, forward = (
        next((scale * curve for unit, scale in scales if (curve := first((name + unit,))) is not None), None)
        for name in FORCES
    )
    contact, thigh = first(CONTACT), first(THIGH)
    return Leg(
        angles=angles,
        moments=-np.column_stack(torques) if len(torques) == 3 else None,
        vertical=None if vertical is None else np.maximum(vertical, 0.0),
        forward=forward,
        contact=None if contact is None else contact / max(contact.max(), 1e-9),
        thigh=None if thigh is None else np.radians(thigh),
    )


def column(table: Table, *names: str) -> Real:
    """Return the first of the columns without gaps. ValueError"""
    values = table.column(*names, empty=np.nan)
    missing = np.flatnonzero(~np.isfinite(values))
    if len(missing):
        name, line = table.names[table.index(*names)], table.rows[int(missing[0])][0]
        raise ValueError(
            f"{table.file}: column {name!r} has no value in {len(missing)} of {len(values)} rows, "
            f"first in line {line}: fill the gaps"
        )
    return values


def pelvis_pitch(table: Table, legs: list[Leg]) -> Real | None:
    """Return the pitch of the pelvis, if the file has it or that of the thighs, rad, positive with the front up."""
    for name in PELVIS:
        if name in table.names:
            return np.radians(column(table, name))
    pitches = [leg.thigh - leg.angles[:, 0] for leg in legs if leg.thigh is not None]
    return np.mean(pitches, axis=0) if pitches else None


def flat_feet(legs: list[Leg], strides: list[Strides], walk: Real) -> Real:
    """Return the pitch of the pelvis with which the foot is flat: in a walk in the mean of mid-stance, else always."""
    feet = [leg.angles[:, 0] - leg.angles[:, 1] + leg.angles[:, 2] for leg in legs]
    standing = -0.5 * (feet[0] + feet[1])
    flat = [(walk > 0.999) & (each.phase % 1.0 > 0.2) & (each.phase % 1.0 < 0.35) for each in strides]
    if not np.any(flat):
        return standing
    walking = -np.concatenate([foot[middle] for foot, middle in zip(feet, flat)]).mean()
    return standing + walk * (walking - standing)


def ground_of(leg: Leg, strides: Strides, walk: Real, stride_time: float) -> tuple[Complex, Real]:
    """Return (force forward + i up in body weights, centre of pressure in foot lengths from the heel) under a foot.

    Missing forces are those of the average adult with the same stride time and phase; in a stand both
    feet bear the weight. The centre follows from the phase.
    """
    force, centre = ground(entry_of(stride_time), strides.phase % 1.0)
    vertical = 0.5 + walk * (force.imag - 0.5) if leg.vertical is None else leg.vertical
    forward = walk * force.real if leg.forward is None else leg.forward
    return forward + 1j * vertical, STANDING_CENTRE + walk * (centre - STANDING_CENTRE)


def average_moments(strides: Strides, stride_time: float, walk: Real, torques: Real) -> Real:
    """Return the moments of the average adult at the same phase and stride time, changed as the motion differs.

    torques : by inverse dynamics, of which a part of the difference from the average counts; outside a walk they are
    the moments.
    """
    entry = entry_of(stride_time)
    usual = zip(entry["moments"], moments_of(entry, BODY_HEIGHT))
    curves = [at_phases(mean - TORQUE_SHARE * dynamic, strides.phase) for mean, dynamic in usual]
    return torques + walk[:, None] * (np.column_stack(curves) - (1.0 - TORQUE_SHARE) * torques)


def closed_leg(leg: Leg, cut: int, seam: int, dt: float) -> Leg:
    """Return a leg whose motion repeats, with smooth angles."""
    curves = {name: closed(curve, cut, seam) for name, curve in asdict(leg).items() if curve is not None}
    curves["angles"] = np.column_stack([smooth(curve, dt, CUTOFF)[0] for curve in curves["angles"].T])
    if leg.contact is not None:
        curves["contact"] = leg.contact[:cut]
    return replace(leg, **curves)


def strikes_of(leg: Leg, other: Leg, dt: float) -> np.ndarray:
    """Return the samples at which the foot strikes the ground: where a contact or a load begins, else of the motion."""
    if leg.contact is not None:
        on = leg.contact > 0.5
    elif leg.vertical is not None:
        on = leg.vertical > STANCE_LOAD
    else:
        return landings(leg.angles, None if other is leg else other.angles, dt)
    edges = np.diff(on.astype(int), prepend=int(on[-1]))  # the recording repeats
    rises, falls = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0)
    since = rises - np.append(falls[-1:] - len(on), falls)[np.searchsorted(falls, rises)]
    return rises[since * dt >= LEAST_SWING]


def landings(angles: Real, others: Real | None, dt: float) -> np.ndarray:
    """Return the samples at which a foot strikes the ground, from the angles of the leg and of the other leg.

    Half way from the furthest reach of the ankle in front of the hip (after Zeni et al. 2008, Gait & Posture
    27:710-714) to the fastest rotation of the sole to the ground. On the level the one leads a measured contact by
    24 to 60 ms, and the other follows it by 9 to 34 ms.
    """

    def reach(angles: Real) -> Real:
        return THIGH_LENGTH * np.sin(angles[:, 0]) + SHANK_LENGTH * np.sin(angles[:, 0] - angles[:, 1])

    ahead = reach(angles)
    apart = ahead if others is None else ahead - reach(others)
    foot = angles[:, 0] - angles[:, 1] + angles[:, 2]
    window = round(0.5 * STRIDES[0] / dt)
    around = np.lib.stride_tricks.sliding_window_view(np.pad(ahead, window, mode="wrap"), 2 * window + 1)
    rotation = np.pad(smooth(foot, dt, CUTOFF)[1], (0, round(LANDING / dt)), mode="wrap")
    reaches = np.flatnonzero((ahead == around.max(axis=1)) & (apart > REACH))
    return np.array([k + 0.5 * np.argmin(rotation[k : k + round(LANDING / dt)]) for k in reaches])


def strides_of(strikes: np.ndarray, count: int, dt: float) -> Strides:
    """Return the strides between strikes, given in samples, of a recording of `count` samples that repeats.

    Where the last strike and the first one of the repetition are not a stride apart, a usual stride ends and begins
    there.
    """
    phase, walking = np.zeros(count), np.zeros(count)
    if len(strikes) == 0:
        return Strides(phase, walking, [])
    knots = np.concatenate([strikes, strikes[:1] + count])
    durations = np.diff(knots) * dt
    good = (durations >= STRIDES[0]) & (durations <= STRIDES[1])
    if not np.any(good):
        return Strides(phase, walking, [])
    if good[-1]:
        knots = np.concatenate([strikes[-1:] - count, knots])
    else:
        usual = float(np.median(durations[good])) / dt
        knots = np.concatenate([strikes[:1] - usual, strikes, strikes[-1:] + usual])
    for begin, end in zip(knots[:-1], knots[1:]):
        if STRIDES[0] <= (end - begin) * dt <= STRIDES[1]:
            walking[max(0, round(begin)) : max(0, round(end))] = 1.0
    return Strides(np.interp(np.arange(count), knots, np.arange(len(knots))), walking, list(durations[good]))


def half_a_stride_later(leg: Leg, strides: Strides) -> tuple[Leg, Strides]:
    """Return the other leg of a recording that has one: the same half a stride later."""
    phase, count = strides.phase, len(strides.phase)
    start, end = float(phase[0]), float(phase[-1])
    if start == end:
        return leg, strides
    later = start + (phase + 0.5 - start) % (end - start)
    at = np.interp(later, phase, np.arange(count))
    whole = np.minimum(at.astype(int), count - 2)

    def moved(curve: np.ndarray) -> np.ndarray:
        part = (at - whole).reshape(count, *[1] * (curve.ndim - 1))
        return (1.0 - part) * curve[whole] + part * curve[whole + 1]

    changes = {name: moved(curve) for name, curve in asdict(leg).items() if curve is not None}
    return replace(leg, **changes), replace(strides, phase=phase + 0.5)
