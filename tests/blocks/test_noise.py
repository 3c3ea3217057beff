"""Noise: the numbers of NumPy's Philox, a value that depends on seed and tick alone, and the right distributions."""

import math

import numpy as np
import pytest
from scipy.stats import kstest, norm, uniform

from blocks.sources import GaussianNoise, UniformNoise
from graph import Diagram, DiagramError
from tests.blocks.proofs import at, ulps
from tests.blocks.running import run


def bits(tick, seed):
    """Two words from the counter (tick, 0, 0, 0) and the key (seed, 0): NumPy counts up before it draws."""
    counter = (tick - 1) % 2**256
    words = np.random.Philox(
        counter=[counter >> shift & 2**64 - 1 for shift in (0, 64, 128, 192)], key=seed
    ).random_raw(2)
    return [(int(word) >> 11) * 2.0**-53 for word in words]


@pytest.mark.parametrize("seed", [0, 1, 7, 2**53])
def test_polynomial_values_equal_numpys(seed):
    uniform, gaussian = UniformNoise(0.0, 1.0, seed), GaussianNoise(0.0, 1.0, seed)
    for tick in (0, 1, 2, 1000, 2**40):
        a, b = bits(tick, seed)
        assert at(uniform, tick) == a
        assert ulps(at(gaussian, tick), math.sqrt(-2.0 * math.log(1.0 - a)) * math.cos(2.0 * math.pi * b)) <= 4.0


def test_a_value_depends_on_seed_and_tick_alone():
    with Diagram("noise", rate=100) as diagram:
        GaussianNoise(seed=3, name="every_tick")
        GaussianNoise(seed=3, name="every_third", every=3)
        GaussianNoise(seed=4, name="other")
    first, second = run(diagram, 60), run(diagram, 60)
    assert np.array_equal(first["every_tick.y"], second["every_tick.y"])
    assert np.array_equal(first["every_third.y"][::3], first["every_tick.y"][::3])
    assert not np.any(first["other.y"] == first["every_tick.y"])
    by_hand = GaussianNoise(seed=3)
    assert [at(by_hand, tick) for tick in reversed(range(60))] == first["every_tick.y"][::-1].tolist()


def test_mean_and_deviation_scale_the_noise():
    assert at(GaussianNoise(5.0, 3.0, seed=9), 17) == 5.0 + 3.0 * at(GaussianNoise(seed=9), 17)
    assert at(GaussianNoise(5.0, 0.0, seed=9), 17) == 5.0


@pytest.mark.parametrize(
    "make, distribution",
    [
        (lambda: GaussianNoise(2.0, 3.0, seed=11, name="noise"), norm(2.0, 3.0)),
        (lambda: UniformNoise(-1.0, 4.0, seed=11, name="noise"), uniform(-1.0, 5.0)),
    ],
)
def test_noise_has_the_right_distribution_without_correlation(make, distribution):
    """Kolmogorov and Smirnov over 20,000 ticks of one seed, p above 0.01; correlation of neighbours within four
    standard errors.
    """
    with Diagram("noise", rate=1000) as diagram:
        make()
    y = run(diagram, 20000)["noise.y"]
    assert kstest(y, distribution.cdf).pvalue > 0.01
    assert abs(np.corrcoef(y[:-1], y[1:])[0, 1]) < 4.0 / math.sqrt(len(y))


def test_the_range_holds_the_largest_value_that_53_random_bits_can_make():
    largest = math.sqrt(-2.0 * math.log(2.0**-53))
    assert largest <= GaussianNoise().output_range().high <= largest + 0.001
    assert -largest - 0.001 <= GaussianNoise().output_range().low <= -largest


@pytest.mark.parametrize(
    "make, said",
    [
        (lambda: UniformNoise(2.0, 1.0), "lower must be at most upper"),
        (lambda: UniformNoise(-math.inf, 1.0), "finite"),
        (lambda: GaussianNoise(deviation=-1.0), "at least"),
        (lambda: GaussianNoise(seed=-1), "at least 0"),
        (lambda: GaussianNoise(seed=1.5), "whole number"),
    ],
)
def test_wrong_parameters_are_refused(make, said):
    with pytest.raises(DiagramError, match=said):
        make()
