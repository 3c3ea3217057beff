"""On a rig every joint has a range: without one nothing is armed, and the message explains how to find it."""

import pytest

from blocks.actuators import CubeMars
from cext.kernels import no_io
from graph import Actuator, Diagram, Input, Output, Param
from runtime.robot.rig.errors import RigError
from runtime.robot.rig.file import parse
from runtime.robot.rig.joints import require_ranges
from runtime.robot.rig.overrides import override
from tests.runtime.runs import KNEE_EXO, write

LEGS = '[bus.legs]\ninterface = "socketcan"\nchannel = "can0"\n'
RANGES = '[device."left/knee"]\nrange = [-0.1, 2.0]\n[device."right/knee"]\nrange = [-0.1, 2.0]\n'


class Board(Actuator):
    """A laboratory's board, written before."""

    bus = Param("legs", "1", "its bus", dtype=str)
    torque_command = Input("N·m", "torque", default=0.0)
    position = Output("rad", "of the joint")
    decode, encode = no_io.ignore_all, no_io.send_nothing


class Winch(Board):
    """A motor that measures no angle."""

    position = Output("m", "of the rope")


def troubles(tmp_path, text="", kind=CubeMars, **parameters):
    with Diagram("robot", rate=200) as robot:
        kind(**parameters, bus="legs", name="knee")(torque_command=0.0)
    rig = parse(tmp_path / "lab.toml", LEGS + text)
    override(rig, robot)
    try:
        require_ranges(rig, robot)
    except RigError as error:
        return [(trouble.code, trouble.message, trouble.hint) for trouble in error.problems]
    return []


def test_a_joint_without_a_range_is_reported_with_the_command_that_measures_it(tmp_path):
    [(code, message, hint)] = troubles(tmp_path, model="AK80-9")
    assert (code, message) == ("TW136", '[device."knee"] has no range, its lowest and highest position')
    assert (
        "write range = [LOWEST, HIGHEST] there, in rad; configure --joint knee --rig" in hint
        and "moved by hand" in hint
    )


def test_the_range_can_be_in_the_rig_or_the_diagram(tmp_path):
    assert troubles(tmp_path, "[device.knee]\nrange = [-0.1, 2.0]\n", model="AK80-9") == []
    assert troubles(tmp_path, model="AK80-9", range=(-0.1, 2.0)) == []


def test_custom_actuator_that_measures_angle_must_declare_it(tmp_path):
    [(_, message, hint)] = troubles(tmp_path, kind=Board)
    assert (
        message == '[device."knee"]: Board has no parameter `range`'
        and "declare range = Param((), " in hint
        and "`hardware`" in hint
    )
    assert troubles(tmp_path, kind=Winch) == []


@pytest.mark.parametrize("command", ["run", "check"])
def test_run_and_check_report_a_reference_that_does_not_exist(command_line, command):
    text = LEGS + RANGES.replace("2.0]", '2.0]\nreference = "nothing.angle"', 1)
    said = command_line.refused(
        command,
        KNEE_EXO,
        "--yes" if command == "run" else "--rate=200",
        "--rig",
        write(command_line.folder, text, "lab.toml"),
    )
    assert "left/knee: reference 'nothing.angle' is not an output in rad of another device" in said


@pytest.mark.hazard("H5a")
@pytest.mark.parametrize("command", ["run", "check"])
def test_run_and_check_report_every_joint_without_a_range(command_line, command):
    rig = write(command_line.folder, LEGS, "lab.toml")
    said = command_line.refused(command, KNEE_EXO, "--rig", rig)
    assert (
        said.count("error TW136 joint without a range") == 2
        and '[device."left/knee"]' in said
        and '[device."right/knee"]' in said
    )


def test_in_simulation_a_joint_needs_no_range(command_line):
    assert command_line("check", KNEE_EXO)[0] == 0
    rig = write(command_line.folder, LEGS + RANGES, "lab.toml")
    assert command_line("check", KNEE_EXO, "--rig", rig)[0] == 0


def test_check_reports_setpoint_outside_range_of_rig(command_line):
    rig = write(command_line.folder, LEGS + RANGES, "lab.toml")
    code, out, _ = command_line("check", KNEE_EXO, "--rig", rig, "--set", "left/events.smallest=40")
    assert (
        code == 1
        and "TW026" in out
        and "40 rad is outside the limits of left/knee: -0.1 to 2 rad (its range)" in " ".join(out.split())
    )
