"""Settings NAME=VALUE: conversion of texts, and the parameters that they set."""

import math
from types import SimpleNamespace

import pytest

import runtime
from graph import Block, Diagram, Output, Param
from runtime.host.errors import BadInput
from runtime.host.options import settings
from runtime.robot.loading.diagram_file import DiagramFile
from runtime.robot.loading.file import load
from runtime.robot.loading.overrides import parse_like, set_seeds, share_out
from tests.runtime.runs import KNEE_EXO


@pytest.mark.parametrize(
    "default, text, value",
    [
        (1.0, "2", 2.0),
        (1.0, "-1e-3", -1e-3),
        (0.5, "180 deg", math.pi),
        (1.0, "250 ms", 0.25),
        (3, "2 m", 2.0),
        (3, "4", 4),
        (3, "+4", 4),
        (3, "4.5", 4.5),
        (True, "false", False),
        (True, "No", False),
        (False, "1", True),
        (False, "YES", True),
        ("walk", "12", "12"),
        ("", "", ""),
        ("", "a=b", "a=b"),
        (None, "12", 12),
        (None, "walk", "walk"),
        (None, "(1.0, 2.0)", (1.0, 2.0)),
        ((0.0,), "[1, 2]", [1, 2]),
    ],
)
def test_a_text_is_converted_to_the_type_of_the_default(default, text, value):
    found = parse_like(default, "name", text)
    assert found == value and type(found) is type(value)


@pytest.mark.parametrize(
    "default, text", [(1.0, "much"), (1.0, ""), (1.0, "7 apples"), (1, "one"), (True, "maybe"), (False, "2")]
)
def test_a_text_of_another_type_is_rejected(default, text):
    with pytest.raises(BadInput, match=f"setting name={text}: expected "):
        parse_like(default, "name", text)


@pytest.mark.parametrize(
    "name, value",
    [
        ("left/profil.scale", 1),
        ("left/profile.scal", 1),
        ("left/profile.scale", 99),
        ("left/profile.scale", "much"),
        ("*/profile.scales", 1),
        ("assistence", 1),
    ],
)
def test_a_rejected_setting_is_reported_alike_in_python_and_on_the_command_line(name, value):
    with pytest.raises(BadInput) as python:
        runtime.run(KNEE_EXO, 0.1, settings={name: value})
    with pytest.raises(BadInput) as command_line:
        load(KNEE_EXO, settings=settings([f"{name}={value}"]))
    assert str(python.value) == str(command_line.value)
    assert str(python.value).startswith(f"setting {name}={value}: ") and "--" not in str(python.value)


def test_a_parameter_without_a_value_is_reported_without_a_command_line_option():
    def build(mass):
        raise AssertionError

    with pytest.raises(BadInput, match="missing .*: 'mass'; give the parameter a default, or set its value$"):
        runtime.run(build, 0.1)


def shared_out(settings, **functions):
    file = DiagramFile("robot.py", SimpleNamespace(**functions), {}, {})
    share_out(file, settings)
    return file.build_parameters, file.plant_parameters


def test_settings_go_to_build_to_plant_or_to_both():
    def build(mass=70.0, gain=1.0):
        pass

    def plant(robot, mass=70.0, gait=""):
        pass

    settings = [("mass", "80"), ("gain", "2"), ("gait", "walk.csv"), ("left/knee.limit", "3")]
    assert shared_out(settings, build=build, plant=plant) == (
        {"mass": 80.0, "gain": 2.0},
        {"mass": 80.0, "gait": "walk.csv"},
    )


def test_the_robot_argument_cannot_be_set():
    with pytest.raises(BadInput, match="robot.py has no parameter 'robot'; it has mass"):
        shared_out([("robot", "1")], plant=lambda robot, mass=1.0: None)


def test_a_build_with_keyword_arguments_receives_every_setting():
    assert shared_out([("anything", "3"), ("rate", "2")], build=lambda rate=1.0, **more: None) == (
        {"anything": 3, "rate": 2.0},
        {},
    )


def test_the_last_of_several_values_counts():
    assert shared_out([("gain", "2"), ("gain", "3")], build=lambda gain=1.0: None) == ({"gain": 3.0}, {})


def test_a_blocks_parameter_is_set_by_its_path_in_its_unit():
    _, diagram = load(
        KNEE_EXO, [("left/profile.scale", "0.25"), ("right/knee.offset", "10 deg"), ("left/knee.invert", "true")]
    )
    assert diagram["left/profile"].scale == 0.25 and diagram["right/profile"].scale == 1.0
    assert diagram["right/knee"].offset == pytest.approx(0.17453, abs=1e-5)
    assert diagram["left/knee"].invert is True


def test_derived_seeds_stay_within_the_bounds_of_their_blocks():
    class Dice(Block):
        seed = Param(1, "1", "", min=1, max=6)
        y = Output(unit="1")

        def step(self):
            return float(self.seed)

    with Diagram("dice", rate=100) as diagram:
        dice = [Dice(name=f"dice{number}") for number in range(8)]
    for seed in range(20):
        set_seeds(diagram, seed)
        assert all(1 <= die.seed <= 6 for die in dice)
    assert len({die.seed for die in dice}) > 1
