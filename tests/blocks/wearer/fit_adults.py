"""Fit of the deviations between adults: which of them occur together.

Deviations of the angles and forces are independent at first, with the standard deviations of the measured adults. Then
what walking demands restricts them, alike at all speeds: the foot is flat in mid-stance, the force on the ground
accelerates the body as the hips move, and torques and length of the strides differ as between adults.
"""

import numpy as np

from blocks.wearer.adults import CURVES, PHASES, WEIGHTS, adult, shape, spread
from blocks.wearer.mechanics import pitches_of
from blocks.wearer.stride import PELVIS_HARMONICS, ground, other, unpacked, values

BODY_HEIGHT, GRAVITY = 1.70, 9.80665
FLATNESS = np.radians(1.5)  # standard deviation of the pitch of the foot in mid-stance about its mean, rad
STRIDE_LENGTH = 0.06  # standard deviation of the length of the strides at one speed, relative
BALANCE = 0.1  # standard deviation of the force from that which accelerates the hips, body weights
TORQUE_TRUST = 0.4  # weight of the torques: inverse dynamics varies by more than what laboratories measure
# Standard deviations before the restrictions, so that those of the tables remain after them.
PRIOR = (1.45, 2.2, 1.45, 2.3, 1.55, 2.0)
PROJECTION = np.linalg.pinv(shape(PHASES))
STEP = 0.2
COUNT = 36  # components; the others deviate by less than half a standard deviation of one weight


def demands(entry, torque_deviations):
    """Return what walking demands of an adult, in standard deviations."""
    curves = [values(each) for each in entry["angles"]]
    foot = pitches_of(entry["pelvis_pitch"], curves)[2][30:72:4]
    force = ground(entry, PHASES)[0].imag
    k = np.array(PELVIS_HARMONICS)
    waves = -unpacked(entry["pelvis_height"][1:]) * (2.0 * np.pi * k / entry["stride_time"]) ** 2
    lift = (np.exp(2j * np.pi * np.outer(PHASES, k)) @ waves).real * BODY_HEIGHT / GRAVITY
    torques = [
        TORQUE_TRUST * PROJECTION @ (2.0 * values(each) / sd) for each, sd in zip(entry["moments"], torque_deviations)
    ]
    return np.concatenate(
        [
            *torques,
            [np.log(entry["stride_time"]) / STRIDE_LENGTH],
            (foot - foot.mean()) / FLATNESS,
            PROJECTION @ (force + other(force) - lift) / BALANCE,
        ]
    )


def components(entries, torque_deviations):
    """Return the components of the adults: weights per standard deviation, in rows, the largest first.

    entries : of the average walk; torque_deviations : standard deviation at PHASES of the torques of each entry, N·m/kg
    """
    precision = np.diag(np.repeat(PRIOR, WEIGHTS) ** -2.0)
    for entry, sd in zip(entries, torque_deviations):
        usual = demands(adult(entry, np.zeros(CURVES * WEIGHTS)), sd)
        slopes = [demands(adult(entry, STEP * unit), sd) - usual for unit in np.eye(CURVES * WEIGHTS)]
        change = np.array(slopes).T / STEP
        precision += change.T @ change / len(entries)
    size = sum(wave.T @ wave for entry in entries for wave in spreads(entry))
    root = np.linalg.cholesky(np.linalg.inv(precision))
    _, directions = np.linalg.eigh(root.T @ size @ root)
    rows = directions.T[: -COUNT - 1 : -1] @ root.T
    return rows * np.sign(rows[np.arange(len(rows)), np.abs(rows).argmax(axis=1)])[:, None]


def spreads(entry):
    """Yield the deviations of the angles by weight, in mean standard deviations of the joint."""
    for n, deviation in enumerate(values(each) for each in entry["angle_deviations"]):
        yield np.pad(spread(deviation) / deviation.mean(), ((0, 0), (n * WEIGHTS, (CURVES - 1 - n) * WEIGHTS)))
    for n in (3, 4, 5):
        yield 0.5 * np.pad(shape(PHASES), ((0, 0), (n * WEIGHTS, (CURVES - 1 - n) * WEIGHTS)))
