"""Estimate of the optimum from noisy costs: the minimum of a quadratic function that is fitted to them."""

from __future__ import annotations

import numpy as np

FIT_WIDTH = 0.4  # standard deviation of the weights about a centre, as a fraction of the bounds
WIDTH_HALVINGS = 3
CURVATURE_SPREAD = 0.3  # expected deviation of the curvatures from their mean, relative to it
CURVATURE_MINIMUM = 0.2  # smallest curvature in any direction relative to the mean, where noise hides it
NUMERICAL_MINIMUM = 1e-9  # the same without noise
PENALTY_LIMIT = 10.0  # largest cost above the median, relative to the difference of median and lowest cost


@np.errstate(over="ignore")  # a spread that overflows is infinite
def fitted_minimum(points: np.ndarray, costs: np.ndarray) -> np.ndarray | None:
    """Return the point of the lowest expected cost; None if the costs do not determine one.

    The fit uses every evaluation, so that its error is below that of the best evaluation and of the mean of CMA-ES's
    distribution, both of which follow the noise. Where another shape of the cost exceeds the noise, it is repeated with
    a smaller width, about its minimum.

    points : n × parameters, as fractions of the bounds, in the order of their evaluation
    costs : n finite numbers

    Returns fractions of the bounds, between the smallest and largest of the points.
    """
    lowest, median = np.min(costs), np.median(costs)
    kept = costs <= median + PENALTY_LIMIT * (median - lowest)  # higher ones are penalties rather than measurements
    points, costs = points[kept], costs[kept]
    number, size = points.shape
    spread = np.max(costs) - lowest
    if number < 2 * (size + 2) or not 0.0 < spread < np.inf:
        return None
    costs = (costs - lowest) / spread
    minimum, variance = _fit(points, costs, points[number // 2 :].mean(axis=0), FIT_WIDTH)
    for halving in range(1, WIDTH_HALVINGS + 1):
        if minimum is None:
            break
        narrower, remaining = _fit(points, costs, minimum, FIT_WIDTH / 2**halving)
        if narrower is None or remaining > 0.5 * variance:  # as noise, which does not depend on the width
            break
        minimum, variance = narrower, remaining
    return minimum


def _fit(points, costs, centre, width):
    """Return the minimum of a weighted ridge regression, or None, and the variance of its residuals.

    Where noise hides a curvature, the fit takes the mean curvature of all directions.
    """
    number, size = points.shape
    offsets = points - centre
    weights = np.exp(-np.sum(offsets**2, axis=1) / (2.0 * width**2))
    first, second = np.triu_indices(size)
    diagonal = first == second
    products = offsets[:, first] * offsets[:, second] * np.where(diagonal, 0.5, 1.0)
    terms = np.column_stack([np.ones(number), offsets, products])
    freedom = np.sum(weights) - terms.shape[1]
    if width < FIT_WIDTH and freedom < size:
        return None, 0.0
    isotropic = _regression(np.column_stack([terms[:, : 1 + size], 0.5 * np.sum(offsets**2, axis=1)]), costs, weights)
    curvature = isotropic[-1]
    if not curvature > 0.0:
        return None, 0.0
    residual = costs - terms @ _regression(terms, costs, weights)
    variance = np.sum(weights * residual**2) / max(freedom, 1.0)
    expected = np.concatenate([np.zeros(1 + size), np.where(diagonal, curvature, 0.0)])
    penalty = np.full(len(expected), variance / (CURVATURE_SPREAD * curvature) ** 2)
    penalty[: 1 + size] = 0.0
    weighted = terms.T * weights
    normal = weighted @ terms + np.diag(penalty)
    coefficients = expected + np.linalg.lstsq(normal, weighted @ (costs - terms @ expected), rcond=None)[0]
    hessian = np.zeros((size, size))
    hessian[first, second] = hessian[second, first] = coefficients[1 + size :]
    uncertainty = 2.0 * np.sqrt(variance * np.max(np.diag(np.linalg.pinv(normal))[1 + size :][diagonal]))
    smallest = max(min(CURVATURE_MINIMUM * curvature, uncertainty), NUMERICAL_MINIMUM * curvature)
    limits = points.min(axis=0) - centre, points.max(axis=0) - centre
    return centre + _bounded_minimum(coefficients[1 : 1 + size], hessian, smallest, limits), variance


def _regression(terms, costs, weights):
    root = np.sqrt(weights)
    return np.linalg.lstsq(terms * root[:, None], costs * root, rcond=None)[0]


def _bounded_minimum(gradient, hessian, smallest, limits):
    """Return the minimum of a quadratic function within limits, by coordinate descent.

    smallest : curvature of a direction in which the function has less
    limits : lowest and highest values
    """
    values, vectors = np.linalg.eigh(hessian)
    hessian = vectors @ np.diag(np.maximum(values, smallest)) @ vectors.T
    point = np.zeros(len(gradient))
    for _ in range(1000):
        before = point.copy()
        for i in range(len(point)):
            slope = gradient[i] + hessian[i] @ point - hessian[i, i] * point[i]
            point[i] = np.clip(-slope / hessian[i, i], limits[0][i], limits[1][i])
        if np.max(np.abs(point - before)) < 1e-12:
            break
    return point
