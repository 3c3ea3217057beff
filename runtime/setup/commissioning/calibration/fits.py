"""Bias, offset and matrix of a sensor, fitted to its measurements. Raises Unfit if data are missing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from runtime.setup.commissioning.calibration import stillness

if TYPE_CHECKING:
    from runtime.setup.commissioning.calibration.stillness import Rest

G = 9.80665  # m/s², standard
SYMMETRIC_FIT_POSITIONS = 12  # positions from which the skew of the axes is fitted too (nine parameters)
MIN_REST_TIME = 2.0  # s, total for the gyroscope
MAX_ITERATIONS = 50
MIN_SPREAD = 0.12  # smallest eigenvalue of the second moment of the directions; 1/3 for a uniform sphere
MIN_OCTANTS = 7  # octants of eight with field directions
MIN_FIELD_SAMPLES = 60  # measurements of the magnetometer


class Unfit(Exception):
    """The measurements are not sufficient. The text names what is missing."""


def gyroscope(rests: Sequence[Rest]) -> np.ndarray:
    """Return the bias in rad/s: the mean over all rests, weighted by their duration. rests : list of Rest"""
    total = sum(rest.seconds for rest in rests)
    if total < MIN_REST_TIME:
        raise Unfit(
            f"at rest for only {total:.1f} s of {MIN_REST_TIME:g} s: leave the sensor on a table without touching it"
        )
    return np.average([rest.gyro for rest in rests], axis=0, weights=[rest.seconds for rest in rests])


def accelerometer(rests: Sequence[Rest]) -> tuple[np.ndarray, np.ndarray]:
    """Return (offset in m/s², matrix): the least-squares fit of |matrix (measured − offset)| = g over all positions.

    Six positions determine three offsets and three scales. From SYMMETRIC_FIT_POSITIONS the matrix is symmetric. The
    fit does not use the orientations.

    rests : list of Rest
    """
    missing = [face for face in stillness.FACES if face not in stillness.faces(rests)]
    if missing:
        raise Unfit(f"no rest with {', '.join(missing)} up: rest the sensor for a second in each of the six positions")
    measured = np.array([rest.accel for rest in rests])
    symmetric = len(measured) >= SYMMETRIC_FIT_POSITIONS
    low, high = measured.min(axis=0), measured.max(axis=0)
    start = np.concatenate([(low + high) / 2.0, 2.0 * G / (high - low), np.zeros(3 if symmetric else 0)])
    solution = least_squares(lambda p: _spheres(p, measured), start)
    offset, matrix = solution[:3], matrix_of(solution[3:])
    if (
        not np.all(np.isfinite(solution))
        or np.any(np.abs(np.diag(matrix) - 1.0) > 0.3)
        or np.max(np.abs(offset)) > 0.3 * G
    ):
        raise Unfit("the positions do not match one gravity vector: keep the sensor at rest and check its range")
    return offset, matrix


def _spheres(parameters: np.ndarray, measured: np.ndarray) -> np.ndarray:
    return np.linalg.norm((measured - parameters[:3]) @ matrix_of(parameters[3:]).T, axis=1) / G - 1.0


def matrix_of(numbers: np.ndarray) -> np.ndarray:
    """Return a symmetric matrix. numbers : diagonal, then optionally xy, xz, yz"""
    matrix = np.diag(numbers[:3])
    for value, (row, column) in zip(numbers[3:], ((0, 1), (0, 2), (1, 2))):
        matrix[row, column] = matrix[column, row] = value
    return matrix


def least_squares(residuals: Callable[..., Any], start: np.ndarray) -> np.ndarray:
    """Minimise by the Levenberg-Marquardt method. Returns the parameters. residuals : function of the parameters"""
    x, damping = np.array(start, float), 1e-3
    now = residuals(x)
    for _ in range(MAX_ITERATIONS):
        steps = 1e-6 * np.maximum(np.abs(x), 1e-3)
        slope = np.column_stack(
            [(residuals(x + step * unit) - now) / step for step, unit in zip(steps, np.eye(len(x)))]
        )
        square = slope.T @ slope
        move = np.linalg.lstsq(square + damping * np.diag(np.diag(square) + 1e-12), -slope.T @ now, rcond=None)[0]
        then = residuals(x + move)
        if then @ then < now @ now:
            x, now, damping = x + move, then, damping / 5.0
            if np.abs(move).max() < 1e-12:
                break
        else:
            damping *= 5.0
            if damping > 1e12:
                break
    return x


def magnetometer(field: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (offset in µT, matrix) that map the ellipsoid of the measurements to a sphere of equal volume.

    The ellipsoid is a least-squares quadric. The matrix is the symmetric root, without rotation.

    field : (n, 3) µT
    """
    field = np.asarray(field, float)
    if len(field) < MIN_FIELD_SAMPLES:
        raise Unfit(
            f"only {len(field)} of {MIN_FIELD_SAMPLES} measurements of the magnetometer: turn the sensor slowly in all "
            "directions"
        )
    scale = np.abs(field).max()
    if not scale > 0.0:
        raise Unfit("the magnetometer reports zero field")
    x, y, z = (field / scale).T
    quadric = np.column_stack([x * x, y * y, z * z, 2 * x * y, 2 * x * z, 2 * y * z, 2 * x, 2 * y, 2 * z])
    a, b, c, d, e, f, *linear = np.linalg.lstsq(quadric, np.ones(len(field)), rcond=None)[0]
    shape = np.array([[a, d, e], [d, b, f], [e, f, c]])
    turn = "turn the sensor slowly in all directions, each axis up and down, away from iron"
    try:
        center = -np.linalg.solve(shape, linear)
        values, vectors = np.linalg.eigh(shape / (1.0 + center @ shape @ center))
    except np.linalg.LinAlgError:
        raise Unfit(f"the sensor was turned about one axis only: {turn}") from None
    if values.min() <= 0.0 or values.max() / values.min() > 25.0:
        raise Unfit(f"the measurements do not fit an ellipsoid: {turn}")
    radius = float(np.prod(values) ** (-1.0 / 6.0))  # of the sphere with the ellipsoid's volume
    matrix = radius * vectors @ np.diag(np.sqrt(values)) @ vectors.T
    offset = center * scale
    check_turns((field - offset) @ matrix.T, turn)
    return offset, matrix


def check_turns(field: np.ndarray, turn: str) -> None:
    """Raise Unfit if the directions do not cover the sphere. field : (n, 3); turn : instruction for the message"""
    directions = field / np.linalg.norm(field, axis=1, keepdims=True)
    octants = len({tuple(row) for row in (directions > 0.0).tolist()})
    seen = np.unique(np.round(3.0 * directions), axis=0)  # each direction counts once, whatever its duration
    seen = seen / np.linalg.norm(seen, axis=1, keepdims=True)
    spread = np.linalg.eigvalsh(seen.T @ seen / len(seen)).min()
    if octants < MIN_OCTANTS or spread < MIN_SPREAD:
        raise Unfit(f"the field directions cover {octants} of 8 octants unevenly: {turn}")
