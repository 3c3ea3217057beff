"""Names, ratings and limits of the CubeMars models, and what is refused."""

import math

import numpy as np
import pytest

from blocks.actuators import CubeMars, EmulatedCubeMars
from blocks.actuators.cubemars import models
from blocks.actuators.cubemars.models import AMBIGUOUS, MODELS, find
from blocks.actuators.sources import with_ranges
from graph import Diagram, DiagramError, Interval, compile
from tests.shared import specifications


@pytest.mark.parametrize("name", MODELS)
def test_model_lookup_ignores_case_and_punctuation(name):
    for spelling in (
        name,
        name.lower(),
        name.replace("-", " "),
        name.replace("-", "_"),
        name.replace("-", ""),
        f" {name} ",
    ):
        assert find(spelling) is MODELS[name]
        assert CubeMars(spelling).model == name


@pytest.mark.parametrize("short, full", AMBIGUOUS.items())
def test_a_name_of_two_generations_is_refused_and_both_are_named(short, full):
    for spelling in (short, short.lower()):
        with pytest.raises(
            DiagramError,
            match=rf"several generations.*CubeMarsV3\('{short}-V3\.0'\).*CubeMars\('{full}'\).*CubeMarsServo",
        ):
            CubeMars(spelling)


@pytest.mark.parametrize(
    "name",
    [
        "AK80-9 V3.0",
        "AK80-9-V3",
        "ak80-9_v3.0",
        "AK10-9 V3.0",
        "AK60-6 V3.0",
        "AK10-9-V3.2",
        "AK70-9",
        "AK60-39",
        "AK60-39 V3.0",
        "AKA10-9",
        "AKE60-8",
        "akh70-48",
    ],
)
def test_v3_boards_are_rejected_by_name(name):
    for block in (CubeMars, EmulatedCubeMars):
        with pytest.raises(DiagramError, match="whose protocol differs from V1 and V2: use CubeMarsV3"):
            block(name)


@pytest.mark.parametrize(
    "name, wanted",
    [
        ("AK80-90", "AK80-9"),
        ("AK-80-09", "AK80-9"),
        ("AK10-9 V1.1", "AK10-9-V2.0"),
        ("AK80-9-V1", "AK80-9"),
        ("AK80-6 V1", "AK80-6"),
        ("AK60-6 V2", "AK60-6-V1.1"),
        ("AK80-80", "AK80-64"),
        ("AK70-1O", "AK70-10"),
    ],
)
def test_a_misspelt_model_is_refused_with_a_suggestion_of_the_same_motor(name, wanted):
    with pytest.raises(DiagramError, match=rf"'{name}' is not a CubeMars model.*'{wanted}'"):
        CubeMars(name)


@pytest.mark.parametrize(
    "name, model",
    [
        ("AK10-9 V2", "AK10-9-V2.0"),
        ("AK60-6-V1", "AK60-6-V1.1"),
        ("CubeMars AK80-64", "AK80-64"),
        ("T-Motor AK80-9", "AK80-9"),
        ("TMotor AK10-9 V2.0", "AK10-9-V2.0"),
    ],
)
def test_spellings_of_vendors_and_papers_select_the_only_model_of_that_name(name, model):
    assert CubeMars(name).spec is MODELS[model]


@pytest.mark.parametrize("name", ["AK80-9-V2.0", "ak80-9 v2.0", "AK80-9 V2"])
def test_synonym_selects_the_model_of_the_table(name):
    assert CubeMars(name).spec is EmulatedCubeMars(name).spec is MODELS["AK80-9"]


def test_unknown_model_lists_all_models():
    for name in ("", "XM430", "motor"):
        with pytest.raises(DiagramError) as refused:
            CubeMars(name)
        assert all(model in str(refused.value) for model in MODELS)


def test_the_wire_ranges_are_those_of_the_specification():
    table = specifications("cubemars_mit_v1v2")
    assert (table["p_rad"], table["kp"], table["kd"]) == (models.POSITION, models.STIFFNESS, models.DAMPING)
    assert {AMBIGUOUS.get(name, name) for name in table["models"]} == set(MODELS)
    for name, row in table["models"].items():
        model = with_ranges(MODELS[AMBIGUOUS.get(name, name)], "manual" if name == "AK40-10" else "")
        assert model.wire_position == table["p_rad"]
        assert (model.wire_velocity, model.wire_torque) == (row["v_rad_s"], row["t_nm"]), name


def test_the_ratings_equal_the_specification():
    table = specifications("cubemars_ratings")["models"]
    for name, model in MODELS.items():
        row = table[name.replace("-V", " V")]
        assert (model.rated, model.peak, model.gear) == (row[0], row[1], row[7]), name


def test_rated_peak_and_encoded_torque_increase_and_are_separate_values():
    for model in MODELS.values():
        assert 0.0 < model.rated < model.peak <= model.wire_torque, model
    at_peak = [name for name, model in MODELS.items() if model.peak == model.wire_torque]
    assert at_peak == ["AK80-6", "AK80-9"], "the others' wires go on beyond their peak"


@pytest.mark.parametrize("name", MODELS)
def test_the_limit_is_rated_peak_or_a_torque_up_to_the_peak(name):
    model = MODELS[name]
    named, numbers = (("rated", model.rated), ("peak", model.peak)), (0.5, 1, np.float64(1.25), model.peak)
    for limit, torque in (*named, *((number, float(number)) for number in numbers)):
        drive = CubeMars(name, limit=limit)
        assert drive.command_limits()["torque_command"] == Interval(-torque, torque)
        assert drive.limits == (model.wire_position, model.wire_velocity, 500.0, 5.0, torque, torque, 1.0)
    assert CubeMars(name).command_limits() == CubeMars(name, limit="rated").command_limits()


@pytest.mark.parametrize(
    "limit, said",
    [
        (math.nextafter(18.0, 19.0), "at most the peak torque of AK80-9, 18 N·m"),
        (65.0, "at most the peak torque"),
        (0.0, "above 0"),
        (-9.0, "above 0"),
        (math.nan, "got nan"),
        (math.inf, "at most the peak torque"),
        ("Rated", "'rated', 'peak' or a torque"),
        ("9", "'rated', 'peak'"),
        (True, "'rated', 'peak' or a torque"),
        ([9.0], "'rated', 'peak' or a torque"),
        ("", "'rated', 'peak'"),
    ],
)
def test_invalid_limit_is_refused(limit, said):
    with pytest.raises(DiagramError, match=f"limit must be .*{said}"):
        CubeMars("AK80-9", limit=limit)


@pytest.mark.parametrize(
    "parameters, said",
    [
        ({"can_id": 0}, "can_id: must be at least 1, got 0"),
        ({"can_id": 256}, "can_id: must be at most 255, got 256"),
        ({"can_id": 1.5}, "can_id: expected a whole number"),
        ({"can_id": "one"}, "can_id: expected a number"),
        ({"invert": 1}, "invert: expected True or False"),
        ({"offset": 12.6}, "offset: must be at most 12.5 rad, got 12.6"),
        ({"offset": -13.0}, "offset: must be at least -12.5 rad"),
        ({"offset": math.nan}, "offset: NaN"),
        ({"offset": -math.inf}, "offset: must be"),
        ({"timeout": -0.1}, "timeout: must be at least 0.0 s"),
        ({"bus": 0}, "bus: expected text"),
        ({"model": 80}, "model: expected text"),
        ({"can": 1}, "has no parameter 'can'"),
    ],
)
def test_a_parameter_out_of_bounds_is_refused_with_its_name_value_and_bound(parameters, said):
    with pytest.raises(DiagramError, match=said) as refused:
        CubeMars(**{"model": "AK80-9", **parameters})
    assert "CubeMars" in str(refused.value) and __file__ in str(refused.value)


def test_model_is_required():
    with pytest.raises(DiagramError, match="model is missing"):
        CubeMars()


def refusals(**commands):
    with Diagram("refused", rate=200) as diagram:
        CubeMars("AK80-9", name="drive", offset=0.5)(**commands)
    with pytest.raises(DiagramError) as refused:
        compile(diagram)
    return str(refused.value)


def test_a_constant_beyond_a_limit_does_not_compile():
    """Rated torque for torque; the wire for the rest, the position's moved by the offset."""
    for name, within, beyond in (
        ("torque_command", 9.0, 9.001),
        ("position_command", -12.0, -12.001),
        ("velocity_command", 50.0, 50.1),
        ("stiffness_command", 500.0, -0.1),
        ("damping_command", 5.0, 5.1),
    ):
        with Diagram("allowed", rate=200) as diagram:
            CubeMars("AK80-9", name="drive", offset=0.5)(**{name: within})
        assert all(proof.holds for proof in compile(diagram).proofs)
        assert f"drive.{name}: {beyond:g} " in refusals(**{name: beyond})


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_constant_that_is_not_finite_does_not_compile(bad):
    assert f"drive.torque_command: {bad:g} N·m is unbounded" in refusals(torque_command=bad)


def test_two_drives_with_one_id_on_one_bus_do_not_compile():
    with Diagram("twins", rate=200) as diagram:
        for name in ("left", "right"):
            CubeMars("AK80-9", bus="legs", can_id=5, name=name)(torque_command=0.0)
    with pytest.raises(DiagramError, match="shares CAN id 5 on bus 'legs'"):
        compile(diagram)


def test_the_emulator_takes_the_parameters_of_its_drive():
    with Diagram("robot", rate=200):
        drive = CubeMars("ak10-9-v2.0", bus="legs", can_id=7, invert=True, offset=-0.3)
    with Diagram("plant", rate=1000):
        played = drive.emulator()
    assert isinstance(played, EmulatedCubeMars) and played.peak == MODELS["AK10-9-V2.0"].peak
    for name in ("bus", "can_id", "invert", "offset"):
        assert getattr(played, name) == getattr(drive, name)
    assert find(played.model) is drive.spec and tuple(played.wire) == tuple(drive.wire)
