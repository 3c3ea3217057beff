"""OnnxModel compared with ONNX Runtime itself, and its errors."""

import importlib.util
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from blocks.networks import OnnxModel
from blocks.sources import Sine
from graph import Diagram, Interval, subsystem
from graph.store import content_hash, describe
from tests.blocks.networks import models
from tests.blocks.running import inside, run
from tests.graph.complaints import complaints, refusal

TICKS = 24


def samples(seed=1, ticks=TICKS):
    """Values of the three channels, one row per tick."""
    return np.random.default_rng(seed).normal(size=(ticks, 3)) * (0.5, 3.0, 10.0) + (0.1, 0.0, 75.0)


def stepped(path, rows, **parameters):
    """Outputs of an OnnxModel by its own steps: (values of the results, values of `valid`)."""
    block = OnnxModel(path, **parameters)
    outputs = [block.step(*row) for row in rows]
    return [list(each[:2]) for each in outputs], [each[2] for each in outputs]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    "time_first, shape", [(False, None), (True, None), (False, (3, 8)), (True, (8, 3)), (False, ("batch", 3, 8))]
)
def test_a_window_model_equals_onnx_runtime_bit_for_bit(tmp_path, seed, time_first, shape):
    path = models.window(tmp_path / "m.onnx", seed=seed, time_first=time_first, shape=shape)
    rows = samples(seed)
    layout = "time, channels" if time_first else "channels, time"
    values, valid = stepped(path, rows, layout=layout)
    reference, x = models.session(path), models.normalised(rows)
    shape = tuple(1 if length == "batch" else length for length in shape or ((1, 8, 3) if time_first else (1, 3, 8)))
    for k in range(TICKS):
        assert valid[k] == (k >= 7)
        if valid[k]:
            sliding = x[:, k - 7 : k + 1]
            [y] = reference.run(None, {"x": np.ascontiguousarray(sliding.T if time_first else sliding).reshape(shape)})
            assert values[k] == models.scaled(y)
        else:
            assert values[k] == [0.0, 0.0]


def test_a_network_of_one_sample_is_valid_at_once(tmp_path):
    path = models.window(tmp_path / "m.onnx", samples=1, shape=(1, 3))
    rows = samples()
    values, valid = stepped(path, rows)
    assert all(valid)
    for row, x in zip(values, models.normalised(rows).T):
        assert row == models.scaled(models.session(path).run(None, {"x": x[None]}))


@pytest.mark.parametrize("seed", range(3))
def test_a_streaming_model_equals_onnx_runtime_bit_for_bit(tmp_path, seed):
    path = models.streaming(tmp_path / "m.onnx", seed=seed, metadata=models.METADATA | {"receptive_field": 5})
    rows = samples(seed)
    values, valid = stepped(path, rows)
    reference = models.session(path)
    states = {"past0": np.zeros((1, 3, 2), np.float32), "past1": np.zeros((1, models.WIDTH, 2), np.float32)}
    for k, x in enumerate(models.normalised(rows).T):
        y, *following = reference.run(["y", "past0_next", "past1_next"], {"x": x.reshape(1, 3, 1), **states})
        states = dict(zip(states, following))
        assert valid[k] == (k >= 4)
        assert values[k] == (models.scaled(y) if valid[k] else [0.0, 0.0])


def test_a_streaming_model_equals_its_window_model(tmp_path):
    metadata = models.METADATA | {"receptive_field": 2 * models.TAPS - 1}
    streamed, valid = stepped(models.streaming(tmp_path / "s.onnx", metadata=metadata), samples())
    windowed, also_valid = stepped(models.convolution_window(tmp_path / "w.onnx", metadata=metadata), samples())
    assert valid == also_valid
    np.testing.assert_allclose(streamed, windowed, rtol=0.0, atol=1e-6)  # float32 rounding, of |y| < 1


@pytest.mark.soak
def test_a_streaming_network_of_122_561_parameters_equals_its_window_network(tmp_path):
    rows = np.random.default_rng(1).normal(size=(models.RECEPTIVE_FIELD + 5, models.TEMPORAL_CHANNELS))
    streaming = OnnxModel(models.temporal(tmp_path / "s.onnx"))
    window = OnnxModel(models.temporal(tmp_path / "w.onnx", window=True))
    results = [(streaming.step(*row)[:2], window.step(*row)[:2]) for row in rows]
    streamed, windowed = np.array(results[models.RECEPTIVE_FIELD - 1 :])[:, :, 0].T
    assert all(both[0][1] == both[1][1] == (k >= models.RECEPTIVE_FIELD - 1) for k, both in enumerate(results))
    # float32 rounding: ONNX Runtime adds the same products in another order
    assert np.abs(streamed - windowed).max() < 16 * np.finfo(np.float32).eps * np.abs(windowed).max()
    assert np.ptp(windowed) > 0.1


def test_results_in_several_tensors_and_states_in_any_order_are_found_by_name(tmp_path):
    node = models.helper.make_node
    nodes = [
        node("Add", ["h", "x"], ["h_next"]),
        node("ReduceSum", ["h_next"], ["torque"], keepdims=0),
        node("ReduceMax", ["x"], ["effort"], keepdims=1),
    ]
    outputs = {"h_next": (1, 3), "torque": (), "effort": (1, 1)}
    path = models.save(tmp_path / "m.onnx", nodes, {"h": (1, 3), "x": (1, 3)}, outputs)
    rows = samples() - (0.0, 0.0, 74.0)
    values, valid = stepped(path, rows)
    reference, state = models.session(path), np.zeros((1, 3), np.float32)
    for row, x in zip(values, models.normalised(rows).T):
        state, torque, effort = reference.run(None, {"h": state, "x": x[None]})
        assert row == models.scaled([torque, effort[0, 0]])
    assert all(valid)


def test_a_range_without_0_starts_at_the_end_nearest_to_0(tmp_path):
    outputs = [{"name": "torque", "range": [0.2, 0.8]}, {"name": "effort", "range": [-3, -1]}]
    path = models.window(tmp_path / "m.onnx", metadata=models.METADATA | {"outputs": outputs})
    values, _ = stepped(path, samples(ticks=3))
    assert values == [[0.2, -1.0]] * 3


def test_nan_passes_and_infinity_is_not_clipped(tmp_path):
    path = models.window(tmp_path / "m.onnx", samples=1)
    assert all(math.isnan(y) for y in OnnxModel(path).step(math.nan, 0.0, 0.0)[:2])
    node = models.helper.make_node("Flatten", ["x"], ["y"])
    outputs = [{"name": name, "range": [-1, 1]} for name in ("a", "b", "c")]
    path = models.save(
        tmp_path / "i.onnx", [node], {"x": (1, 3)}, {"y": (1, 3)}, metadata=models.METADATA | {"outputs": outputs}
    )
    assert all(math.isnan(y) for y in OnnxModel(path).step(math.inf, -math.inf, math.nan)[:3])


@pytest.mark.parametrize("value", [math.inf, -math.inf, 1e300])
@pytest.mark.parametrize("place", ["tick", "worker"])
def test_an_infinite_channel_gives_nan_although_the_network_saturates(tmp_path, value, place):
    """1e300 is infinite in single precision. The samples after it are finite again."""
    path = models.window(tmp_path / "m.onnx", samples=1)
    rows = np.zeros((4, 3))
    rows[1, 1] = value
    given = inside(
        lambda: OnnxModel(path, **({"run": place, "latency": 0.005} if place == "worker" else {})),
        **{name: rows[:, k] for k, name in enumerate(("hip_angle", "hip_velocity", "mass"))},
    )
    at = 1 + (place == "worker")
    for name in ("hip_torque", "effort"):
        assert math.isnan(given[name][at]) and math.isfinite(given[name][at + 1])


def test_parameters_replace_the_metadata(tmp_path):
    path = models.window(tmp_path / "m.onnx", samples=1, metadata=None)
    block = OnnxModel(
        path, channels=tuple(models.METADATA["channels"]), results=({"name": "a", "unit": "N·m"}, {"name": "b"})
    )
    assert {name: port.unit for name, port in block.inputs.items()}["hip_velocity"] == "rad/s"
    assert [port.unit for port in block.outputs.values()][:2] == ["N·m", "1"]


def diagram_of(path, rate=200.0, **parameters):
    """A diagram with two models of one file, of different signals."""
    with Diagram("robot", rate=rate) as diagram:
        for index in range(2):
            network = OnnxModel(path, name=f"network{index}", **parameters)
            angle = Sine(frequency=1.0 + index, unit="rad", name=f"angle{index}")()
            network(hip_angle=angle, hip_velocity=Sine(unit="rad/s", name=f"velocity{index}")(), mass=70.0)
    return diagram


def test_two_models_of_one_file_keep_separate_states_and_repeat_after_a_reset(tmp_path):
    path = models.streaming(tmp_path / "m.onnx")
    first, again = (run(diagram_of(path), 100) for _ in range(2))
    for name in ("network0.hip_torque", "network1.effort"):
        np.testing.assert_array_equal(first[name], again[name])
    values, _ = stepped(path, [(first["angle1.y"][k], first["velocity1.y"][k], 70.0) for k in range(100)])
    np.testing.assert_array_equal(np.transpose(values)[0], first["network1.hip_torque"])
    assert np.ptp(first["network0.hip_torque"] - first["network1.hip_torque"]) > 0.1


def test_a_model_runs_at_the_rate_of_its_file(tmp_path):
    path = models.window(tmp_path / "m.onnx", samples=4, metadata=models.METADATA | {"rate": 100})
    valid = run(diagram_of(path, rate=200.0), 12)["network0.valid"]
    assert valid.tolist() == [0] * 6 + [1] * 6
    with Diagram("robot", rate=600.0):
        assert OnnxModel(path).every == 6
        assert OnnxModel(path, every=2).every == 2
        assert OnnxModel(path, rate=300.0).every == 2
    with Diagram("robot", rate=250.0):
        problem = refusal(OnnxModel, path).message
    assert "has a sampling rate of 100 Hz" in problem and "use a rate such as 200 Hz" in problem
    with Diagram("robot", rate=400.0):
        with subsystem("slow", every=2):
            network = OnnxModel(path)
            network.set("rate", 50.0)
            assert (network.every, OnnxModel(path).every, OnnxModel(path, every=3).every) == (8, 4, 6)
        with subsystem("slower", every=8):
            assert "the rate of the diagram here, 50 Hz" in refusal(OnnxModel, path).message


def test_a_path_is_relative_to_the_folder_of_the_diagram_or_the_working_folder(tmp_path, monkeypatch):
    models.window(tmp_path / "m.onnx")
    assert refusal(OnnxModel, "m.onnx").message.startswith("file: there is no m.onnx in ")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path)
        assert Path(OnnxModel("m.onnx").file).is_file()
    source = tmp_path / "robot.py"
    source.write_text("from blocks.networks import OnnxModel\nblock = OnnxModel('m.onnx')\n")
    namespace = {}
    exec(compile(source.read_text(), str(source), "exec"), namespace)
    assert namespace["block"].file == str(tmp_path / "m.onnx")


def test_the_content_of_the_file_enters_the_description_of_the_diagram(tmp_path):
    path = models.window(tmp_path / "m.onnx", seed=1)
    before = describe(diagram_of(path))["blocks"]
    models.window(tmp_path / "m.onnx", seed=2)
    after = describe(diagram_of(path))["blocks"]
    digests = [next(e for e in entries if e["path"] == "network0")["files"]["file"] for entries in (before, after)]
    assert digests[0] != digests[1] and all(each.startswith("sha256:") for each in digests)


def test_a_wire_of_another_unit_is_reported(tmp_path):
    path = models.window(tmp_path / "m.onnx")
    with Diagram("robot", rate=200.0) as diagram:
        OnnxModel(path)(hip_angle=Sine(unit="deg")(), hip_velocity=0.0, mass=70.0)
    assert [each.code for each in complaints(diagram) if each.severity == "error"] == ["TW002"]


def test_the_range_of_an_output_is_that_of_its_description(tmp_path):
    block = OnnxModel(models.window(tmp_path / "m.onnx"))
    assert block.outputs["hip_torque"].range == Interval(-0.5, 0.8) and block.outputs["effort"].range is None


def model_with(key, value):
    """Function that writes a model whose metadata has another value."""
    return lambda path: models.window(path, metadata=models.METADATA | {key: value})


def damaged(path):
    Path(models.window(path)).write_bytes(Path(path).read_bytes()[:100])


def pointer(path):
    Path(path).write_text("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 12\n")


def with_weights_beside(path):
    """As PyTorch exports it since version 2.9: weights in a second file."""
    models.window(path)
    model = models.onnx.load(path)
    models.onnx.save(model, path, save_as_external_data=True, location="weights.data", size_threshold=64)
    return path


def without_weights(path):
    with_weights_beside(path)
    Path(path).with_name("weights.data").unlink()


def numbered(opset=17, ir_version=9):
    def write(path):
        models.window(path)
        model = models.onnx.load(path)
        model.opset_import[0].version, model.ir_version = opset, ir_version
        Path(path).write_bytes(model.SerializeToString())

    return write


IDENTITY = models.helper.make_node("Identity", ["x"], ["y"])
MEAN = models.helper.make_node("ReduceMean", ["x"], ["y"], axes=[1], keepdims=0)
MEAN_OF_H = models.helper.make_node("ReduceMean", ["h"], ["h_next"], axes=[1], keepdims=1)
COPY = models.helper.make_node("Identity", ["h"], ["h_next"])
FAULTS = {
    "missing": (lambda path: None, "No such file or directory"),
    "damaged": (damaged, "is not an ONNX file, or is damaged"),
    "pointer": (
        pointer,
        "is a pointer of Git LFS and not the network: install git-lfs, and fetch it with `git lfs pull`",
    ),
    "weights elsewhere": (without_weights, "its weights are in weights.data, which is not beside it: copy both, or"),
    "new operators": (numbered(opset=99), "uses operators of opset 99, which ONNX Runtime 1."),
    "new format": (numbered(ir_version=99), "has version 99 of the ONNX format, which ONNX Runtime 1."),
    "metadata": (lambda path: models.window(path, metadata="{"), "the metadata of the file is not valid JSON"),
    "no description": (lambda path: models.window(path, metadata=None), "does not describe its inputs: pass channels="),
    "channels": (lambda path: models.window(path, channels=4), "input x has shape (1, 4, 8), but expected"),
    "results": (lambda path: models.window(path, results=3), "has 3 results (y (1, 3)), but 2 are described"),
    "time axis": (lambda path: models.window(path, shape=(1, 3, "time")), "has a dimension that varies, (1, 3, -1)"),
    "float64": (
        lambda path: models.save(path, [IDENTITY], {"x": (1, 3)}, {"y": (1, 3)}, dtype=models.TensorProto.DOUBLE),
        "input 'x' is not a tensor of float32",
    ),
    "two signals": (
        lambda path: models.save(path, [IDENTITY], {"x": (1, 3), "h": (1, 2)}, {"y": (1, 3)}),
        "expected one input without a next value, got x, h: a state NAME needs an output NAME_next",
    ),
    "state": (
        lambda path: models.save(
            path, [IDENTITY, MEAN_OF_H], {"x": (1, 2), "h": (1, 3)}, {"y": (1, 2), "h_next": (1, 1)}
        ),
        "state h has shape (1, 3), but h_next has (1, 1)",
    ),
    "samples of a stream": (
        lambda path: models.save(path, [MEAN, COPY], {"x": (1, 3, 2), "h": (3,)}, {"y": (1, 2), "h_next": (3,)}),
        "must have one sample, got 2",
    ),
    "no list": (model_with("channels", 5), "channels: expected a list of objects, got 5"),
    "no text": (model_with("channels", [{"name": "a", "unit": ["m"]}]), "channels: unit of a must be text, got ['m']"),
    "unknown key": (model_with("channels", [{"name": "a", "scale": 2}]), "channels: expected an object with name and"),
    "reserved name": (model_with("outputs", [{"name": "valid"}]), "'valid' cannot be the name of a port"),
    "zero std": (model_with("outputs", [{"name": "a", "std": 0}]), "outputs: std of a must be above 0, got 0"),
    "range": (model_with("outputs", [{"name": "a", "range": [2, 1]}]), "range of a must be [low, high], got [2, 1]"),
    "NaN": (model_with("channels", [{"name": "a", "mean": math.nan}]), "mean of a must be a finite number, got nan"),
    "same names": (model_with("outputs", [{"name": "mass"}, {"name": "b"}]), "two ports have the name 'mass'"),
    "unit": (model_with("channels", [{"name": "a", "unit": "furlong"}]), "furlong"),
}


def test_weights_in_a_second_file_are_loaded_and_are_part_of_the_diagram(tmp_path, monkeypatch):
    """From any working folder. The graph of the network computes as the one with its weights inside."""
    inside, beside = str(tmp_path / "inside.onnx"), with_weights_beside(str(tmp_path / "beside.onnx"))
    models.window(inside)
    monkeypatch.chdir("/")
    hashes = []
    for path in (inside, beside, beside):
        with Diagram("robot", rate=200.0) as diagram:
            OnnxModel(path, name="net")(hip_angle=0.3, hip_velocity=0.1, mass=80.0)
        hashes.append((content_hash(diagram), run(diagram, 12)["net.hip_torque"][-1]))
        data = bytearray((tmp_path / "weights.data").read_bytes())
        if path == beside:
            data[0] ^= 1
            (tmp_path / "weights.data").write_bytes(data)
    assert hashes[0][1] == hashes[1][1] and hashes[1][0] != hashes[2][0]


@pytest.mark.parametrize("fault", FAULTS)
def test_a_file_that_cannot_be_used_is_reported_with_its_problem(tmp_path, fault):
    write, text = FAULTS[fault]
    path = tmp_path / "m.onnx"
    write(str(path))
    message = refusal(OnnxModel, str(path)).message
    assert text in message and str(path) in message


def test_a_model_that_cannot_run_is_reported_before_the_run(tmp_path):
    node = models.helper.make_node("Reshape", ["x", "shape"], ["y"])
    shape = {"shape": np.array([2, 2], np.int64)}  # of three numbers
    path = models.save(tmp_path / "m.onnx", [node], {"x": (1, 3)}, {"y": (1, 2)}, shape)
    with Diagram("robot", rate=200.0) as diagram:
        OnnxModel(path)(hip_angle=0.0, hip_velocity=0.0, mass=70.0)
    [problem] = [each for each in complaints(diagram) if each.severity == "error"]
    assert problem.code == "TW010" and "an inference with zeros fails: " in problem.message


def test_an_unavailable_provider_is_reported_with_the_available_ones(tmp_path):
    message = refusal(OnnxModel, models.window(tmp_path / "m.onnx"), provider="tensorrt").message
    assert "provider 'tensorrt' is not part of the installed ONNX Runtime" in message
    assert "CPUExecutionProvider" in message


def test_a_missing_or_incomplete_onnx_runtime_is_reported_with_its_remedy(tmp_path, monkeypatch):
    from cext.kernels.networks.model import library

    for spec, text in (
        (None, "ONNX Runtime is not installed: pip install 'tickwork[networks]'"),
        (SimpleNamespace(submodule_search_locations=[str(tmp_path)]), "contains no library of ONNX Runtime"),
    ):
        monkeypatch.setattr(importlib.util, "find_spec", lambda name, spec=spec: spec)
        with pytest.raises(ValueError, match=text.replace("[", r"\[")):
            library()
