"""Bias, offset and matrix of a sensor from what it measured. A fit that cannot be made is a Unfit, which says what is
missing.
"""

import numpy as np

from runtime.commissioning.calibration import stillness

G = 9.80665  # m/s², standard
MANY = 12  # positions from which on the axes' skew can be told too, from nine numbers
LEAST_REST = 2.0  # s in all for the gyroscope
ROUNDS = 50
SPREAD = 0.12  # least share of a direction in all that the magnetometer was turned to; an even sphere has 1/3
OCTANTS = 7  # of eight that it has to have seen
LEAST_FIELD = 60  # measurements


class Unfit(Exception):
    """What was measured is not enough; says what is missing."""


def gyroscope(found):
    """Bias in rad/s: the mean over every Rest, by its time."""
    total = sum(rest.seconds for rest in found)
    if total < LEAST_REST:
        raise Unfit(
            f"it lay still for {total:.1f} s, and {LEAST_REST:g} s are wanted: let it rest on a table that "
            "nobody touches"
        )
    return np.average([rest.gyro for rest in found], axis=0, weights=[rest.seconds for rest in found])


def accelerometer(found):
    """(offset in m/s², matrix): |matrix (measured − offset)| = g in every position, as nearly as can be.

    Six positions tell three offsets and three scales; from a dozen on the matrix is a symmetric one. Which way it lay
    need not be known.
    """
    missing = [face for face in stillness.FACES if face not in stillness.faces(found)]
    if missing:
        raise Unfit(
            f"it has not lain still with {', '.join(missing)} up: let it rest for a second in each of the six positions"
        )
    measured = np.array([rest.accel for rest in found])
    symmetric = len(measured) >= MANY
    low, high = measured.min(axis=0), measured.max(axis=0)
    start = np.concatenate([(low + high) / 2.0, 2.0 * G / (high - low), np.zeros(3 if symmetric else 0)])
    solution = least_squares(lambda p: spheres(p, measured), start)
    offset, matrix = solution[:3], matrix_of(solution[3:])
    if (
        not np.all(np.isfinite(solution))
        or np.any(np.abs(np.diag(matrix) - 1.0) > 0.3)
        or np.max(np.abs(offset)) > 0.3 * G
    ):
        raise Unfit("the positions do not fit to one gravity: was it moved while it rested, or is its range too small?")
    return offset, matrix


def spheres(parameters, measured):
    return np.linalg.norm((measured - parameters[:3]) @ matrix_of(parameters[3:]).T, axis=1) / G - 1.0


def matrix_of(numbers):
    """A symmetric matrix: its diagonal, then xy, xz, yz where they are given."""
    matrix = np.diag(numbers[:3])
    for value, (row, column) in zip(numbers[3:], ((0, 1), (0, 2), (1, 2))):
        matrix[row, column] = matrix[column, row] = value
    return matrix


def least_squares(residuals, start):
    """Levenberg and Marquardt's. residuals : function of the parameters"""
    x, damping = np.array(start, float), 1e-3
    now = residuals(x)
    for _ in range(ROUNDS):
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


def magnetometer(field):
    """(offset in µT, matrix): the ellipsoid that the measurements lie on becomes a sphere of its own size.

    Least squares of a quadric; the matrix is the symmetric root, which turns nothing.   field : (n, 3) µT
    """
    field = np.asarray(field, float)
    if len(field) < LEAST_FIELD:
        raise Unfit(
            f"the magnetometer has measured {len(field)} times, and {LEAST_FIELD} are wanted: turn it slowly "
            "to all sides"
        )
    scale = np.abs(field).max()
    if not scale > 0.0:
        raise Unfit("the magnetometer measures nothing")
    x, y, z = (field / scale).T
    quadric = np.column_stack([x * x, y * y, z * z, 2 * x * y, 2 * x * z, 2 * y * z, 2 * x, 2 * y, 2 * z])
    a, b, c, d, e, f, *linear = np.linalg.lstsq(quadric, np.ones(len(field)), rcond=None)[0]
    shape = np.array([[a, d, e], [d, b, f], [e, f, c]])
    turn = "turn it slowly to all sides, each axis up and down, away from iron"
    try:
        center = -np.linalg.solve(shape, linear)
        values, vectors = np.linalg.eigh(shape / (1.0 + center @ shape @ center))
    except np.linalg.LinAlgError:
        raise Unfit(f"the magnetometer was turned about one axis alone: {turn}") from None
    if values.min() <= 0.0 or values.max() / values.min() > 25.0:
        raise Unfit(f"its measurements lie on no ellipsoid: {turn}")
    radius = float(np.prod(values) ** (-1.0 / 6.0))  # of the sphere with the ellipsoid's volume
    matrix = radius * vectors @ np.diag(np.sqrt(values)) @ vectors.T
    offset = center * scale
    check_turns((field - offset) @ matrix.T, turn)
    return offset, matrix


def check_turns(field, turn):
    """Unfit where the directions leave too much of the sphere out."""
    directions = field / np.linalg.norm(field, axis=1, keepdims=True)
    octants = len({tuple(row) for row in (directions > 0.0).tolist()})
    seen = np.unique(np.round(3.0 * directions), axis=0)  # each direction once, however long it was held
    seen = seen / np.linalg.norm(seen, axis=1, keepdims=True)
    spread = np.linalg.eigvalsh(seen.T @ seen / len(seen)).min()
    if octants < OCTANTS or spread < SPREAD:
        raise Unfit(f"the field came from {octants} of 8 octants, and not enough from all sides: {turn}")
