"""Small random networks in ONNX form, and what ONNX Runtime computes of them."""

import json

import numpy as np
import pytest

onnx = pytest.importorskip("onnx", reason="onnx is not installed: pip install 'tickwork[test]'")
onnxruntime = pytest.importorskip("onnxruntime", reason="ONNX Runtime is not installed: pip install 'tickwork[test]'")

from onnx import TensorProto, helper, numpy_helper  # noqa: E402

from diagrams.networks import export  # noqa: E402

METADATA = {
    "channels": [
        {"name": "hip_angle", "unit": "rad", "mean": 0.2, "std": 0.4},
        {"name": "hip_velocity", "unit": "rad/s", "mean": -0.1, "std": 2.5},
        {"name": "mass", "unit": "kg", "mean": 70.0, "std": 12.0},
    ],
    "outputs": [
        {"name": "hip_torque", "unit": "N·m/kg", "range": [-0.5, 0.8], "mean": 0.1, "std": 0.7},
        {"name": "effort", "unit": "1"},
    ],
}


def save(path, nodes, inputs, outputs, constants=(), metadata=METADATA, dtype=TensorProto.FLOAT):
    """Write a model, and return its path as text. inputs, outputs, constants : {name: shape or array}"""

    def ports(shapes):
        return [helper.make_tensor_value_info(name, dtype, shape) for name, shape in shapes.items()]

    weights = [numpy_helper.from_array(value, name) for name, value in dict(constants).items()]
    graph = helper.make_graph(nodes, "network", ports(inputs), ports(outputs), weights)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    if metadata is not None:
        helper.set_model_props(model, {"tickwork": metadata if isinstance(metadata, str) else json.dumps(metadata)})
    onnx.save(model, str(path))
    return str(path)


def window(path, channels=3, samples=8, results=2, *, seed=0, shape=None, time_first=False, metadata=METADATA):
    """A model of the last samples, tanh(W x + b). shape : of its input, (1, channels, samples) by default"""
    random = np.random.default_rng(seed)
    weights = random.normal(size=(channels * samples, results), scale=0.4).astype(np.float32)
    bias = random.normal(size=results, scale=0.4).astype(np.float32)
    shape = shape or ((1, samples, channels) if time_first else (1, channels, samples))
    nodes = [
        helper.make_node("Reshape", ["x", "flat"], ["row"]),
        helper.make_node("Gemm", ["row", "weights", "bias"], ["sum"]),
        helper.make_node("Tanh", ["sum"], ["y"]),
    ]
    constants = {"weights": weights, "bias": bias, "flat": np.array([1, channels * samples], np.int64)}
    return save(path, nodes, {"x": shape}, {"y": (1, results)}, constants, metadata)


WIDTH, TAPS = 6, 3  # of the streaming network


def streaming(path, *, seed=0, metadata=METADATA):
    """A streaming model: two convolutions over time, each with its last inputs as state."""
    nodes, weights = [], convolutions(seed)
    for layer, (source, _channels) in enumerate((("x", 3), ("h0", WIDTH))):
        nodes += [
            helper.make_node("Concat", [f"past{layer}", source], [f"all{layer}"], axis=2),
            helper.make_node("Slice", [f"all{layer}", "one", "end", "axis"], [f"past{layer}_next"]),
            helper.make_node("Conv", [f"all{layer}", f"w{layer}", f"b{layer}"], [f"c{layer}"]),
            helper.make_node("Tanh", [f"c{layer}"], [f"h{layer}"]),
        ]
    nodes += [helper.make_node("Flatten", ["h1"], ["y"])]
    constants = weights | {name: np.array([value], np.int64) for name, value in (("one", 1), ("end", 99), ("axis", 2))}
    states = {"past0": (1, 3, TAPS - 1), "past1": (1, WIDTH, TAPS - 1)}
    outputs = {"y": (1, 2)} | {f"{name}_next": shape for name, shape in states.items()}
    return save(path, nodes, {"x": (1, 3, 1), **states}, outputs, constants, metadata)


def convolution_window(path, *, seed=0, metadata=METADATA):
    """The same network as `streaming` of the same seed, over a window as long as its receptive field."""
    nodes = []
    for layer, source in enumerate(("x", "h0")):
        nodes += [
            helper.make_node("Conv", [source, f"w{layer}", f"b{layer}"], [f"c{layer}"]),
            helper.make_node("Tanh", [f"c{layer}"], [f"h{layer}"]),
        ]
    nodes += [helper.make_node("Flatten", ["h1"], ["y"])]
    return save(path, nodes, {"x": (1, 3, 2 * TAPS - 1)}, {"y": (1, 2)}, convolutions(seed), metadata)


TEMPORAL_CHANNELS, TEMPORAL_WIDTH, DILATIONS = 28, 80, (1, 2, 4, 8, 16, 32, 64)
RECEPTIVE_FIELD = 1 + (TAPS - 1) * sum(DILATIONS)


def temporal(path, *, window=False, seed=0):
    """A temporal convolutional network of 122,561 parameters: streaming, or over a window of its receptive field."""
    random = np.random.default_rng(seed)
    widths = [TEMPORAL_CHANNELS, *(TEMPORAL_WIDTH for _ in DILATIONS), 1]
    layers = [
        (
            random.normal(size=(outputs, inputs, taps), scale=(taps * inputs) ** -0.5).astype(np.float32),
            random.normal(size=outputs, scale=0.1).astype(np.float32),
        )
        for inputs, outputs, taps in zip(widths, widths[1:], (*(TAPS for _ in DILATIONS), 1))
    ]
    metadata = {
        "channels": [{"name": f"channel_{index}"} for index in range(TEMPORAL_CHANNELS)],
        "outputs": [{"name": "torque", "unit": "N·m/kg"}],
    }
    if not window:
        metadata["receptive_field"] = RECEPTIVE_FIELD
    made = export.model(layers, DILATIONS, metadata, RECEPTIVE_FIELD if window else 1)
    onnx.save(made, str(path))
    return str(path)


def slow(path, rounds, *, seed=0, metadata=METADATA, streams=False):
    """A model of one sample whose inference takes long: a loop of 100 x 100 products.

    streams : whether it has a state, its previous sample, which is added to the present one
    """
    random = np.random.default_rng(seed)
    square = random.normal(size=(100, 100), scale=0.1).astype(np.float32)
    value = helper.make_tensor_value_info
    body = helper.make_graph(
        [
            helper.make_node("MatMul", ["h_in", "square"], ["product"]),
            helper.make_node("Tanh", ["product"], ["h_out"]),
            helper.make_node("Identity", ["go"], ["go_out"]),
        ],
        "body",
        [value("k", TensorProto.INT64, []), value("go", TensorProto.BOOL, []), value("h_in", TensorProto.FLOAT, None)],
        [value("go_out", TensorProto.BOOL, []), value("h_out", TensorProto.FLOAT, None)],
    )
    nodes = [
        *(
            [helper.make_node("Add", ["x", "past"], ["sample"]), helper.make_node("Identity", ["x"], ["past_next"])]
            if streams
            else [helper.make_node("Identity", ["x"], ["sample"])]
        ),
        helper.make_node("MatMul", ["sample", "spread"], ["row"]),
        helper.make_node("Add", ["row", "square"], ["h"]),
        helper.make_node("Loop", ["rounds", "", "h"], ["last"], body=body),
        helper.make_node("ReduceMean", ["last"], ["mean"], axes=[0], keepdims=1),
        helper.make_node("MatMul", ["mean", "gather"], ["part"]),
        helper.make_node("MatMul", ["sample", "through"], ["direct"]),
        helper.make_node("Add", ["part", "direct"], ["y"]),
    ]
    constants = {
        "spread": random.normal(size=(3, 100)).astype(np.float32),
        "square": square,
        "rounds": np.array(rounds, np.int64),
        "gather": random.normal(size=(100, 2), scale=0.01).astype(np.float32),
        "through": random.normal(size=(3, 2), scale=0.1).astype(np.float32),
    }
    inputs, outputs = {"x": (1, 3)}, {"y": (1, 2)}
    if streams:
        inputs, outputs = inputs | {"past": (1, 3)}, outputs | {"past_next": (1, 3)}
    return save(path, nodes, inputs, outputs, constants, metadata)


def failing(path, metadata=METADATA):
    """A model whose inference fails once the first channel is above 1: an index outside its table."""
    nodes = [
        helper.make_node("Slice", ["x", "zero", "one", "axis"], ["first"]),
        helper.make_node("Cast", ["first"], ["index"], to=TensorProto.INT64),
        helper.make_node("Gather", ["table", "index"], ["found"], axis=0),
        helper.make_node("Reshape", ["found", "shape"], ["y"]),
    ]
    constants = {name: np.array([value], np.int64) for name, value in (("zero", 0), ("one", 1), ("axis", 1))}
    constants |= {"table": np.zeros((2, 2), np.float32), "shape": np.array([1, 2], np.int64)}
    return save(path, nodes, {"x": (1, 3)}, {"y": (1, 2)}, constants, metadata)


def convolutions(seed):
    """Weights of both forms of the convolutional network."""
    random = np.random.default_rng(seed)
    shapes = {"w0": (WIDTH, 3, TAPS), "b0": (WIDTH,), "w1": (2, WIDTH, TAPS), "b1": (2,)}
    return {name: random.normal(size=shape, scale=0.5).astype(np.float32) for name, shape in shapes.items()}


def session(path):
    """A session of ONNX Runtime with one thread, as OnnxModel has."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    return onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])


def normalised(samples, metadata=METADATA):
    """Samples as the network receives them: float32, one row per channel."""
    scales = [(each.get("mean", 0.0), each.get("std", 1.0)) for each in metadata["channels"]]
    return np.array([(row - mean) / std for row, (mean, std) in zip(np.transpose(samples), scales)], np.float32)


def scaled(results, metadata=METADATA):
    """Results of the network as outputs of the block."""
    outputs = []
    for y, each in zip(np.asarray(results, float).ravel().tolist(), metadata["outputs"]):
        low, high = each.get("range", (-np.inf, np.inf))
        outputs.append(min(max(y * each.get("std", 1.0) + each.get("mean", 0.0), low), high))
    return outputs
