"""What every block of the library keeps, whichever it is."""

import importlib
import inspect
import math
import pkgutil

import pytest

import blocks
from graph import Block, Device, DiagramError, Sink
from graph.conformance import check_block, check_declarations
from tests.blocks.examples import EXAMPLES, compile_spring
from tests.checkout import ROOT


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
def examples(request, recording, tmp_path_factory):
    if request.param == "Playback":
        return ({"file": recording, "column": "knee"},)
    if request.param == "OnnxModel":
        return ({"file": request.getfixturevalue("network")},)
    if request.param == "Compiled":
        file = compile_spring(tmp_path_factory.mktemp("compiled"))
        return ({"file": file, "takes": {"angle": "rad", "velocity": "rad/s"}, "gives": {"torque": "N·m"}},)
    if request.param == "Fmu":
        from tests.blocks import fmus

        file = fmus.make(tmp_path_factory.mktemp("fmu"), fmus.FMI2.replace('min="-40" max="40"', ""))
        takes, gives = {"knee.angle": "rad", "velocity": "rad/s"}, {"torque": "N·m", "error": "rad"}
        return ({"file": file, "takes": takes, "gives": gives},)
    if request.param == "MujocoBody":
        pytest.importorskip("mujoco")
        return ({"file": str(ROOT / "diagrams" / "examples" / "leg.xml")},)
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
    faulty = kind.always or name == "MujocoBody"  # a step of an emergency stop is a fault, and NaN in a body
    if issubclass(kind, (Device, Sink)) or faulty:
        for parameters in examples:
            check_declarations(kind, dict(parameters))
    else:
        assert check_block(kind, examples) > 0


@pytest.mark.parametrize("name, examples", [(name, name) for name in LIBRARY], indirect=["examples"])
def test_a_misspelt_parameter_is_refused_by_every_block(name, examples):
    with pytest.raises(DiagramError, match=f"{name}: has no parameter 'colour'"):
        LIBRARY[name](**{**examples[0], "colour": 1})
