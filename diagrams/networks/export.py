"""ONNX form of the networks."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
from onnx import ModelProto, TensorProto, helper, numpy_helper

OPSET, IR_VERSION = 17, 8  # of ONNX Runtime 1.14 and later
Layers = Sequence[tuple[np.ndarray, np.ndarray]]  # weights of shape (outputs, inputs, taps), biases


def model(layers: Layers, dilations: Sequence[int], metadata: dict[str, Any], samples: int = 1) -> ModelProto:
    """Return a network of dilated convolutions: ReLU follows each but the last, all between are residual.

    samples : length of the input `x`, of shape (1, channels, samples). With 1 the network is a streaming one: its state
        `past_0` holds the samples that layer 0 has received, output `past_0_next` is its next value, and so on.
        Otherwise it is at least the receptive field R
    metadata : value of the key `tickwork`

    Output `y` has the shape (1, outputs, 1), or (1, outputs, samples - R + 1).
    """
    streaming = samples == 1
    constants: dict[str, Any] = {"time": np.array([2]), "end": np.array([2**31])}
    inputs, results = [tensor("x", layers[0][0].shape[1], samples)], []
    nodes, signal = [], "x"

    def newest(name: str, first: int, result: str) -> str:
        """Add a node that leaves out the samples before `first`."""
        constants[f"from_{first}"] = np.array([first])
        nodes.append(helper.make_node("Slice", [name, f"from_{first}", "end", "time"], [result]))
        return result

    for index, ((weights, biases), dilation) in enumerate(zip(layers, (*dilations, 1))):
        constants |= {f"weights_{index}": weights, f"biases_{index}": biases}
        present = received = signal
        reach = (weights.shape[2] - 1) * dilation
        if streaming and reach:
            past, received = f"past_{index}", f"received_{index}"
            nodes.append(helper.make_node("Concat", [past, signal], [received], axis=2))
            inputs.append(tensor(past, weights.shape[1], reach))
            results.append(tensor(newest(received, 1, f"{past}_next"), weights.shape[1], reach))
        samples -= 0 if streaming else reach
        last, residual = index == len(dilations), 0 < index < len(dilations)
        if residual and not streaming:
            present = newest(signal, reach, f"present_{index}")
        signal = "y" if last else f"layer_{index}"
        sums = [signal if last else f"weighted_{index}", f"sum_{index}"]
        parameters = [f"weights_{index}", f"biases_{index}"]
        nodes.append(helper.make_node("Conv", [received, *parameters], sums[:1], dilations=[dilation]))
        if residual:
            nodes.append(helper.make_node("Add", [present, sums[0]], [sums[1]]))
        if not last:
            nodes.append(helper.make_node("Relu", [sums[residual]], [signal]))
    results.insert(0, tensor("y", layers[-1][0].shape[0], samples))
    initializers = [numpy_helper.from_array(value, name) for name, value in constants.items()]
    graph = helper.make_graph(nodes, "network", inputs, results, initializers)
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION)
    helper.set_model_props(made, {"tickwork": json.dumps(metadata, ensure_ascii=False)})
    return made


def tensor(name: str, channels: int, samples: int) -> Any:
    """Return the declaration of an input or output."""
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, channels, samples])


def contents(made: ModelProto) -> tuple[Layers, list[int], dict[str, Any]]:
    """Return the layers, dilations and metadata of what `model` has made."""
    values = {each.name: numpy_helper.to_array(each) for each in made.graph.initializer}
    count = sum(name.startswith("weights_") for name in values)
    dilations = [node.attribute[0].ints[0] for node in made.graph.node if node.op_type == "Conv"]
    layers = [(values[f"weights_{index}"], values[f"biases_{index}"]) for index in range(count)]
    return layers, dilations[:-1], json.loads(made.metadata_props[0].value)
