"""The disturbance observer against the joint whose torques it estimates."""

import numpy as np
import pytest

from blocks.controllers import DisturbanceObserver
from graph import Diagram, compile
from tests.graph.complaints import refusal

DT, INERTIA, BANDWIDTH = 0.002, 0.3, 25.0


def observed(disturbance, ticks, damping=0.0, subtracted=False, **parameters):
    """Estimates of the disturbance of a joint, which its drive moves, and its velocities. disturbance : N·m"""
    block = DisturbanceObserver(inertia=INERTIA, damping=damping, bandwidth=BANDWIDTH, **parameters)
    block.dt = DT
    velocity, estimates, velocities = 2.0, [], []
    for tick in range(ticks):
        estimates.append(block.step(velocity=velocity))
        velocities.append(velocity)
        torque = -estimates[-1] if subtracted else 0.7
        block.update(torque, velocity)
        velocity += DT / INERTIA * (torque - damping * velocity + disturbance(tick))
    return np.array(estimates), np.array(velocities)


@pytest.mark.parametrize("damping", [0.0, 0.05])
@pytest.mark.parametrize("subtracted", [False, True])
def test_a_step_is_estimated_with_the_time_constant_and_without_an_error(damping, subtracted):
    estimates, velocities = observed(lambda tick: 1.5 * (tick >= 100), 800, damping, subtracted)
    expected = 1.5 * (1.0 - (1.0 - BANDWIDTH * DT) ** np.arange(-100, 700).clip(0))
    assert np.abs(estimates - expected).max() < 1e-9
    assert subtracted == (np.ptp(velocities[-50:]) < 0.1)


def test_the_range_is_bounded_and_a_bandwidth_above_the_rate_is_refused():
    estimates, _ = observed(lambda tick: 50.0, 400, limit=3.0)
    assert estimates.max() == 3.0
    with Diagram("slow", rate=10) as diagram:
        DisturbanceObserver(bandwidth=11.0)(0.0, velocity=0.0)
    assert "at most the rate of the block, 10 rad/s, got 11" in str(refusal(compile, diagram))
