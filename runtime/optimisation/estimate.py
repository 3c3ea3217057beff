"""Estimate of the optimum from noisy costs: the minimum of a quadratic function that is fitted to them."""

from __future__ import annotations

import numpy as np

FIT_WIDTH = 0.3  # standard deviation of the weights about the later evaluations, as a fraction of the bounds
CURVATURE_SPREAD = 0.5  # expected deviation of the curvatures from their mean, relative to it
CURVATURE_MINIMUM = 0.2  # smallest curvature in any direction, relative to the mean


def fitted_minimum(points: np.ndarray, costs: np.ndarray) -> np.ndarray | None:
    """Return the point of the lowest expected cost, or None if the costs do not determine one.

    A weighted ridge regression: where noise hides a curvature, the fit takes the mean curvature of all directions. It
    uses every evaluation, so that its error is below that of the best evaluation and of the mean of CMA-ES's
    distribution, both of which follow the noise.

    points : n × parameters, as fractions of the bounds, in the order of their evaluation
    costs : n finite numbers

    Returns fractions of the bounds, 0 to 1.
    """
    number, size = points.shape
    if number < 2 * (size + 2):
        return None
    centre = points[number // 2 :].mean(axis=0)
    offsets = points - centre
    weights = np.exp(-np.sum(offsets**2, axis=1) / (2.0 * FIT_WIDTH**2))
    first, second = np.triu_indices(size)
    squares = np.column_stack([np.ones(number), offsets, 0.5 * np.sum(offsets**2, axis=1)])
    root = np.sqrt(weights)
    isotropic = np.linalg.lstsq(squares * root[:, None], costs * root, rcond=None)[0]
    curvature = isotropic[-1]
    if not curvature > 0.0:
        return None
    diagonal = first == second
    products = offsets[:, first] * offsets[:, second] * np.where(diagonal, 0.5, 1.0)
    terms = np.column_stack([np.ones(number), offsets, products])
    full = np.linalg.lstsq(terms * root[:, None], costs * root, rcond=None)[0]
    variance = np.sum(weights * (costs - terms @ full) ** 2) / max(np.sum(weights) - terms.shape[1], 1.0)
    expected = np.concatenate([np.zeros(1 + size), np.where(diagonal, curvature, 0.0)])
    penalty = np.full(len(expected), variance / (CURVATURE_SPREAD * curvature) ** 2)
    penalty[: 1 + size] = 0.0
    weighted = terms.T * weights
    normal = weighted @ terms + np.diag(penalty)
    coefficients = expected + np.linalg.lstsq(normal, weighted @ (costs - terms @ expected), rcond=None)[0]
    hessian = np.zeros((size, size))
    hessian[first, second] = hessian[second, first] = coefficients[1 + size :]
    return _bounded_minimum(coefficients[1 : 1 + size], hessian, curvature, centre)


def _bounded_minimum(gradient, hessian, curvature, centre):
    """Return the minimum within 0 to 1 of a quadratic function about `centre`, by coordinate descent."""
    values, vectors = np.linalg.eigh(hessian)
    hessian = vectors @ np.diag(np.maximum(values, CURVATURE_MINIMUM * curvature)) @ vectors.T
    point = np.zeros(len(gradient))
    for _ in range(1000):
        before = point.copy()
        for i in range(len(point)):
            slope = gradient[i] + hessian[i] @ point - hessian[i, i] * point[i]
            point[i] = np.clip(-slope / hessian[i, i], -centre[i], 1.0 - centre[i])
        if np.max(np.abs(point - before)) < 1e-12:
            break
    return point + centre
