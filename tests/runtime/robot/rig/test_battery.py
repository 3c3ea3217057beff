"""[battery] of a rig: its keys, the currents of the drives, and what does not fit."""

import math

import pytest

from blocks.actuators import CubeMars, CubeMarsServo, CubeMarsV3, RobStride
from blocks.actuators.cubemars import models, models_v3
from blocks.families import families, find_model
from cext.kernels import no_io
from graph import Actuator, Diagram, DiagramError, Input, Output
from runtime.robot.rig.battery import Battery, continuous_current, require_supply, supply_current, windings
from runtime.robot.rig.errors import RigError
from runtime.robot.rig.file import parse
from runtime.session.check.battery import overloads, peak_current


def accepts(drive, name):
    try:
        return drive.find(name).name == name
    except ValueError:
        return False


TABLE = "[battery]\nvoltage = 24.0\ncapacity = 4\n"


EVERY_MODEL = [
    (drive.block, name)
    for family in families()
    for drive in family.drives
    for table in family.tables
    for name in table.models
    if accepts(drive, name) and not (drive.block is CubeMarsV3 and name.startswith("AKA"))  # ranges unknown
]


class Winch(Actuator):
    """A motor of a laboratory, of which nothing is known."""

    torque_command = Input("N·m", "torque", default=0.0)
    temperature = Output("°C", "of the motor")
    decode, encode = no_io.ignore_all, no_io.send_nothing


def robot(actuator, *arguments, **keywords):
    with Diagram("robot", rate=200) as diagram:
        actuator(*arguments, name="knee", **keywords)
    return diagram


def test_battery_is_read_with_its_defaults():
    battery = parse("lab.toml", TABLE + "max_current = 40\nfuse = 20.0\nload = 15.0\n").battery
    assert battery == Battery(24.0, 4, 24.0, 40, 20.0, 15.0)
    assert battery.energy == 96.0 and battery.load_current == 0.625
    assert parse("lab.toml", TABLE).battery == Battery(24.0, 4, 24.0)
    assert parse("lab.toml", "").battery is None


@pytest.mark.parametrize(
    "text, message, hint",
    [
        ("[battery]\nvoltage = 24.0", "[battery] capacity is missing", "write capacity = 24.0, its capacity in A·h"),
        (TABLE + 'fuse = "20 A"', "[battery] fuse = '20 A': expected a number above 0, in A", "write the fuse of each"),
        (
            TABLE + "load = true",
            "[battery] load = True: expected a number above 0, in W",
            "write the computer, sensors",
        ),
        (TABLE + "fuse = -1", "[battery] fuse = -1: expected a number above 0, in A", "write the fuse"),
        (TABLE + "fuze = 20.0", "[battery] fuze: unknown key", "did you mean 'fuse'?"),
        (TABLE + "full_voltage = 20", "[battery] full_voltage is below voltage", "write the voltage of the fully"),
        ("battery = 24.0", "[battery] = 24.0: expected a table", "write [battery], followed by its keys"),
    ],
)
def test_wrong_battery_is_an_error(text, message, hint):
    with pytest.raises(RigError) as caught:
        parse("lab.toml", text)
    [problem] = caught.value.problems
    assert problem.code == "TW102" and problem.message == message and problem.hint.startswith(hint)


def test_current_at_the_rated_torque_is_at_least_the_rated_current_of_every_model():
    tried = set()
    for drive in (drive for family in families() for drive in family.drives):
        for model in (model for family in families() for table in family.tables for model in table.models.values()):
            try:
                diagram = robot(drive.block, model.name)
            except DiagramError:  # a model of another block, or without a rating
                continue
            winding = windings(diagram)["knee"]
            assert winding.rated == model.rated
            if drive.block is not CubeMarsServo:
                assert winding.current >= 0.999 * (model.rated_current or 0.0)
            tried.add(model.name)
    assert len(tried) == 35  # of 36: the rated torque of an AK80-8 V3.0 is not published


def test_currents_of_an_ak10_9():
    # 48 N·m at 29.8 A RMS of the product page is the larger of its two ratios
    winding = windings(robot(CubeMars, "AK10-9-V2.0", limit=12.0))["knee"]
    assert winding.current == pytest.approx(12.0 / 48.0 * 29.8 * math.sqrt(2.0))
    assert supply_current(winding) == pytest.approx(math.sqrt(3.0) / 2.0 * winding.current)
    assert continuous_current(winding) == supply_current(winding)
    peak = windings(robot(CubeMars, "AK10-9-V2.0", limit="peak"))["knee"]
    assert continuous_current(peak) == pytest.approx(supply_current(peak) * 18.0 / 48.0)


def test_gear_behind_the_motor_changes_torque_and_not_current():
    direct = windings(robot(CubeMars, "AK80-9"))["knee"]
    geared = windings(robot(CubeMars, "AK80-9", gear_ratio=2.0))["knee"]
    assert geared.limit == 2.0 * direct.limit and geared.current == pytest.approx(direct.current)


def test_proved_torque_below_the_limit_lowers_the_current():
    diagram = robot(CubeMars, "AK80-9")
    half = windings(diagram, {"knee": 4.5})["knee"]
    assert half.limit == 4.5 and half.current == pytest.approx(0.5 * windings(diagram)["knee"].current)
    assert windings(diagram, {"knee": 90.0}) == windings(diagram)


def test_servo_mode_without_a_bound_of_torque_has_the_peak_current():
    winding = windings(robot(CubeMarsServo, "AK80-9", mode="velocity"))["knee"]
    assert winding.limit is None and winding.current == pytest.approx(math.sqrt(2.0) * 22.3)


def test_servo_mode_with_a_bound_of_torque_has_the_current_that_is_commanded():
    diagram = robot(CubeMarsServo, "AK80-9-V3.0", limit=5.701)
    assert windings(diagram)["knee"].current == diagram["knee"].current_limit == pytest.approx(10.0)


def test_model_without_ratings_has_the_current_of_its_torque_constant():
    winding = windings(robot(CubeMarsV3, "AK80-8-V3.0", limit=10.0))["knee"]
    assert winding.rated is None and winding.current == pytest.approx(10.0 / 1.0569)


@pytest.mark.hazard("H10c")
def test_fuse_and_battery_that_are_too_small_are_reported():
    drives = windings(robot(CubeMars, "AK10-9-V2.0", limit="peak"))
    current = supply_current(drives["knee"])
    generous = Battery(24.0, 4.0, 24.0, max_current=current + 1.1, fuse=current + 0.1, load=24.0)
    assert list(overloads(generous, drives)) == []
    assert peak_current(generous, drives) == pytest.approx(current + 1.0)
    problems = list(overloads(Battery(24.0, 4.0, 24.0, max_current=30.0, fuse=20.0), drives))
    assert [problem.code for problem in problems] == ["TW137", "TW137"]
    assert problems[0].message == "knee takes up to 36.5 A at its limit, and its fuse is rated 20 A"
    assert problems[1].message == "the drives and the load take up to 36.5 A, and the battery delivers 30 A"


def test_supply_below_the_range_of_a_drive_is_reported():
    [problem] = overloads(Battery(22.2, 4.0, 25.2), windings(robot(RobStride, "RS03")))
    assert problem.message == "[battery] of 22.2 V is below the supply range of knee, 24 to 60 V"


@pytest.mark.hazard("H14a")
@pytest.mark.parametrize("full, fits", [("28.0", True), ("29.4", False)])
def test_battery_that_would_damage_a_drive_is_rejected(full, fits):
    rig = parse("lab.toml", TABLE + f"full_voltage = {full}\n")
    diagram = robot(RobStride, "CyberGear")
    if fits:
        return require_supply(rig.battery, diagram, rig.path)
    with pytest.raises(RigError, match=r"TW137 .*: \[battery\] of up to 29.4 V exceeds the supply range of knee, 16"):
        require_supply(rig.battery, diagram, rig.path)
    return None


@pytest.mark.hazard("H14a")
@pytest.mark.parametrize("block, name", EVERY_MODEL)
def test_no_drive_survives_a_battery_of_100_volts(block, name):
    diagram = robot(block, name, limit=1.0)
    with pytest.raises(RigError, match=r"100.8 V exceeds the supply range of knee"):
        require_supply(Battery(96.0, 4.0, 100.8), diagram, "lab.toml")


@pytest.mark.parametrize(
    "name, supply",
    [
        *(
            (name, (18.0, 52.0))
            for name in ("AK10-9-V2.0", "AK70-10", "AK80-6", "AK80-8", "AK80-9", "AK80-64", *models_v3.MODELS)
            if not name.startswith("AK4")
        ),
        *((name, (18.0, 28.0)) for name in ("AK40-10", "AK45-10", "AK45-36", "AK60-6-V1.1")),
    ],
)
def test_supply_of_a_cubemars_is_that_of_its_board(name, supply):
    assert find_model(name)[1].supply == supply


def test_all_supplies_of_cubemars_are_stated():
    assert len(models.MODELS) + len(models_v3.MODELS) == 26


def test_an_assumed_supply_range_is_reported():
    [problem] = overloads(Battery(24.0, 4.0, 25.2), windings(robot(CubeMars, "AK40-10")))
    assert problem.code == "TW137"
    assert problem.message.startswith("the supply range of knee, 18 to 28 V, is assumed: no source states")


def test_unpublished_properties_never_count_as_fitting():
    drives = windings(robot(Winch))
    [supply] = overloads(Battery(24.0, 4.0, 25.2), drives)
    assert supply.message == "the supply range of knee is not published: [battery] of up to 25.2 V is not compared"
    for limits in ({"fuse": 20.0}, {"max_current": 40.0}):
        [_, current] = overloads(Battery(24.0, 4.0, 25.2, **limits), drives)
        assert current.message == "the current of knee is not known: fuse and max_current are not compared with it"
