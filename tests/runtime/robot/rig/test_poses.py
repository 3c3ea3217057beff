"""Joint poses: a drive whose reading may be off by motor turns is not armed until another source decides."""

import math

import pytest

from blocks.actuators import CubeMars
from blocks.imus import MicroStrain
from blocks.recorders import CsvRecorder
from cext.kernels import no_io
from graph import Device, Diagram, Output, Param, compile
from runtime.host.console.styles import Console
from runtime.host.errors import BadInput
from runtime.record.report.preflight.table import Preflight
from runtime.record.report.preflight.text import ASK, ASK_AGAIN, text
from runtime.robot.rig.poses import Poses, readings

TURN = 2.0 * math.pi / 9  # rad, 40°: of an AK10-9


class Encoder(Device):
    """An absolute encoder at the joint."""

    bus = Param("legs", "1", "its bus", dtype=str)
    angle = Output("rad", "of the joint")
    temperature = Output("°C", "of the chip")
    decode, encode = no_io.ignore_all, no_io.send_nothing


def look(position, stated=None, encoder=0.0, first=True, **parameters):
    """Why a knee that reads this angle is not armed, "" where it is."""
    with Diagram("robot", rate=200) as robot:
        CubeMars("AK10-9-V2.0", bus="legs", name="knee", **{"range": (-0.1, 2.0), **parameters})(torque_command=0.0)
        CsvRecorder()(Encoder(name="encoder").angle, MicroStrain("133931", channels=("euler",), name="imu").euler)
    schedule = compile(robot)
    poses = Poses(robot, schedule, stated)
    values = schedule.arena.copy()
    values[schedule.signals["knee.active"].slot] = 1.0
    for name, value in {"knee.position": position, "encoder.angle": encoder, "imu.euler": encoder}.items():
        place = schedule.signals[name]
        values[place.slot : place.slot + place.size] = value
    return poses.look(values, first=first).get("knee", "")


def test_a_reading_in_range_is_ambiguous_if_one_motor_turn_further_is_also_in_range():
    why = look(0.52)
    assert why.startswith(
        "knee reads 0.520 rad; a power cycle can shift it by 0.698 rad (40°), and 1.218 and "
        "1.916 rad also lie in its range -0.1 to 2 rad: "
    )
    assert "known_pose = [ANGLE, TOLERANCE]" in why and "--pose knee=ANGLE" in why


def test_joint_whose_drive_is_taken_out_does_not_prevent_arming_but_its_return_does():
    with Diagram("robot", rate=200) as robot:
        CubeMars("AK10-9-V2.0", range=(-0.1, 2.0), name="knee")(torque_command=0.0)
    schedule = compile(robot)
    poses, values = Poses(robot, schedule), schedule.arena.copy()
    values[schedule.signals["knee.position"].slot] = 0.52
    assert poses.look(values) == {} and not poses.may_return("knee", values)
    values[schedule.signals["knee.active"].slot] = 1.0
    assert "knee" in poses.look(values)


def test_zero_that_arming_has_set_decides_until_the_run_is_armed_again():
    assert look(0.0, zero_at_arming=True) == ""
    assert look(0.52, zero_at_arming=True, first=False).startswith("knee reads 0.520 rad; a power cycle can shift it")


@pytest.mark.hazard("H5b")
@pytest.mark.parametrize(
    "width, position, armed",
    [
        (0.6, 0.3, True),  # narrower than a turn: whatever reads inside stands there
        (0.9, 0.45, True),  # wider, but no turn further from this reading is inside
        (0.9, 0.1, False),
        (0.9, 0.8, False),
        (2.0, 1.0, False),
    ],
)
def test_drive_is_armed_only_if_one_reading_is_within_range(width, position, armed):
    assert (look(position, range=(0.0, width)) == "") is armed


def test_a_unit_that_was_verified_to_keep_its_angle_is_armed_and_a_gear_behind_makes_more_readings():
    assert look(0.52, wake_shift=0.0) == ""
    assert "can shift it by 0.349 rad (20°)" in look(0.3, gear_ratio=2.0)
    assert look(0.3, wake_shift=2.0 * math.pi) == ""


@pytest.mark.parametrize("position, armed", [(0.0, True), (0.09, True), (-0.09, True), (0.11, False), (TURN, False)])
def test_reference_pose_decides_within_its_tolerance(position, armed):
    assert (look(position, known_pose=(0.0, 0.1)) == "") is armed


def test_a_reading_off_by_whole_turns_is_reported_with_the_correcting_offset():
    why = look(2 * TURN + 0.02, known_pose=(0.0, 0.1), offset=0.3)
    assert why.startswith(
        "knee reads 1.416 rad, but its known pose is 0.000 ± 0.1 rad: the reading is off by 2 "
        "motor turns of 0.698 rad; offset = 1.6963 in the rig"
    )
    assert "off by 1 motor turn of" in look(-TURN, known_pose=(0.0, 0.1))
    assert look(0.3, known_pose=(0.0, 0.1)).endswith("0.000 ± 0.1 rad: move it there, or correct the pose")


def test_operator_may_state_position_within_a_quarter_turn():
    assert look(0.52, {"knee": 0.4}) == "" and look(0.52, {"knee": 0.52 + TURN / 4 - 1e-6}) == ""
    assert "but the stated pose is 1.220" in look(0.52, {"knee": 1.22}) and "off by 1 motor turn" in look(
        0.52, {"knee": 1.22}
    )
    assert look(0.52, {"knee": 0.8}) != ""


@pytest.mark.parametrize("reference", ["encoder.angle", "imu.euler[1]"])
def test_a_second_sensor_decides(reference):
    assert look(0.52, encoder=0.5, reference=reference) == ""
    assert "off by 1 motor turn" in look(0.52, encoder=0.52 + TURN, reference=reference)
    assert look(0.52, encoder=math.nan, reference=reference) != ""


def test_all_given_poses_must_agree():
    assert look(0.02, {"knee": 0.0}, encoder=0.0, known_pose=(0.0, 0.1), reference="encoder.angle") == ""
    assert "its reference encoder.angle is 0.698" in look(
        0.02, {"knee": 0.0}, encoder=TURN, known_pose=(0.0, 0.1), reference="encoder.angle"
    )


@pytest.mark.parametrize(
    "parameters, stated, said",
    [
        (
            {"reference": "encoder.temperature"},
            {},
            "knee: reference 'encoder.temperature' is not an output in rad of another device",
        ),
        ({"reference": "knee.position"}, {}, "not an output in rad of another device"),
        ({"reference": "nothing"}, {}, "not an output in rad of another device"),
        ({"reference": "imu.euler"}, {}, "has 3 elements: name one, as in 'imu.euler[0]'"),
        ({"reference": "imu.euler[3]"}, {}, "has 3 elements"),
        (
            {"known_pose": (5.0, 0.1)},
            {},
            "knee: its known_pose, 5 ± 0.1 rad, is outside its range -0.1 to 2 rad, so it could not be armed",
        ),
        ({}, {"kne": 0.0}, "--pose kne: robot has no such joint with a range; did you mean 'knee'?"),
        ({"range": ()}, {"knee": 0.0}, "--pose knee: robot has no such joint with a range; its joints are none"),
    ],
)
def test_invalid_pose_setting_is_refused(parameters, stated, said):
    with pytest.raises(BadInput) as refused:
        look(0.0, stated, **parameters)
    assert said in str(refused.value)


def test_a_joint_outside_its_range_is_not_armed_and_the_remedy_is_named():
    why = look(2.3, wake_shift=0.0)
    assert why == (
        "knee reads 2.300 rad, outside its range -0.1 to 2 rad: move it inside by hand, or correct "
        "`offset` and `range` in the rig"
    )
    assert "if the joint is inside, its reading is wrong, and it may be at 0.206, 0.904 and 1.602 rad" in look(2.3)
    for just_outside in (-0.12, 2.02):
        assert look(just_outside, wake_shift=0.0) == ""
    assert look(math.nan) == "knee has no position reading"


def test_all_alternative_readings_are_computed():
    assert readings(0.5, 0.0, -10.0, 10.0) == []
    assert readings(0.5, 1.0, -1.6, 2.5) == pytest.approx([-1.5, -0.5, 1.5, 2.5])


def test_table_lists_obstacles_and_effect_of_enter():
    with Diagram("robot", rate=200) as robot:
        CubeMars("AK10-9-V2.0", bus="legs", name="knee", range=(-0.1, 2.0))(torque_command=0.0)
    schedule = compile(robot)
    table = Preflight(robot, schedule, {"legs": ("socketcan", "can0")}, True, poses=Poses(robot, schedule))
    values = schedule.arena.copy()
    values[schedule.signals["knee.position"].slot], values[schedule.signals["knee.temperature"].slot] = 0.52, 30.0
    values[schedule.signals["knee.active"].slot] = 0.0
    assert any(
        line.split()[:5] == ["knee", "legs", "1", "taken", "out"] for line in text(table.event(values), Console(200))
    )
    values[schedule.signals["knee.active"].slot] = 1.0
    lines = text(table.event(values), Console(200))
    assert lines[-1] == ASK_AGAIN and any(
        line.startswith("NOT armed: knee reads 0.520 rad; a power cycle can shift") for line in lines
    )
    clear = Preflight(
        robot, schedule, {"legs": ("socketcan", "can0")}, True, poses=Poses(robot, schedule, {"knee": 0.5})
    )
    assert text(clear.event(values), Console(200))[-1] == ASK
