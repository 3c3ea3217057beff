"""What a person feels: the drive's whole law stays inside the torque limit, over every position that can be reached before the next frame."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from blocks.actuators import CubeMars, EmulatedCubeMars
from blocks.actuators.cubemars.models import MODELS
from blocks.models import Limb
from blocks.sources import Sine
from graph import Diagram
from tests.blocks.actuators import reference
from tests.blocks.actuators.wire import Wired
from tests.cext.rigs import Rig

PERIOD = 0.005                                      # s
PERIOD_SLOT = 3                                     # cext/abi.pxd
RANGES = {name: reference.ranges(model.wire_velocity, model.wire_torque) for name, model in MODELS.items()}


def drive(model="AK80-9", **parameters):
    wired = Wired(CubeMars, model, can_id=1, **parameters)
    wired.arena[PERIOD_SLOT] = PERIOD
    return wired


def said(wired, model, **commands):
    """What the drive understands of a command."""
    [(_, data)] = wired.say(**{f"{name}_command": value for name, value in commands.items()})
    return reference.read_command(RANGES[model], data)


def law(command, position, velocity):
    """The torque that the drive gives, N·m."""
    return (
        command["stiffness"] * (command["position"] - position) + command["damping"] * (command["velocity"] - velocity) + command["torque"])


@given(data=st.data(), model=st.sampled_from(sorted(MODELS)), limit=st.sampled_from(["rated", "peak", 1.0]))
@settings(max_examples=500, deadline=None)
def test_the_law_is_inside_the_limit_wherever_the_joint_may_be_by_then(data, model, limit):
    wired = drive(model, limit=limit)
    most = wired["limits"][4]
    position = wired["position"] = data.draw(st.floats(-12.5, 12.5), label="position")
    velocity = wired["velocity"] = data.draw(st.floats(-wired["wire"][1], wired["wire"][1]), label="velocity")
    age = wired["age"] = data.draw(st.floats(0.0, 2.0 * PERIOD), label="age")
    commands = {
        name: data.draw(st.floats(*((0.0, top) if name in ("stiffness", "damping") else (-top, top))), label=name)
        for name, top in zip(("position", "velocity", "stiffness", "damping", "torque"), wired["limits"])}
    understood = said(wired, model, **commands)
    step = (RANGES[model]["torque"][1] - RANGES[model]["torque"][0]) / 4095
    for share in (-1.0, -0.5, 0.0, 0.5, 1.0):
        moved = position + share * abs(velocity) * (PERIOD + age)
        assert abs(law(understood, moved, velocity)) <= most + step


def test_a_soft_spring_near_its_rest_is_sent_as_it_is_asked():
    wired = drive()
    wired["position"], wired["velocity"], wired["age"] = 0.1, 0.2, PERIOD
    understood = said(wired, "AK80-9", position=0.0, stiffness=30.0, damping=1.0, torque=2.0)
    assert understood["stiffness"] == pytest.approx(30.0, abs=500.0 / 4095) and understood["damping"] == pytest.approx(1.0, abs=5.0 / 4095)
    assert wired["limited"] == 0.0


def test_a_stiff_spring_far_from_its_rest_pulls_with_the_limit_and_it_counts():
    wired = drive()                                                     # 9 N·m
    wired["position"], wired["age"] = 1.0, PERIOD
    understood = said(wired, "AK80-9", position=0.0, stiffness=100.0)
    assert law(understood, 1.0, 0.0) == pytest.approx(-9.0, abs=0.1) and wired["limited"] == 1.0
    said(wired, "AK80-9", position=0.9999, stiffness=10.0)
    assert wired["limited"] == 1.0


def test_a_feedforward_at_the_limit_leaves_nothing_to_a_spring_that_pulls_the_same_way():
    wired = drive()
    wired["position"], wired["age"] = 1.0, PERIOD
    assert said(wired, "AK80-9", position=0.0, stiffness=100.0, torque=-9.0)["stiffness"] == 0.0
    assert said(wired, "AK80-9", position=0.0, stiffness=100.0, torque=9.0)["stiffness"] == pytest.approx(18.0, abs=0.3)


def test_what_the_codes_may_say_wrongly_of_position_and_velocity_is_taken_from_the_share():
    """Two codes of each: 500 N·m/rad over 0.04 rad is 20 N·m, and 5 N·m·s/rad over 4 rad/s as much."""
    wired = drive()
    understood = said(wired, "AK80-9", position=0.04, stiffness=500.0)
    assert understood["stiffness"] == pytest.approx(500.0 * 9.0 / (20.0 + 500.0 * 2.0 * 25.0 / 65535), abs=500.0 / 4095)
    understood = said(drive(), "AK80-9", velocity=4.0, damping=5.0)
    assert understood["damping"] == pytest.approx(5.0 * 9.0 / (20.0 + 5.0 * 2.0 * 100.0 / 4095), abs=5.0 / 4095)


def test_a_damper_alone_has_the_whole_limit_wherever_the_spring_would_rest():
    wired = drive()
    wired["position"] = -10.0
    understood = said(wired, "AK80-9", position=1.0, velocity=5.0, damping=5.0)
    assert law(understood, -10.0, 0.0) == pytest.approx(9.0, abs=0.2)


@pytest.mark.parametrize("position, velocity, damping, moving", [(1.0, -5.0, 1.0, 0.0), (1.0, -5.0, 1.0, 20.0), (0.3, 0.0, 1.5, 20.0)])
def test_where_spring_and_damper_pull_against_each_other_neither_counts_on_the_other(position, velocity, damping, moving):
    """By how much a code of stiffness is less, over where the joint may be by then, is taken from the limit."""
    wired = drive(limit=1.0)
    wired["velocity"], wired["age"] = moving, PERIOD
    understood = said(wired, "AK80-9", position=position, velocity=velocity, stiffness=100.0, damping=damping)
    moves = moving * 2.0 * PERIOD
    error = 100.0 * position + damping * (velocity - moving)
    spread = 100.0 * (moves + 2.0 * 25.0 / 65535) + damping * 2.0 * 100.0 / 4095
    limit = 1.0 - max(500.0 / 4095 * (position + moves), 5.0 / 4095 * abs(velocity - moving))
    code = math.floor(100.0 * limit / (error + spread) * 4095 / 500.0)
    assert understood["stiffness"] == pytest.approx(code * 500.0 / 4095, abs=1e-9)


def test_a_share_is_never_more_than_was_asked():
    """A feedforward at the limit, and a spring and a damper that nearly cancel: what is left of the limit is below zero, and so is their sum."""
    wired = drive()
    understood = said(wired, "AK80-9", position=0.1, velocity=-5.095, stiffness=50.0, damping=1.0, torque=9.0)
    assert understood["stiffness"] <= 50.0 and understood["damping"] <= 1.0


@pytest.mark.parametrize("torque", [5.0, -5.0])
def test_a_limit_that_has_gone_down_cuts_a_torque_instead_of_refusing_it(torque):
    wired = drive()
    wired["limits"] = (*wired["limits"][:5], 3.0, 1.0)
    assert said(wired, "AK80-9", torque=torque)["torque"] == pytest.approx(math.copysign(3.0, torque), abs=36.0 / 4095)
    assert wired["limited"] == 1.0


def test_a_torque_alone_needs_no_feedback_and_is_not_counted():
    wired = drive()
    wired["age"] = 1.0
    assert said(wired, "AK80-9", torque=3.0)["torque"] == pytest.approx(3.0, abs=36.0 / 4095) and wired["limited"] == 0.0


@pytest.mark.parametrize("age, kept", [(2.0 * PERIOD, True), (2.0 * PERIOD + 1e-9, True), (2.0 * PERIOD + 2e-9, False), (2.1 * PERIOD, False), (math.inf, False), (math.nan, False)])
def test_on_feedback_older_than_two_ticks_there_is_neither_stiffness_nor_damping(age, kept):
    wired = drive()
    wired["age"] = age
    understood = said(wired, "AK80-9", stiffness=20.0, damping=1.0, torque=3.0)
    assert (understood["stiffness"] > 19.0 and understood["damping"] > 0.9) if kept else understood["stiffness"] == understood["damping"] == 0.0
    assert understood["torque"] == pytest.approx(3.0, abs=36.0 / 4095) and wired["limited"] == (not kept)


def test_in_a_closed_loop_a_joint_that_is_driven_hard_never_feels_more_than_its_limit():
    with Diagram("robot", rate=200) as robot:
        knee = CubeMars("AK80-9", name="knee", limit=4.0)
        knee(position_command=Sine(amplitude=1.5, frequency=2.0)(), stiffness_command=200.0, damping_command=2.0)
    with Diagram("plant", rate=2000) as plant:
        motor = EmulatedCubeMars.of(robot["knee"], name="drive")
        limb = Limb(inertia=0.05, damping=0.2, stiffness=0.0, reflex=0.0, name="limb")
        limb(torque=motor.torque)
        motor(position=limb.position, velocity=limb.velocity)
    rig = Rig(robot, plant)
    assert rig.run(400).status == "ok"
    assert rig["knee.limited"][-1] > 100                                # it acts, and often
    assert 3.0 < abs(rig["knee.torque"]).max() <= 4.0 * 1.1             # within a period velocity changes, which the bound does not know
