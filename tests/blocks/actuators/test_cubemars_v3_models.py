"""Names, ratings and wire tables of the CubeMars models with V3.0 boards, and what is refused."""

import math
from statistics import mean

import pytest

from blocks.actuators import CubeMars, CubeMarsServo, CubeMarsV3, EmulatedCubeMarsServo, EmulatedCubeMarsV3
from blocks.actuators.cubemars import models, models_v3
from blocks.actuators.cubemars.models_v3 import MODELS, find
from graph import DiagramError
from tests.shared import specifications

SMALL = ("AK40-10-V3.0", "AK45-10-V3.0", "AK45-36-V3.0")  # with the board AK48-2405
UNKNOWN_WIRE = ("AKA10-9", "AKA60-6")  # in servo mode, or with ranges as parameters


@pytest.mark.parametrize("name", MODELS)
def test_model_lookup_ignores_case_and_punctuation(name):
    for spelling in (
        name,
        name.lower(),
        name.replace("-", " "),
        name.replace("-V", " V"),
        name.replace("-", ""),
        f" {name} ",
    ):
        assert find(spelling) is MODELS[name]
        assert CubeMarsServo(spelling, limit=1.0).model == name
        assert name in UNKNOWN_WIRE or CubeMarsV3(spelling, limit=1.0).model == name
    assert find(f"{MODELS[name].motor}-V3.2") is MODELS[name]


@pytest.mark.parametrize("name", [model.motor for model in MODELS.values() if model.ambiguous])
def test_a_motor_of_several_generations_needs_the_boards_name(name):
    for block in (CubeMarsV3, EmulatedCubeMarsV3):
        said = rf"several generations.*label.*CubeMarsV3\('{name}-V3\.0'\).*CubeMars\('{name}.*CubeMarsServo"
        with pytest.raises(DiagramError, match=said):
            block(name)


@pytest.mark.parametrize(
    "name, said",
    [
        ("AKA10-9", "no source states wire_position, .*, wire_torque of AKA10-9.*use servo mode"),
        ("aka60-6 v3.0", "no source states wire_damping, wire_torque of AKA60-6"),
        ("AK80-64", r"generation V1 or V2: use CubeMars\('AK80-64'\), or CubeMarsServo"),
        ("AK10-9 V2.0", r"generation V1 or V2: use CubeMars\('AK10-9-V2\.0'\)"),
        ("AK80-9 V1.1", r"use CubeMars\('AK80-9'\)"),
        ("AK70-90", "is not a CubeMars model with a table of force control.*'AK70-9'"),
        ("AK80-64 V3.0", "is not a CubeMars model with a table"),
        ("XM430", "there are AK10-9-V3.0"),
    ],
)
def test_unsupported_model_is_refused_with_the_right_block(name, said):
    with pytest.raises(DiagramError, match=said):
        CubeMarsV3(name)


def test_blocks_of_servo_mode_accept_the_names_of_both_tables():
    for name in (*models.MODELS, *MODELS):
        wanted = (models.MODELS | MODELS)[name]
        assert models_v3.find_in_servo_mode(name) is wanted
    for name, constant in (("AK80-9", 0.945), ("AK80-9 V3", 0.5701)):
        assert CubeMarsServo(name).spec.torque_constant == pytest.approx(constant)
    assert EmulatedCubeMarsServo("AK80-9").board == (0.0, 0.0) and EmulatedCubeMarsServo("AK80-9 V3").board == (
        1.0,
        0.0,
    )


def test_the_wire_tables_are_those_of_the_specification():
    table = specifications("cubemars_v3_force")
    assert (table["p_rad"], table["kp"], table["kd"]) == (models_v3.POSITION, models.STIFFNESS, models.DAMPING)
    columns = ("v_rad_s", "t_nm", "kt_output_nm_per_a", "gear", "pole_pairs")
    assert set(MODELS) - {model.name for model in MODELS.values() if model.motor in table["models"]} == {
        *UNKNOWN_WIRE,
        *SMALL,
    }
    assert {name: [row[column] for column in columns] for name, row in table["models"].items()} == {
        model.motor: [model.wire_velocity, model.wire_torque, model.torque_constant, model.gear, model.pole_pairs]
        for model in MODELS.values()
        if model.motor in table["models"]
    }


def test_the_ratings_and_pole_pairs_are_those_of_the_specification():
    table = specifications("cubemars_ratings")["models"]
    for model in (*models.MODELS.values(), *MODELS.values()):
        if model.name in SMALL:  # the rating of the motor, which is in the table with its other board
            assert (model.rated, model.peak) == tuple(table[model.motor][:2])
            continue
        motor, generation = models.split(model.name)
        rows = [
            row
            for name, row in table.items()
            if models.split(name)[0] == motor
            and (model.generation == 3)
            == (models.split(name)[1].startswith("3") or name.startswith(("AKA", "AKE", "AKH")))
        ]
        if model.rated is None:
            assert not rows and model.rated_current is None and model.peak_current is None, "somebody has published it"
            continue
        [row] = rows
        if model.name == "AKH70-16":  # two copies of its page disagree; the lower peak is used
            row[1], row[3] = 78.0, 19.5
        assert (model.rated, model.peak, model.pole_pairs, model.gear) == (row[0], row[1], row[6], row[7]), model.name
        assert (model.rated_rms_current, model.peak_rms_current) == (row[2], row[3]), model.name


def test_product_page_currents_are_rms_and_constants_per_amplitude():
    """rated torque / Kt / √2 over the store's current: 0.975 on average, from 0.905 (AK10-9) to 1.089 (AK60-39).
    Without √2 it is 1.28 to 1.54.
    """
    rated = [model for model in MODELS.values() if model.rated_current and model.name not in UNKNOWN_WIRE]
    share = {
        model.name: model.rated / model.torque_constant / math.sqrt(2.0) / model.rated_rms_current for model in rated
    }
    assert len(share) == 10 and mean(share.values()) == pytest.approx(0.975, abs=0.005)
    assert all(value == pytest.approx(0.974, abs=0.12) for value in share.values()), share
    for model in rated:
        assert model.rated_current == pytest.approx(math.sqrt(2.0) * model.rated_rms_current, rel=1e-12)
        assert model.peak_current == pytest.approx(math.sqrt(2.0) * model.peak_rms_current, rel=1e-12)
        peak = model.peak / model.torque_constant / model.peak_current
        assert peak == pytest.approx(0.91, abs=0.1), model.name


def test_the_torque_constant_of_boards_v1_and_v2_is_per_rms_ampere():
    """Without √2 rated torque / Kt over the store's current is 0.92 on average, from 0.79 (AK80-64) to 1.01 (AK45-36):
    the kind of both is the same. The assumed constant of an AK80-6 fits.
    """
    share = {
        model.name: model.rated / model.torque_constant / model.rated_rms_current for model in models.MODELS.values()
    }
    assert len(share) == 10 and mean(share.values()) == pytest.approx(0.92, abs=0.01)
    assert all(value == pytest.approx(0.9, abs=0.12) for value in share.values()), share


@pytest.mark.parametrize("name", MODELS)
def test_the_limit_is_rated_peak_or_a_torque_within_the_encoded_range(name):
    model = MODELS[name]
    if name in UNKNOWN_WIRE:
        return
    if model.rated is None:
        for limit in ("rated", "peak", True, None):
            with pytest.raises(DiagramError, match="not published: pass limit= in N·m"):
                CubeMarsV3(name, limit=limit)
        for limit in (0.0, -1.0, model.wire_torque * 1.001, float("nan"), float("inf")):
            with pytest.raises(DiagramError, match="limit must be above 0 and within the range"):
                CubeMarsV3(name, limit=limit)
        one = CubeMarsV3(name, limit=7.5)
        assert one.command_limits()["torque_command"].high == one.watched().rated == 7.5
        return
    for limit, torque in (("rated", model.rated), ("peak", min(model.peak, model.wire_torque)), (0.5, 0.5)):
        one = CubeMarsV3(name, limit=limit)
        assert one.command_limits()["torque_command"].high == torque and one.watched().rated == model.rated
    with pytest.raises(DiagramError, match="at most the peak torque"):
        CubeMarsV3(name, limit=model.peak * 1.001)


def test_errors_of_the_three_blocks_refer_to_each_other():
    with pytest.raises(DiagramError, match="use CubeMarsV3, or CubeMarsServo in servo mode"):
        CubeMars("AK80-9 V3.0")


@pytest.mark.parametrize(
    "parameters, said",
    [
        ({"report_rate": 501.0}, "report_rate: must be at most 500"),
        ({"report_rate": 10.0}, "shorter than two reports at report_rate 10 Hz"),
        ({"stop_damping": 6.0}, "stop_damping must be at most"),
        ({"enter": 1}, "enter: expected True or False"),
    ],
)
def test_a_parameter_out_of_bounds_is_refused(parameters, said):
    with pytest.raises(DiagramError, match=said):
        CubeMarsV3("AK70-9", **parameters)


@pytest.mark.hazard("H1h")
def test_force_control_with_unstated_ranges_needs_those_of_the_unit_and_their_acceptance():
    with pytest.raises(DiagramError, match="no source states wire_torque of AKA60-6"):
        CubeMarsV3("AKA60-6", wire_damping=5.0)
    drive = CubeMarsV3("AKA60-6", wire_damping=5.0, wire_torque=15.0)
    assert [(each.parameter, each.safe) for each in drive.deviations()] == [("wire_torque", False)]
    assert drive.assumptions() == []


def test_servo_mode_reads_and_commands_the_aka_models_by_their_own_constant():
    drive = CubeMarsServo("AKA60-6")
    assert drive.torque_limit == 3.0 and drive.current_limit == pytest.approx(3.0 / 0.625)
    assert drive.assumptions() == [] and CubeMarsServo("AKA10-9").assumptions() == []
    turning = CubeMarsServo("AKA10-9", pole_pairs=21)
    assert turning.scales[1] == pytest.approx(CubeMarsServo("AKA10-9").scales[1] * 14 / 21)
    assert [each.parameter for each in turning.deviations()] == ["model"]
