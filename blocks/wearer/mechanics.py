"""Mechanics of legs with a known motion: the path of the hips, and the torques of the joints.

Lengths are in body heights. Positions, velocities and forces are complex, forward + i up. Curves are arrays of one
period of a motion that repeats, at evenly spaced times. Pitches are in rad, positive with the front up.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from blocks.wearer.body import (
    ANKLE_HEIGHT,
    BALL,
    FOOT,
    FOOT_LENGTH,
    GRAVITY,
    HEEL,
    SHANK,
    SHANK_LENGTH,
    THIGH,
    THIGH_LENGTH,
)

Real = np.ndarray[Any, np.dtype[np.float64]]
Complex = np.ndarray[Any, np.dtype[np.complex128]]


def pitches_of(pelvis: Real | float, angles: Sequence[Real]) -> tuple[Real, ...]:
    """Return the pitches of thigh, shank and foot. pelvis : its pitch; angles : those of hip, knee and ankle, rad"""
    hip, knee, ankle = angles
    return pelvis + hip, pelvis + hip - knee, pelvis + hip - knee + ankle


def sole(pitches: Sequence[Real]) -> tuple[Complex, Complex]:
    """Return the places of heel and ball from the hip. pitches : pitches of thigh, shank and foot"""
    thigh, shank, foot = (np.exp(1j * pitch) for pitch in pitches)
    ankle = -1j * (THIGH_LENGTH * thigh + SHANK_LENGTH * shank)
    return ankle + foot * (HEEL - 1j * ANKLE_HEIGHT), ankle + foot * (BALL - 1j * ANKLE_HEIGHT)


def support(legs: Sequence[Sequence[Real]], loads: Sequence[Real], dt: float) -> tuple[Complex, Real]:
    """Return (velocity, height) of the hips with which the lower point of a loaded foot neither slips nor lifts.

    Under load of both feet each counts by its share. legs : pitches of thigh, shank and foot of each leg; loads : force
    on each foot; dt : s. The velocity is in body heights per second, the height is over level ground.
    """
    velocity, height = np.zeros(len(loads[0]), complex), np.zeros(len(loads[0]))
    for pitches, load in zip(legs, loads):
        share = load / sum(loads)
        heel, ball = sole(pitches)
        on_heel = heel.imag < ball.imag
        velocity += share * np.where(on_heel, *((np.roll(p, 1) - np.roll(p, -1)) / (2.0 * dt) for p in (heel, ball)))
        height -= share * np.where(on_heel, heel.imag, ball.imag)
    return velocity, height


def inverse_dynamics(
    hips: Complex, pitches: Sequence[Real], centre: Real, force: Complex, *, height: float, dt: float, cutoff: float
) -> tuple[Real, Real, Real]:
    """Return the torques of hip, knee and ankle in N·m/kg, flexion positive, that move a leg as stated.

    hips : path of the hips; pitches : pitches of thigh, shank and foot
    centre : centre of pressure from the heel in foot lengths; force : force of the ground in body weights
    height : height of the body, m; dt : time step, s; cutoff : cut-off of the accelerations, Hz
    """
    frequency = np.fft.fftfreq(len(hips), dt)
    frequency[np.abs(frequency) > cutoff] = 0.0

    def second(curve: Real | Complex) -> Complex:
        return np.fft.ifft(np.fft.fft(curve) * (2j * np.pi * frequency) ** 2)

    down = [-1j * np.exp(1j * pitch) for pitch in pitches]  # direction of each segment, the foot's from ankle to sole
    joints = [hips, hips + THIGH_LENGTH * down[0], hips + THIGH_LENGTH * down[0] + SHANK_LENGTH * down[1]]
    lengths = THIGH_LENGTH, SHANK_LENGTH, FOOT_LENGTH
    places = [THIGH[1] * lengths[0], SHANK[1] * lengths[1], 1j * (FOOT[1] * FOOT_LENGTH + HEEL) + 0.5 * ANKLE_HEIGHT]
    pressed = joints[2] + down[2] * (1j * (centre * FOOT_LENGTH + HEEL) + ANKLE_HEIGHT)
    torques: list[Real] = []
    demands: list[tuple[Complex, Complex, Real]] = []
    for n in (2, 1, 0):
        share, _, gyration = (THIGH, SHANK, FOOT)[n]
        place = joints[n] + places[n] * down[n]
        inertia = share * (gyration * lengths[n] * height) ** 2
        demands.append((place, share * (height * second(place) + 1j * GRAVITY), inertia * second(pitches[n]).real))
        torque = sum(height * ((at - joints[n]).conj() * f).imag + own for at, f, own in demands)
        torques.append(torque - height * GRAVITY * ((pressed - joints[n]).conj() * force).imag)
    ankle, knee, hip = torques
    return hip, -knee, ankle
