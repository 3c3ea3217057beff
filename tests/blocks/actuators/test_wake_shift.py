"""A joint that wakes up somewhere else: what a power cycle can shift, model by model, and emulated drives that wrap."""

import math

import pytest

from blocks.actuators import (
    CubeMars,
    CubeMarsServo,
    CubeMarsV3,
    EmulatedCubeMars,
    EmulatedCubeMarsServo,
    EmulatedCubeMarsV3,
    EmulatedRobStride,
    EmulatedRobStrideMIT,
    RobStride,
    RobStrideMIT,
)
from blocks.actuators.cubemars import models, models_v3
from blocks.actuators.mit_frames import ENABLE, NOTHING
from blocks.actuators.robstride import models as robstride
from graph import Diagram, DiagramError
from tests.blocks.actuators.wire import Wired

DRIVES = [
    (CubeMars, EmulatedCubeMars, "AK10-9-V2.0"),
    (CubeMarsV3, EmulatedCubeMarsV3, "AK10-9-V3.0"),
    (CubeMarsServo, EmulatedCubeMarsServo, "AK80-9"),
    (RobStride, EmulatedRobStride, "RS03"),
    (RobStrideMIT, EmulatedRobStrideMIT, "RS02"),
]


@pytest.mark.parametrize("table", [models.MODELS, models_v3.MODELS, robstride.MODELS])
def test_every_model_states_a_turn_of_its_motor(table):
    for model in table.values():
        assert model.wake_shift == pytest.approx(2.0 * math.pi / model.gear)
    assert math.degrees(models.MODELS["AK10-9-V2.0"].wake_shift) == pytest.approx(40.0)


@pytest.mark.parametrize("kind, emulated, model", DRIVES)
def test_a_gear_divides_the_wake_shift_and_a_unit_may_have_another(kind, emulated, model):
    for parameters, shift in (
        ({"gear_ratio": 2.0}, kind(model).spec.wake_shift / 2.0),
        ({"wake_shift": 0.0}, 0.0),
        ({"wake_shift": 1.5}, 1.5),
    ):
        with Diagram("robot", rate=200):
            drive = kind(model, name="knee", **parameters)
        assert drive.shift == pytest.approx(shift)
        with Diagram("plant", rate=1000):
            assert drive.emulator().state[6] == pytest.approx(shift)


@pytest.mark.parametrize("kind, emulated, model", DRIVES)
@pytest.mark.parametrize("invert", [False, True])
def test_an_emulated_drive_wakes_within_one_turn_of_its_motor_and_congruent(kind, emulated, model, invert):
    for position, moved in ((0.2, 0.2), (1.0, 1.0), (-2.9, -2.9), (0.1, 5.3)):
        wired = Wired(emulated, model, can_id=7, invert=invert)
        wired.step(position=position, velocity=0.0)
        assert wired["state"][1] == 0.0, "with power it counts turns"
        wired.step(power_lost=True)
        wired.step(position=moved)
        wired.step(power_lost=False)
        zero, shift = wired["state"][1], wired["state"][6]
        reading = (-moved if invert else moved) - zero
        assert shift == pytest.approx(2.0 * math.pi / kind(model).spec.gear) and abs(reading) <= shift / 2.0 + 1e-12
        assert zero / shift == pytest.approx(round(zero / shift), abs=1e-9)


def test_drive_reports_shifted_angle_after_wake_up():
    """1.0 rad is reported as 1.0 - 0.698 rad, 40° less, and is as plausible."""
    wired = Wired(EmulatedCubeMars, "AK10-9-V2.0", can_id=1)
    for name, value in {"position": 1.0, "velocity": 0.0, "temperature": 30.0}.items():
        wired[name] = value

    def told():
        wired.hear(1, NOTHING)
        [(_, data)] = wired.say()
        return (data[1] << 8 | data[2]) / 65535 * 25.0 - 12.5

    wired.hear(1, ENABLE)
    wired.say()
    assert told() == pytest.approx(1.0, abs=4e-4)
    wired.step(power_lost=True)
    wired.step(power_lost=False)
    assert told() == pytest.approx(1.0 - 2.0 * math.pi / 9, abs=4e-4)


def test_emulated_reading_is_off_by_turns_unless_the_drive_has_a_second_encoder():
    assert EmulatedCubeMars("AK10-9-V2.0", turns=2).state[1] == pytest.approx(-4.0 * math.pi / 9)
    wired = Wired(EmulatedCubeMars, "AK10-9-V2.0", can_id=1, wake_shift=0.0)
    wired.step(position=3.0, velocity=0.0, power_lost=True)
    assert wired["state"][1] == 0.0


@pytest.mark.parametrize(
    "pose, said",
    [
        ((0.0,), "an angle and a tolerance"),
        ((0.0, 0.4), "below 0.3491 rad, half the shift of a power cycle, got 0.4"),
        ((0.0, 0.0), "above 0"),
        ((0.0, math.nan), "an angle and a tolerance"),
        (("straight", 0.1), "an angle and a tolerance"),
    ],
)
def test_invalid_reference_pose_is_refused(pose, said):
    for kind, model in ((CubeMars, "AK10-9-V2.0"), (CubeMarsServo, "AK10-9-V2.0")):
        with pytest.raises(DiagramError, match=said):
            kind(model, known_pose=pose)
    assert CubeMars("AK10-9-V2.0", known_pose=[0, 0.1]).known_pose == (0.0, 0.1)
