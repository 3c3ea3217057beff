"""Weights of the potential energy of diagrams/m_blue.py, fitted to torques of healthy adults.

python -m tests.diagrams.energy
"""

import numpy as np

from blocks.wearer import Walker
from graph import Diagram
from runtime.session.simulate import simulate

SPEEDS = (0.8, 1.2, 1.6)  # m/s
MASS, FULL_LOAD, SEGMENT = 70.0, 1.1, 0.42  # kg, body weights, m of thigh and of shank
CARRIED = 0.44 * 9.80665  # N/kg on one hip in a squat
EVEN = 0.5 / FULL_LOAD  # load on each foot


def walking(speed):
    """Return (thigh, shank, load, hip torque, knee torque) of the left leg: rad, N·m/kg, with load from 0 to 1."""
    with Diagram("walk", rate=100) as diagram:
        Walker(f"0:{speed}", variability=0.0, name="adult")()
    trial = simulate(diagram, 6.0)
    names = ("thigh_pitch", "shank_pitch", "ground_force[1]", "hip_torque", "knee_torque")
    thigh, shank, force, hip, knee = (trial[f"adult.left_{name}"][trial.time > 3.0] for name in names)
    return thigh, shank, (force / (FULL_LOAD * 9.80665 * MASS)).clip(0.0, 1.0), hip / MASS, knee / MASS


def squatting():
    """Return the same of a slow squat: the weight passes in front of the ankle, hip and knee keep their distance."""
    depth = np.linspace(0.0, 1.0, 40)
    thigh, shank = np.radians(85.0) * depth, -np.radians(28.0) * depth
    knee = -SEGMENT * np.sin(shank)
    hip, weight = knee - SEGMENT * np.sin(thigh), 0.05 * depth
    return thigh, shank, np.full(40, EVEN), CARRIED * (hip - weight), CARRIED * (weight - knee)


def at_rest(thigh, shank, load):
    """Return the same of postures without torque. thigh, shank : degrees, from and to"""
    return (
        np.radians(np.linspace(*thigh, 20)),
        np.radians(np.linspace(*shank, 20)),
        np.full(20, load),
        *np.zeros((2, 20)),
    )


def columns(thigh, shank, load):
    """Return the torques of hip, then knee, per weight: those of the whole load, then those without load.

    The potential is w₁ cos(thigh) + w₂ cos(shank) + w₃ cos(knee) − w₄ thigh − w₅ shank, up to the sign.
    """
    none = np.zeros_like(thigh)
    own, below, knee, one = np.sin(thigh), np.sin(shank), np.sin(thigh - shank), np.ones_like(thigh)
    pairs = [(own, none), (below, -below), (none, knee), (one, none), (one, -one)]
    return np.array(
        [np.concatenate((share * hip, share * bend)) for share in (load, 1.0 - load) for hip, bend in pairs]
    ).T


def fit():
    """Return the weights (with load or without, hip or knee, sin(thigh), sin(shank), sin(knee) or 1), N·m/kg."""
    tasks = [walking(speed) for speed in SPEEDS]
    tasks += [squatting(), at_rest((80, 80), (-15, 20), 0.05), at_rest((-3, 3), (-5, 1), EVEN)]
    importance = [1.0, 1.0, 1.0, 1.0, 2.0, 2.0]
    scales = [np.sqrt(each / len(task[0])) for each, task in zip(importance, tasks)]
    rows = np.vstack([scale * columns(*task[:3]) for scale, task in zip(scales, tasks)])
    aims = np.concatenate([scale * np.concatenate(task[3:]) for scale, task in zip(scales, tasks)])
    found = np.linalg.lstsq(rows, aims, rcond=None)[0].reshape(2, 5)
    return np.array([[(a, b, 0.0, c + d), (0.0, -b, k, -d)] for a, b, k, c, d in found])


if __name__ == "__main__":
    print(np.round(fit(), 2).tolist())
