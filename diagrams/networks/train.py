"""Training of the networks on simulated trials.

    python -m diagrams.networks.train [NAME...]

writes NAME.onnx into this folder, of all networks by default. A network is a temporal convolution (Bai et al. 2018,
arXiv:1803.01271): seven causal convolutions of three taps, dilated by 1, 2, 4, ..., 64 samples and residual from the
second on, then a linear map. An output depends on the last 255 samples, 2.55 s. The seed is fixed: the same version of
JAX on the same kind of processor computes the same weights. Requires `pip install 'tickwork[train]'`.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from diagrams.networks import export
from diagrams.networks.trials import RATE, trial, varied
from runtime.host.replaced_file import write

os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false")  # sums in the same order everywhere

import jax  # noqa: E402  # pyright: ignore[reportMissingImports]
import jax.numpy as jnp  # noqa: E402  # pyright: ignore[reportMissingImports]

DILATIONS, TAPS, WIDTH = (1, 2, 4, 8, 16, 32, 64), 3, 16
RECEPTIVE_FIELD = 1 + (TAPS - 1) * sum(DILATIONS)  # samples
SEEDS = range(1000, 2000)  # of the trials
DURATION = 40.0  # s, of a trial
STEPS, BATCH, SPAN = 4000, 16, 512  # SPAN: outputs of each series of a batch
LEARNING_RATE = 4e-3  # at first; decays to 0 as a cosine
WARM_UP = 50  # steps

PORTS = {  # unit, description, range of an output
    "hip_angle": ("rad", "hip flexion, 0 in a straight stand"),
    "hip_velocity": ("rad/s", "velocity of hip flexion"),
    "opposite_hip_angle": ("rad", "hip flexion of the other leg"),
    "opposite_hip_velocity": ("rad/s", "velocity of hip flexion of the other leg"),
    "knee_angle": ("rad", "knee flexion, 0 in a straight stand"),
    "knee_velocity": ("rad/s", "velocity of knee flexion"),
    "phase_sin": ("1", "sine of the gait phase, 0 in standing", (-1.2, 1.2)),
    "phase_cos": ("1", "cosine of the gait phase, 0 in standing", (-1.2, 1.2)),
    "hip_torque": ("N·m/kg", "biological torque of the hip, positive in flexion", (-2.0, 2.0)),
    "knee_torque": ("N·m/kg", "biological torque of the knee, positive in flexion", (-1.2, 0.8)),
    "ankle_torque": ("N·m/kg", "biological torque of the ankle, positive in dorsiflexion", (-2.2, 0.3)),
}
HIPS = ("hip_angle", "hip_velocity", "opposite_hip_angle", "opposite_hip_velocity")
LEG = ("knee_angle", "knee_velocity", "hip_angle", "hip_velocity")
NETWORKS = {  # channels, outputs
    "gait_phase": (HIPS, ("phase_sin", "phase_cos")),
    "hip_torque": (HIPS, ("hip_torque",)),
    "knee_torque": (LEG, ("knee_torque",)),
    "ankle_torque": (LEG, ("ankle_torque",)),
}


def initial(random: np.random.Generator, channels: int, outputs: int) -> list[tuple[Any, Any]]:
    """Return weights, of shape (taps, inputs, outputs), and biases of each layer."""
    widths = [channels, *(WIDTH for _ in DILATIONS), outputs]
    taps = [*(TAPS for _ in DILATIONS), 1]
    shapes = list(zip(taps, widths, widths[1:]))
    return [(random.normal(0.0, (k * n) ** -0.5, (k, n, m)).astype("f"), np.zeros(m, "f")) for k, n, m in shapes]


def network(layers: Any, x: Any) -> Any:
    """Return (series, samples - RECEPTIVE_FIELD + 1, outputs) of x (series, samples, channels)."""
    for index, ((weights, biases), dilation) in enumerate(zip(layers, DILATIONS)):
        samples = x.shape[1] - (TAPS - 1) * dilation
        taps = jnp.concatenate([x[:, k * dilation : k * dilation + samples] for k in range(TAPS)], axis=2)
        y = taps @ weights.reshape(-1, WIDTH) + biases
        x = jax.nn.relu(y + x[:, -samples:] if index else y)
    weights, biases = layers[-1]
    return x @ weights[0] + biases


@jax.jit
def adam(layers: Any, moments: Any, count: float, rate: float, x: Any, y: Any) -> Any:
    """Return layers and moments after one step on the mean squared error. (Kingma and Ba 2015, arXiv:1412.6980)"""
    slopes = jax.grad(lambda each: jnp.mean((network(each, x) - y) ** 2))(layers)
    means = jax.tree.map(lambda m, g: 0.9 * m + 0.1 * g, moments[0], slopes)
    squares = jax.tree.map(lambda v, g: 0.999 * v + 0.001 * g * g, moments[1], slopes)
    rate = rate * jnp.sqrt(1.0 - 0.999**count) / (1.0 - 0.9**count)
    layers = jax.tree.map(lambda w, m, v: w - rate * m / (jnp.sqrt(v) + 1e-8), layers, means, squares)
    return layers, (means, squares)


def batches(random: np.random.Generator, x: np.ndarray, y: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield random pieces of the series x and y, (series, samples, channels or outputs)."""
    before = RECEPTIVE_FIELD - 1
    for _ in range(STEPS):
        places = [(random.integers(len(x)), random.integers(x.shape[1] - SPAN - before)) for _ in range(BATCH)]
        yield (
            np.stack([x[series, at : at + SPAN + before] for series, at in places]),
            np.stack([y[series, at + before : at + before + SPAN] for series, at in places]),
        )


def train(
    legs: Sequence[dict[str, np.ndarray]], channels: Sequence[str], outputs: Sequence[str]
) -> tuple[export.Layers, dict[str, Any]]:
    """Return the layers of a network and its metadata. legs : signals by name"""
    random = np.random.default_rng(0)
    x, channel_ports = normalised(legs, channels)
    y, output_ports = normalised(legs, outputs)
    layers: Any = initial(random, len(channels), len(outputs))
    moments = (jax.tree.map(np.zeros_like, layers),) * 2
    for count, batch in enumerate(batches(random, x, y), 1):
        rate = LEARNING_RATE * min(1.0, count / WARM_UP) * (0.5 + 0.5 * np.cos(np.pi * count / STEPS))
        layers, moments = adam(layers, moments, float(count), rate, *batch)
    weights = [(np.asarray(w).transpose(2, 1, 0), np.asarray(b)) for w, b in layers]
    ports = {"channels": channel_ports, "outputs": output_ports}
    return weights, ports | {"rate": RATE, "receptive_field": RECEPTIVE_FIELD}


def normalised(legs: Sequence[dict[str, np.ndarray]], names: Sequence[str]) -> tuple[np.ndarray, list[dict[str, Any]]]:
    """Return signals as (legs, samples, names), with mean 0 and deviation 1, and the metadata of their ports."""
    values = np.stack([np.stack([leg[name] for name in names], axis=-1) for leg in legs]).astype("f")
    mean, deviation = (moment.round(4) for moment in (values.mean((0, 1), float), values.std((0, 1), float)))
    ports = []
    for name, at, scale in zip(names, mean, deviation):
        port = dict(zip(("unit", "description", "range"), PORTS[name]))
        ports.append({"name": name, **port, "mean": float(at), "std": float(scale)})
    return ((values - mean) / deviation).astype("f"), ports


def main(names: Sequence[str]) -> None:
    """Train networks by name, and write their files."""
    for name in names:
        begin = time.monotonic()
        legs = [leg for seed in SEEDS for leg in (varied if name == "gait_phase" else trial)(seed, DURATION)]
        layers, metadata = train(legs, *NETWORKS[name])
        path = Path(__file__).with_name(f"{name}.onnx")
        write(path, export.model(layers, DILATIONS, metadata).SerializeToString())
        print(f"{path.name}: {path.stat().st_size / 1000:.0f} kB, {time.monotonic() - begin:.0f} s", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:] or tuple(NETWORKS))
