"""What every block of the library keeps, whichever it is."""

import importlib
import inspect
import math
import pkgutil

import pytest

import blocks
from graph import Block, Device, DiagramError, Sink
from graph.conformance import check_block, check_declarations

# Parameters for blocks that have no usable defaults and no `examples`, and some with which every parameter of a block
# has its effect.
TAMED = {"kp": 2.0, "ki": 9.0, "lower": -1.0, "upper": 1.0, "anti_windup": "back-calculation"}
EXAMPLES = {
    "CubeMars": ({"model": "AK80-9"},),
    "EmulatedCubeMars": ({"model": "AK80-9"},),
    "EmulatedRobStride": ({"model": "RS03"},),
    "RobStride": tuple(
        {"model": "RS03", "mode": mode} for mode in ("operation", "position", "csp", "velocity", "current")
    ),
    "CubeMarsV3": ({"model": "AK80-9-V3.0"}, {"model": "AK80-8-V3.0", "limit": 8.0}),
    "EmulatedCubeMarsV3": ({"model": "AK80-8-V3.0"},),
    "CubeMarsServo": tuple(
        {"model": "AK80-9", "mode": mode}
        for mode in ("duty", "current", "current_brake", "velocity", "position", "position_velocity")
    ),
    "EmulatedCubeMarsServo": ({"model": "AK80-9"}, {"model": "AK80-9-V3.0"}),
    "RobStrideMIT": ({"model": "RS03"},),
    "EmulatedRobStrideMIT": ({"model": "RS03"},),
    "TorqueLimiter": ({"limit": 12.0}, {"limit": 12.0, "slew": 200.0}, {"limit": 1.5}),
    "PI": ({}, TAMED, TAMED | {"tracking_time": 0.2}),
    "PID": ({}, TAMED | {"kd": 0.1, "filter_time": 0.01, "c": 0.5}),
    "PD": ({}, {"kd": 0.1, "filter_time": 0.01, "c": 0.5}),
    "TorqueProfile": ({}, {"points": ((0.1, 3.0), (0.6, -8.0))}),
    "TorqueGate": ({}, {"mode": "damping"}, {"mode": "hold"}),
    "FeedForward": ({}, {"friction": 2.0}),
    "Limb": ({}, {"lower": 0.0}),
    "StepSource": ({"time": 0.1},),
    "Pulse": ({}, {"period": 0.1}),
    "TimeTable": ({}, {"times": (0.0, 0.1), "values": (0.0, 1.0)}),
    **{name: ({}, {"window": 0.05}) for name in ("MovingAverage", "MovingRMS", "MovingMaximum", "MovingMinimum")},
}


def library():
    """Every public block of the library, by name."""
    found = {}
    for module in pkgutil.walk_packages(blocks.__path__, "blocks."):
        for name, kind in vars(importlib.import_module(module.name)).items():
            if (
                inspect.isclass(kind)
                and issubclass(kind, Block)
                and kind.__module__ in (module.name, "graph.arithmetic")
                and not name.startswith("_")
                and not vars(kind).get("abstract")
            ):
                found[name] = kind
    return found


LIBRARY = library()


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """A file that a Playback plays."""
    file = tmp_path_factory.mktemp("recording") / "walk.csv"
    rows = (f"{k / 100},{30.0 - 25.0 * math.cos(2.0 * math.pi * k / 110)}" for k in range(1000))
    file.write_text("time,knee\n" + "\n".join(rows) + "\n")
    return str(file)


@pytest.fixture(scope="module")
def network(tmp_path_factory):
    """A file that an OnnxModel runs."""
    from tests.blocks.networks import models

    return models.streaming(tmp_path_factory.mktemp("network") / "network.onnx")


@pytest.fixture
def examples(request, recording):
    if request.param == "Playback":
        return ({"file": recording, "column": "knee"},)
    if request.param == "OnnxModel":
        return ({"file": request.getfixturevalue("network")},)
    return EXAMPLES.get(request.param) or getattr(LIBRARY[request.param], "examples", ({},))


def test_the_library_contains_the_blocks_of_the_exoskeletons():
    assert set(LIBRARY) >= {
        "Butterworth",
        "CsvRecorder",
        "CubeMars",
        "EmulatedCubeMars",
        "Gain",
        "GaitPhase",
        "Impedance",
        "Limb",
        "PlotJuggler",
        "Product",
        "Saturation",
        "Sine",
        "SlewRate",
        "StepSource",
        "Sum",
        "TorqueLimiter",
        "TorqueProfile",
        "UnitDelay",
    }


@pytest.mark.parametrize("name, examples", [(name, name) for name in LIBRARY], indirect=["examples"])
def test_a_block_passes_the_conformance_test(name, examples):
    kind = LIBRARY[name]
    if issubclass(kind, (Device, Sink)) or kind.always:  # a step of an emergency stop is a fault
        for parameters in examples:
            check_declarations(kind, dict(parameters))
    else:
        assert check_block(kind, examples) > 0


@pytest.mark.parametrize("name, examples", [(name, name) for name in LIBRARY], indirect=["examples"])
def test_a_misspelt_parameter_is_refused_by_every_block(name, examples):
    with pytest.raises(DiagramError, match=f"{name}: has no parameter 'colour'"):
        LIBRARY[name](**{**examples[0], "colour": 1})
