"""Estimate of the optimum from noisy costs: the minimum of a quadratic function that is fitted to them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

FIT_WIDTH = 0.4  # standard deviation of the weights about a centre, as a fraction of the bounds
WIDTH_HALVINGS = 3
CURVATURE_SPREAD = 0.3  # expected deviation of the curvatures from their mean, relative to it
CURVATURE_MINIMUM = 0.2  # smallest curvature in any direction relative to the mean, where noise hides it
NUMERICAL_MINIMUM = 1e-9  # the same without noise
REFERENCES_MINIMUM = 2
SAMPLES = 400  # functions that the costs allow as well
LEVEL = 0.95  # probability of an interval
PENALTY_LIMIT = 10.0  # largest cost above the median, relative to the difference of median and lowest cost


@dataclass(frozen=True)
class Fit:
    """Quadratic function that was fitted to noisy costs.

    minimum : point of the lowest expected cost, as fractions of the bounds
    minima : samples × parameters, minima of functions that the costs allow as well
    gain, gain_error : cost of the initial values less that of the minimum, and its standard error
    drift, drift_error : change of the cost of the same values over all evaluations, and its standard error; 0 without
        references
    """

    minimum: np.ndarray
    minima: np.ndarray
    gain: float
    gain_error: float
    drift: float
    drift_error: float

    @property
    def typical(self) -> np.ndarray:
        """Median of the minima. Unlike `minimum` it may lie beyond the evaluations, up to a bound."""
        return np.median(self.minima, axis=0)

    def intervals(self) -> np.ndarray:
        """Return the interval of each parameter that contains the optimum with LEVEL, parameters × 2."""
        low, high = np.quantile(self.minima, (0.5 - 0.5 * LEVEL, 0.5 + 0.5 * LEVEL), axis=0)
        return np.column_stack([np.minimum(low, self.minimum), np.maximum(high, self.minimum)])


@np.errstate(over="ignore")  # a spread that overflows is infinite
def fitted(
    points: np.ndarray,
    costs: np.ndarray,
    start: np.ndarray | None = None,
    places: np.ndarray | None = None,
    references: np.ndarray | None = None,
) -> Fit | None:
    """Return the fit from which the optimum is estimated; None if the costs do not determine a minimum.

    The fit uses every evaluation, so that its error is below that of the best evaluation and of the mean of CMA-ES's
    distribution, both of which follow the noise. Where another shape of the cost exceeds the noise, it is repeated with
    a smaller width, about its minimum. With two or more measurements of a reference, a drift of all costs, linear in
    the number of measurements, is part of the function.

    points : n × parameters, as fractions of the bounds, in the order of their evaluation
    costs : n finite numbers
    start : initial values, as fractions of the bounds; by default their middle
    places : place of each evaluation in the order of all measurements, by default 0.5, 1.5, ...
    references : m × 2, place and cost of each measurement of the initial values
    """
    start = np.full(points.shape[1], 0.5) if start is None else start
    places = np.arange(len(costs)) + 0.5 if places is None else places
    references = np.empty((0, 2)) if references is None or len(references) < REFERENCES_MINIMUM else references
    lowest, median = np.min(costs), np.median(costs)
    kept = costs <= median + PENALTY_LIMIT * (median - lowest)  # higher ones are penalties rather than measurements
    points, costs, places = points[kept], costs[kept], places[kept]
    number, size = points.shape
    spread = np.max(costs) - lowest
    if number < 2 * (size + 2) or not 0.0 < spread < np.inf:
        return None
    last = max(places[-1], 1.0)
    data = _Data(
        points, (costs - lowest) / spread, places / last, references[:, 0] / last, (references[:, 1] - lowest) / spread
    )
    best = _fit(data, points[number // 2 :].mean(axis=0), FIT_WIDTH)
    for halving in range(1, WIDTH_HALVINGS + 1):
        if best is None:
            return None
        narrower = _fit(data, best.minimum, FIT_WIDTH / 2**halving)
        if narrower is None or narrower.variance > 0.5 * best.variance:  # as noise, which does not depend on the width
            break
        best = narrower
    return None if best is None else best.result(start, spread, bool(len(references)))


@dataclass(frozen=True)
class _Data:
    """Evaluations and references: points, costs in units of their spread, and places from 0 to 1."""

    points: np.ndarray
    costs: np.ndarray
    places: np.ndarray
    reference_places: np.ndarray
    reference_costs: np.ndarray

    def rows(self, terms):
        """Return rows of a regression: terms of the evaluations; then drift and the reference's cost if there are any.

        Those of the references follow those of the evaluations.
        """
        if not len(self.reference_places):
            return terms
        above = np.column_stack([terms, self.places, np.zeros(len(terms))])
        below = np.zeros((len(self.reference_places), above.shape[1]))
        below[:, -2], below[:, -1] = self.reference_places, 1.0
        return np.vstack([above, below])


@dataclass(frozen=True)
class _Weighted:
    """Fit with weights about a centre. Its coefficients have a normal distribution with `covariance`."""

    centre: np.ndarray
    coefficients: np.ndarray
    covariance: np.ndarray
    variance: float
    smallest: float
    limits: tuple[np.ndarray, np.ndarray]
    minimum: np.ndarray

    def result(self, start, spread, referenced):
        """Return the Fit. spread : unit of the costs"""
        size = len(self.centre)
        values, vectors = np.linalg.eigh(self.covariance)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        normal = np.random.default_rng(0).standard_normal((SAMPLES, len(values)))
        samples = self.coefficients + normal @ root.T
        bounds = -self.centre, 1.0 - self.centre
        minima = self.centre + _bounded_minima(*_function(samples, size), self.smallest, bounds)
        difference = -_terms((self.minimum - self.centre)[None])[0]
        if referenced:
            difference = np.concatenate([difference, [0.0, 1.0]])
        else:
            difference += _terms((start - self.centre)[None])[0]
        return Fit(
            self.minimum,
            minima,
            float(spread * difference @ self.coefficients),
            float(spread * np.sqrt(difference @ self.covariance @ difference)),
            float(spread * self.coefficients[-2]) if referenced else 0.0,
            float(spread * np.sqrt(self.covariance[-2, -2])) if referenced else 0.0,
        )


def _fit(data, centre, width):
    """Return the _Weighted of a ridge regression, or None without a minimum.

    Where noise hides a curvature, the fit takes the mean curvature of all directions.
    """
    number, size = data.points.shape
    offsets = data.points - centre
    weights = np.exp(-np.sum(offsets**2, axis=1) / (2.0 * width**2))
    terms = _terms(offsets)
    parts = terms.shape[1]
    if width < FIT_WIDTH and np.sum(weights) - parts < size:
        return None
    costs = np.concatenate([data.costs, data.reference_costs])
    isotropic = data.rows(np.column_stack([terms[:, : 1 + size], 0.5 * np.sum(offsets**2, axis=1)]))
    terms, weights = data.rows(terms), np.concatenate([weights, np.ones(len(data.reference_costs))])
    curvature = _regression(isotropic, costs, weights)[1 + size]
    if not curvature > 0.0:
        return None
    freedom = max(np.sum(weights) - terms.shape[1], 1.0)
    residual = costs - terms @ _regression(terms, costs, weights)
    variance = np.sum(weights * residual**2) / freedom
    first, second = np.triu_indices(size)
    expected, penalty = np.zeros(terms.shape[1]), np.zeros(terms.shape[1])
    expected[1 + size : parts] = np.where(first == second, curvature, 0.0)
    penalty[1 + size : parts] = variance / (CURVATURE_SPREAD * curvature) ** 2
    weighted = terms.T * weights
    normal = weighted @ terms + np.diag(penalty)
    coefficients = expected + np.linalg.lstsq(normal, weighted @ (costs - terms @ expected), rcond=None)[0]
    inverse = np.linalg.pinv(normal)
    uncertainty = 2.0 * np.sqrt(variance * np.max(np.diag(inverse)[1 + size : parts][first == second]))
    smallest = max(min(CURVATURE_MINIMUM * curvature, uncertainty), NUMERICAL_MINIMUM * curvature)
    limits = data.points.min(axis=0) - centre, data.points.max(axis=0) - centre
    minimum = centre + _bounded_minima(*_function(coefficients[None], size), smallest, limits)[0]
    return _Weighted(centre, coefficients, variance * inverse, variance, smallest, limits, minimum)


def _terms(offsets):
    """Return the terms of a quadratic function at offsets from its centre: constant, linear, products."""
    first, second = np.triu_indices(offsets.shape[1])
    products = offsets[:, first] * offsets[:, second] * np.where(first == second, 0.5, 1.0)
    return np.column_stack([np.ones(len(offsets)), offsets, products])


def _function(coefficients, size):
    """Return gradients at the centre and Hessians of functions. coefficients : functions × terms"""
    first, second = np.triu_indices(size)
    hessians = np.zeros((len(coefficients), size, size))
    hessians[:, first, second] = hessians[:, second, first] = coefficients[:, 1 + size : 1 + size + len(first)]
    return coefficients[:, 1 : 1 + size], hessians


def _regression(terms, costs, weights):
    root = np.sqrt(weights)
    return np.linalg.lstsq(terms * root[:, None], costs * root, rcond=None)[0]


def _bounded_minima(gradients, hessians, smallest, limits):
    """Return the minimum of each quadratic function within limits, by coordinate descent.

    smallest : curvature of a direction in which a function has less
    limits : lowest and highest values
    """
    values, vectors = np.linalg.eigh(hessians)
    hessians = (vectors * np.maximum(values, smallest)[:, None]) @ vectors.transpose(0, 2, 1)
    points = np.zeros_like(gradients)
    for _ in range(1000):
        before = points.copy()
        for i in range(points.shape[1]):
            own = hessians[:, i, i]
            slopes = gradients[:, i] + np.sum(hessians[:, i] * points, axis=1) - own * points[:, i]
            points[:, i] = np.clip(-slopes / own, limits[0][i], limits[1][i])
        if np.max(np.abs(points - before)) < 1e-12:
            break
    return points
