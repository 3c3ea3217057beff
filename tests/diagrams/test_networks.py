"""The trained networks: their form, their errors on adults that the training did not have, and the training itself."""

import numpy as np
import pytest

from blocks.networks import OnnxModel
from blocks.wearer import Walker
from diagrams.networks.trials import RATE, trial
from graph import Diagram
from runtime.session.simulate import simulate
from tests.diagrams.networks import NAMES, Network, phase_error

SEEDS = range(6)  # not of the training
# Of docs/explanation/trained_networks.md on 60 seeds, with a margin for the choice of these.
LARGEST_ERRORS = {"phase_sin": 0.14, "phase_cos": 0.13, "hip_torque": 0.19, "knee_torque": 0.10, "ankle_torque": 0.11}
ROUNDING = 2e-6  # of results between -3 and 3, sums of 48 products in single precision in another order


@pytest.fixture(scope="module")
def legs():
    return [leg for seed in SEEDS for leg in trial(seed, 30.0)]


@pytest.mark.parametrize("name", NAMES)
def test_errors_on_held_out_adults_are_as_documented(name, legs):
    network = Network(name)
    for output in (each["name"] for each in network.outputs):
        errors = [network.of_series(leg)[output] - leg[output][network.field - 1 :] for leg in legs]
        assert np.sqrt(np.mean(np.square(errors))) < LARGEST_ERRORS[output], output


@pytest.mark.parametrize("name", NAMES)
def test_streaming_form_equals_window_up_to_rounding(name, legs):
    network = Network(name)
    signals = {key: values[1000 : 1060 + network.field] for key, values in legs[0].items()}
    streaming, window = network.of_samples(signals), network.of_windows(signals)
    assert np.ptp(window) > 0.5
    np.testing.assert_allclose(streaming[network.field - 1 :], window, rtol=0.0, atol=ROUNDING)
    assert np.abs(streaming[network.field - 2] - window[0]).max() > ROUNDING


def test_phase_has_no_direction_in_standing(legs):
    network = Network("gait_phase")
    estimates = [network.of_series(leg) for leg in legs]
    sine, cosine = (
        np.concatenate([leg[f"phase_{part}"][network.field - 1 :] for leg in legs]) for part in ("sin", "cos")
    )
    both = {part: np.concatenate([each[part] for each in estimates]) for part in estimates[0]}
    walking, standing = np.hypot(sine, cosine) > 0.99, np.hypot(sine, cosine) == 0.0
    length = np.hypot(both["phase_sin"], both["phase_cos"])
    assert standing.mean() > 0.02 and np.mean(length[standing] < 0.5) > 0.9 and np.mean(length[walking] > 0.5) > 0.99
    error = phase_error(both, np.arctan2(sine, cosine))[walking]
    assert np.sqrt(np.mean(error**2)) < 0.03


@pytest.mark.parametrize("name", NAMES)
def test_networks_are_small_and_describe_their_ports(name):
    network = Network(name)
    assert network.path.stat().st_size < 200_000
    with Diagram("described", rate=2 * RATE):
        block = OnnxModel(str(network.path))
    assert [port.description for port in block.outputs.values()][: len(network.outputs)] == [
        each["description"] for each in network.outputs
    ]
    assert block.every == 2 and all(each["range"][0] < each["range"][1] for each in network.outputs)


def test_hip_torque_of_a_walker_in_a_diagram():
    with Diagram("walk", rate=200) as diagram:
        walker = Walker(1.2, name="walker", mass=82.0)()
        OnnxModel(str(Network("hip_torque").path), name="network")(
            hip_angle=walker.left_thigh_pitch,
            hip_velocity=walker.left_hip_velocity,
            opposite_hip_angle=walker.right_thigh_pitch,
            opposite_hip_velocity=walker.right_hip_velocity,
        )
    run = simulate(diagram, 8.0)
    valid = run["network.valid"]
    assert run.time[np.argmax(valid)] == pytest.approx(2.54, abs=0.011) and valid[-1]
    estimate, torque = run["network.hip_torque"][valid], run["walker.left_hip_torque"][valid] / 82.0
    assert np.corrcoef(estimate, torque)[0, 1] > 0.97 and np.sqrt(np.mean((estimate - torque) ** 2)) < 0.09


@pytest.mark.soak
def test_training_decreases_the_error_and_exports_what_it_trained(monkeypatch):
    pytest.importorskip("jax")
    from diagrams.networks import train

    for name, value in {"STEPS": 60, "BATCH": 8, "SPAN": 64}.items():
        monkeypatch.setattr(train, name, value)
    legs = [leg for seed in (3000, 3001) for leg in trial(seed, 10.0)]
    layers, metadata = train.train(legs, *train.NETWORKS["hip_torque"])
    x, _ = train.normalised(legs, train.HIPS)
    y, _ = train.normalised(legs, ["hip_torque"])
    own = [(w.transpose(2, 1, 0), b) for w, b in layers]
    estimates = np.asarray(train.network(own, x))
    assert np.mean((estimates - y[:, train.RECEPTIVE_FIELD - 1 :]) ** 2) < 0.5  # of a variance of 1
    model = Network("hip_torque")
    model.layers, model.dilations, model.metadata = layers, train.DILATIONS, metadata
    results = model.session(x.shape[1]).run(None, {"x": x[:1].transpose(0, 2, 1)})[0]
    np.testing.assert_allclose(results[0].T, estimates[0], rtol=0.0, atol=1e-5)
