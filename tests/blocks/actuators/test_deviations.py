"""Settings that scale the torque of an actuator are compared with the table of its model, however they were set."""

from dataclasses import replace

import pytest

from blocks.actuators import CubeMars, CubeMarsServo, CubeMarsV3, RobStride, RobStrideMIT, sources
from blocks.actuators.cubemars import models, models_v3
from blocks.actuators.robstride import mit
from blocks.actuators.robstride import models as robstride_models
from blocks.families import families
from graph import Diagram, DiagramError, Param, compile

TABLES = [
    (CubeMars, models.MODELS),
    (CubeMarsV3, {name for name in models_v3.MODELS if not name.startswith("AKA")}),
    (CubeMarsServo, models.MODELS | models_v3.MODELS),
    (RobStride, robstride_models.MODELS),
    (RobStrideMIT, {name for name in robstride_models.MIT_FIRMWARE if name not in mit.DIFFERENT}),
]
WIRE = ("position", "velocity", "stiffness", "damping", "torque")


def found(drive):
    """{parameter: (factor, safe)} of the deviations of a drive."""
    return {each.parameter: (each.factor, each.safe) for each in drive.deviations()}


@pytest.mark.parametrize("kind, table", TABLES)
@pytest.mark.parametrize("gear_ratio", [1.0, 6.3])
def test_no_model_deviates_from_its_own_table(kind, table, gear_ratio):
    for name in table:
        assert found(kind(name, limit=1.0, gear_ratio=gear_ratio)) == {}, name


@pytest.mark.hazard("H1h")
@pytest.mark.parametrize("kind, model", [(CubeMars, "AK80-9"), (CubeMarsV3, "AK10-9-V3.0"), (RobStride, "RS02")])
@pytest.mark.parametrize("name", WIRE)
@pytest.mark.parametrize("share", [0.25, 2.0])
@pytest.mark.parametrize("gear_ratio", [1.0, 3.0])
def test_every_encoded_range_has_the_factor_of_the_table_over_it(kind, model, name, share, gear_ratio):
    own = share * getattr(kind(model).spec, f"wire_{name}")
    drive = kind(model, limit=1.0, gear_ratio=gear_ratio, **{f"wire_{name}": own})
    [deviation] = drive.deviations()
    assert (deviation.parameter, deviation.safe) == (f"wire_{name}", False)
    assert deviation.factor == pytest.approx(1.0 / share) and deviation.value == pytest.approx(own)
    assert deviation.table == pytest.approx(own / share) and drive.model in deviation.source


@pytest.mark.hazard("H1h")
@pytest.mark.parametrize(
    "model, effects",
    [
        ("RS02", ["1.33 times as fast"]),
        ("RS03", ["a stiffness gives 10 times its torque", "a damping gives 20 times its torque"]),
        ("RS04", ["0.838 times as far", "0.455 times as fast", "damping gives 20 times"]),
    ],
)
def test_a_drive_whose_manual_has_two_sets_of_ranges_must_state_its_own(model, effects):
    """No reply of an RS04 tells whether its damping is 20 times the commanded one, or a twentieth."""
    [deviation] = RobStrideMIT(model, gear_ratio=3.0).deviations()
    assert (deviation.parameter, deviation.safe) == ("ranges", False)
    assert all(effect in deviation.effect for effect in effects), deviation.effect
    assert "'mit' or 'private'" in deviation.effect
    private, mit_set = RobStrideMIT(model, ranges="private"), RobStrideMIT(model, ranges="mit")
    assert found(private) == found(mit_set) == {} and private.wire == RobStride(model).wire != mit_set.wire
    with pytest.raises(DiagramError, match="ranges of RS0. must be one of 'mit', 'private'; got 'manual'"):
        RobStrideMIT(model, ranges="manual")
    with pytest.raises(DiagramError, match="ranges of AK80-9 must be omitted: its sources agree"):
        CubeMars("AK80-9", ranges="manual")


def test_sources_that_differ_by_two_percent_need_no_statement():
    """AK40-10: firmware ± 12.56 rad and ± 45 rad/s, manual ± 12.5 rad and ± 45.5 rad/s."""
    assert CubeMars("AK40-10").wire[:2] == (12.56, 45.0) and CubeMars("AK40-10", ranges="manual").wire[:2] == (
        12.5,
        45.5,
    )
    assert found(CubeMars("AK40-10")) == found(CubeMars("AK40-10", ranges="manual")) == {}


def test_check_warns_of_a_limit_that_rests_on_an_assumed_number():
    def warnings(drive):
        with Diagram("robot", rate=200) as robot:
            drive()(current_command=0.5)
        return [str(each) for each in compile(robot).warnings if each.code == "TW035"]

    [warning] = warnings(lambda: CubeMarsServo("AK80-6"))
    assert "its limit rests on torque_constant, which is assumed: not published; that of an AK80-9" in warning
    assert (
        warnings(lambda: CubeMarsServo("AK80-6", torque_constant=0.7))
        == warnings(lambda: CubeMarsServo("AK80-9"))
        == []
    )


def test_every_number_of_every_table_has_a_source():
    for family in families():
        for table in family.tables if family.name in ("CubeMars", "RobStride") else ():
            for model in table.models.values():
                for column in (*sources.WIRES, "rated", "peak", "gear", "torque_constant", "rated_current", "supply"):
                    source = model.source(column)
                    assert source.kind in sources.KINDS and source.text, (model.name, column)


def test_the_value_of_the_table_is_no_deviation():
    assert found(CubeMars("AK10-9-V2.0", wire_torque=65.0, wire_position=12.5)) == {}
    assert found(CubeMarsServo("AK10-9-V3.0", torque_constant=1.3137)) == {}


def test_the_torque_at_a_smaller_wire_range_is_stated():
    [deviation] = CubeMars("AK10-9-V2.0", limit=9.0, wire_torque=9.0).deviations()
    assert deviation.effect == (
        "if that is correct, the drive gives 7.22 times the commanded torque, up to 65 N·m at the limit of 9 N·m"
    )


class OwnDefault(CubeMars):
    """AK10-9 of a laboratory with another firmware."""

    wire_torque = Param(9.0, "N·m", "half the encoded range of torque", min=0.0, fixed=True)


class OwnRanges(CubeMars):
    """AK10-9 of a laboratory that computes its ranges."""

    def at_joint(self, spec):
        return (*super().at_joint(spec)[:4], 9.0 * self.gear_ratio)


class OwnConfigure(CubeMars):
    """AK10-9 of a laboratory that sets the encoded ranges."""

    def configure(self):
        super().configure()
        self.wire = (*self.wire[:4], 9.0 * self.gear_ratio)


class OwnModels(CubeMars):
    """AK10-9 of a laboratory with its own table."""

    find = staticmethod(lambda name: replace(models.find(name), wire_torque=9.0))


@pytest.mark.parametrize("kind", [OwnDefault, OwnRanges, OwnConfigure, OwnModels])
@pytest.mark.parametrize("gear_ratio", [1.0, 2.0])
def test_a_subclass_with_its_own_ranges_deviates_from_the_table(kind, gear_ratio):
    drive = kind("AK10-9-V2.0", limit=9.0, gear_ratio=gear_ratio)
    assert found(drive) == {"wire_torque": (pytest.approx(65.0 / 9.0), False)}


def test_an_assigned_range_deviates():
    with Diagram("robot", rate=200) as robot:
        knee = CubeMars("AK10-9-V2.0", limit=9.0, name="knee")
        knee(torque_command=1.0)
        knee.wire_torque = 9.0
    schedule = compile(robot)
    [caveat] = schedule.caveats
    assert [warning.code for warning in schedule.warnings] == ["TW028"]
    assert caveat.name == "knee.wire_torque" and caveat.factor == pytest.approx(65.0 / 9.0)


class OtherRatings(CubeMars):
    """AK10-9 with other ratings."""

    find = staticmethod(lambda name: replace(models.find(name), rated=40.0, peak=90.0))


class Unlisted(CubeMars):
    """A model that the vendor does not list."""

    find = staticmethod(lambda name: replace(models.find("AK10-9-V2.0"), name=name, wire_torque=9.0))


def test_other_ratings_and_models_outside_the_table_are_deviations():
    [deviation] = OtherRatings("AK10-9-V2.0").deviations()
    assert (deviation.parameter, deviation.value, deviation.table) == (
        "model",
        "AK10-9-V2.0 with rated 40.0, peak 90.0",
        "rated 18.0, peak 48.0",
    )
    [deviation] = Unlisted("LAB-9").deviations()
    assert (deviation.parameter, deviation.table, deviation.safe) == ("model", "no such model", False)
    assert "CubeMars" in deviation.source


@pytest.mark.parametrize("mode", ["current", "current_brake"])
def test_a_torque_constant_that_differs_scales_the_torque_of_a_current(mode):
    drive = CubeMarsServo("AK10-9-V3.0", limit=5.0, torque_constant=0.3, mode=mode)
    [deviation] = drive.deviations()
    assert deviation.parameter == "torque_constant" and deviation.factor == pytest.approx(1.3137 / 0.3)
    most = drive.current_limit * 1.3137
    assert f"up to {most:.3g} N·m at the limit of 5 N·m" in deviation.effect


@pytest.mark.parametrize("mode", ["position", "velocity", "duty", "position_velocity"])
def test_in_the_other_modes_it_scales_the_reported_torque_only(mode):
    [deviation] = CubeMarsServo("AK10-9-V3.0", limit=5.0, torque_constant=0.3, mode=mode, rms_mode="warn").deviations()
    assert (deviation.parameter, deviation.factor) == ("torque_constant", None)
    assert "4.38 times that reported" in deviation.effect


class OtherConstant(RobStride):
    """RS02 with another torque constant."""

    find = staticmethod(lambda name: replace(robstride_models.find(name), rms_constant=0.61))


def test_the_torque_constant_of_a_robstride_counts_in_the_modes_with_a_current():
    assert found(OtherConstant("RS02", mode="current", limit=3.0)) == {"torque_constant": (pytest.approx(2.0), False)}
    assert found(OtherConstant("RS02", limit=3.0)) == {"model": (None, False)}


def test_outside_operation_control_the_ranges_scale_reports_only():
    drive = RobStride("RS02", mode="csp", wire_torque=1.7, wire_stiffness=5.0, wire_position=6.0)
    assert found(drive) == {"wire_torque": (None, False), "wire_position": (None, False)}


def test_a_gear_is_compared_with_the_diagram_or_with_no_gear_if_it_reduces_the_torque():
    knee = CubeMars("AK80-9", limit=3.0, gear_ratio=6.0)
    assert found(knee) == {}
    knee.set("gear_ratio", 2.0, "--set")
    assert found(knee) == {"gear_ratio": (pytest.approx(3.0), False)}
    assert found(CubeMars("AK80-9", limit=3.0, gear_ratio=0.5)) == {"gear_ratio": (pytest.approx(2.0), False)}


@pytest.mark.parametrize("mounting", [{"invert": True}, {"offset": 0.4}, {"can_id": 3}, {"range": (-0.1, 2.0)}])
def test_mounting_has_no_table(mounting):
    for kind, model in ((CubeMars, "AK80-9"), (CubeMarsServo, "AK80-9"), (RobStride, "RS02")):
        assert found(kind(model, **mounting)) == {}


def test_the_frame_that_may_command_full_torque_must_be_accepted():
    assert found(CubeMarsV3("AK10-9-V3.0", enter=True)) == {"enter": (None, False)}


def test_a_verified_wake_shift_needs_no_acceptance():
    with Diagram("robot", rate=200) as robot:
        CubeMars("AK80-9", name="knee", wake_shift=0.0)(torque_command=1.0)
    schedule = compile(robot)
    assert found(robot["knee"]) == {"wake_shift": (None, True)}
    assert schedule.caveats == [] and schedule.warnings == []
