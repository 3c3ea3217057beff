"""Emulated drives whose firmware differs from the manual, and what the drivers make of them."""

import math

import pytest

from blocks.actuators import CubeMars, CubeMarsServo, CubeMarsV3, EmulatedCubeMars, RobStride, RobStrideMIT
from blocks.actuators.mit_frames import ENABLE, NOTHING, SET_ZERO
from blocks.sources import Sine
from graph import Diagram
from tests.blocks.actuators import reference
from tests.blocks.actuators.wire import TAKEN, Wired
from tests.cext.imposed import imposed, still
from tests.cext.rigs import Rig, plant_of

AK40_10 = reference.ranges(45.0, 5.0, 12.56)


def torque_of(torque, limits=None):
    """A command of a torque alone, to an AK80-9."""
    fields = dict.fromkeys(("position", "velocity", "stiffness", "damping"), 0.0)
    return reference.command(limits or reference.ranges(50.0, 18.0), **fields, torque=torque)


def reply(error, temperature, limits=AK40_10):
    return reference.reply(limits, 1, position=0.0, velocity=0.0, torque=0.0, temperature=temperature, error=error)


@pytest.mark.hazard("H6b")
@pytest.mark.parametrize(
    "errors, error, temperature, fault",
    [
        ("mask", 2, 95.0, 0),  # a warning: the drive runs on
        ("mask", 2, 79.0, 0),  # its temperature was sampled a little later than its mask
        ("mask", 2, 40.0, 2),  # of a cool drive with either meaning an over-current
        ("mask", 6, 121.0, 4),
        ("mask", 4, 100.0, 4),
        ("mask", 1, 30.0, 1),
        ("mask", 8, 95.0, 8),
        ("code", 2, 95.0, 2),
        ("code", 6, 95.0, 6),
    ],
)
def test_error_byte_is_a_code_or_a_mask(errors, error, temperature, fault):
    wired = Wired(CubeMars, "AK40-10", can_id=1, errors=errors)
    assert wired.hear(1, reply(error, temperature)) == TAKEN and wired["fault"] == fault
    assert Wired(CubeMars, "AK40-10")["masks"] == 1.0 and Wired(CubeMars, "AK80-9")["masks"] == 0.0


def test_words_of_an_error_name_both_meanings_where_they_differ():
    manual, masked = CubeMars("AK80-9"), CubeMars("AK80-9", errors="mask")
    assert "over-current; in firmware whose error byte is a mask (errors='mask'), a warning" in manual.fault_in_words(2)
    assert masked.fault_in_words(4) == "above 120 °C (bit 2); under-voltage if its error byte is a code"
    assert masked.fault_in_words(2) == "over-current"


def run(drive, seconds=1.0, plant=None, command=0.0, rate=200, **parameters):
    with Diagram("robot", rate=rate) as robot:
        drive()(torque_command=command)
    rig = Rig(robot, plant_of(robot, **parameters) if plant is None else plant(robot))
    rig.knee = robot["knee"]
    return rig, rig.run(round(seconds * rate), fade=0.0)


def warm_plant(robot, temperature=85.0, **parameters):
    with Diagram("plant", rate=robot.rate) as plant:
        drive = robot["knee"].emulator(**parameters)
        drive(position=0.0, velocity=0.0, temperature=temperature)
    return plant


@pytest.mark.hazard("H6b")
def test_a_warm_drive_whose_error_byte_is_a_mask_runs_on_and_a_hot_one_stops():
    def drive():
        return CubeMars("AK40-10", name="knee", derating_temperature=110.0, fault_temperature=119.5)

    rig, outcome = run(drive, plant=warm_plant, command=0.5)
    assert outcome.status == "ok" and rig["knee.torque"][-1] == pytest.approx(0.5, abs=0.01)
    _, outcome = run(drive, plant=lambda robot: warm_plant(robot, 121.0), command=0.5)
    assert outcome.status in ("device fault", "too hot")
    _, outcome = run(
        lambda: CubeMars("AK40-10", name="knee", errors="code"), plant=lambda r: warm_plant(r, errors="mask")
    )
    assert outcome.status == "device fault", "a drive whose error byte may be a code ends the run"


@pytest.mark.parametrize("errors, temperatures, codes", [("mask", (79, 85, 121, 90, 79), (0, 2, 6, 6, 0))])
def test_emulated_mask_follows_the_temperature_and_keeps_the_heat(errors, temperatures, codes):
    wired = Wired(EmulatedCubeMars, "AK80-9", can_id=1, errors=errors)
    found = []
    for temperature in temperatures:
        wired.step(position=0.0, velocity=0.0, temperature=float(temperature))
        wired.hear(1, NOTHING)
        ((_, data),) = wired.say()
        found.append(data[7])
    assert tuple(found) == codes


@pytest.mark.hazard("H1h")
@pytest.mark.parametrize("drive, model", [(RobStride, "RS02"), (RobStrideMIT, "RS06")])
@pytest.mark.parametrize("mounted", [{}, {"invert": True, "offset": 0.3, "gear_ratio": 2.0}])
@pytest.mark.parametrize("share", [0.8, 1.2])
def test_another_range_of_position_is_found_before_the_drive_is_enabled(drive, model, mounted, share):
    """The replies and the parameter mechPos are apart by 20 %, at 0.5 rad."""

    def plant(robot):
        with Diagram("plant", rate=robot.rate) as bench:
            robot["knee"].emulator(wire_position=12.57 * share)(position=0.5, velocity=0.0)
        return bench

    rig, outcome = run(lambda: drive(model, name="knee", **mounted), plant=plant)
    assert (outcome.status, outcome.culprit, outcome.tick) == ("device fault", "knee", -1)
    said = words_of(rig)
    assert "times its parameter mechPos (0x7019)" in said
    assert f"Set wire_position = {12.57 * share:.3g}" in said


def words_of(rig):
    return rig.knee.fault_in_words(rig.control.final[rig.schedule.signals["knee.fault"].slot])


@pytest.mark.hazard("H1h")
@pytest.mark.parametrize("own, real", [("mit", "private"), ("private", "mit")])
def test_an_rs04_with_the_ranges_of_the_other_section_is_not_enabled(own, real):
    def plant(robot):
        with Diagram("plant", rate=robot.rate) as bench:
            robot["knee"].emulator(ranges=real)(position=-0.4, velocity=0.0)
        return bench

    rig, outcome = run(lambda: RobStrideMIT("RS04", name="knee", ranges=own), plant=plant)
    assert (outcome.status, outcome.tick) == ("device fault", -1)
    assert f"Set ranges = {real!r}" in words_of(rig)


@pytest.mark.parametrize("model, own, real", [("RS02", "mit", "private"), ("RS03", "private", "mit")])
def test_another_range_of_velocity_is_found_while_the_joint_is_turned_by_hand(model, own, real):
    def plant(robot):
        with Diagram("plant", rate=robot.rate) as bench:
            robot["knee"].emulator(ranges=real)(position=0.0, velocity=3.0)
        return bench

    rig, outcome = run(lambda: RobStrideMIT(model, name="knee", ranges=own), plant=plant)
    assert (outcome.status, outcome.tick) == ("device fault", -1)
    assert "mechVel" in words_of(rig)


@pytest.mark.parametrize("drive, model", [(RobStride, "RS02"), (RobStrideMIT, "RS06"), (RobStride, "CyberGear")])
@pytest.mark.parametrize("verify_ranges", [True, False])
def test_a_drive_with_the_ranges_of_its_table_is_armed_while_its_joint_is_moved(drive, model, verify_ranges):
    def plant(robot):
        with Diagram("plant", rate=5 * robot.rate) as bench:
            angle = Sine(amplitude=0.8, frequency=0.7, unit="rad")()
            rate = Sine(amplitude=0.8 * 1.4 * math.pi, frequency=0.7, phase=math.pi / 2.0, unit="rad/s")()
            robot["knee"].emulator()(position=angle, velocity=rate)
        return bench

    rig, outcome = run(
        lambda: drive(model, name="knee", verify_ranges=verify_ranges, gear_ratio=0.5), plant=plant, seconds=0.2
    )
    assert outcome.status == "ok"
    indices = {data[:2] for _, _, data in rig.knee.read_frames()}
    assert (b"\x19\x70" in indices and b"\x1b\x70" in indices) == verify_ranges


@pytest.mark.parametrize("timeout", [0.0, 0.05])
def test_a_cubemars_in_mit_mode_holds_its_command_unless_its_time_out_is_set(timeout):
    wired = Wired(EmulatedCubeMars, "AK80-9", can_id=1, command_timeout=timeout)
    wired.hear(1, ENABLE)
    wired.hear(1, torque_of(5.0))
    wired.arena[0] += 0.04
    wired.step(position=0.0, velocity=0.0)
    assert wired["torque"] == pytest.approx(5.0, abs=0.01)
    wired.arena[0] += 0.02
    wired.step(position=0.0, velocity=0.0)
    assert wired["torque"] == (0.0 if timeout else pytest.approx(5.0, abs=0.01)) and wired["enabled"] == 1.0


def test_original_firmware_ignores_a_zero_while_enabled_and_another_is_silent_afterwards():
    for enabled, kept in ((False, False), (True, True)):
        wired = Wired(EmulatedCubeMars, "AK80-9", can_id=1, zero_when_enabled=False)
        if enabled:
            wired.hear(1, ENABLE)
        wired["position"] = 0.7
        wired.hear(1, SET_ZERO)
        data = wired.say()[-1][1]
        read = reference.value(data[1] << 8 | data[2], -12.5, 12.5, 16)
        assert read == pytest.approx(0.7 if kept else 0.0, abs=1e-3)
    silent = Wired(EmulatedCubeMars, "AK80-9", can_id=1, zero_silence=1.0)
    silent.hear(1, SET_ZERO)
    silent.hear(1, NOTHING)
    assert silent.say() == []
    silent.arena[0] += 1.01
    silent.hear(1, NOTHING)
    assert len(silent.say()) == 1


@pytest.mark.parametrize(
    "drive, model, more",
    [
        (CubeMars, "AK80-9", {}),
        (CubeMarsV3, "AK80-9-V3.0", {}),
        (CubeMarsV3, "AK80-9-V3.0", {"report_rate": 500.0}),
        (CubeMarsServo, "AK80-9", {"report_rate": 500.0}),
        (RobStride, "RS02", {}),
        (RobStrideMIT, "RS02", {}),
    ],
)
def test_arming_waits_until_a_drive_replies_again_after_its_zero_was_set(drive, model, more):
    command = {"current_command" if drive is CubeMarsServo else "torque_command": 0.0}
    rig, outcome = imposed(
        still(0.3),
        drive=drive,
        model=model,
        commands=command,
        emulator={"zero_silence": 1.0},
        zero_at_arming=True,
        seconds=0.2,
        **more,
    )
    assert outcome.status == "ok" and rig.control.reports.zeros["knee"][0] == 1


def test_a_reply_packed_before_its_command_lacks_its_torque():
    limits = reference.ranges(50.0, 18.0)
    for first, torque in ((False, 4.0), (True, 0.0)):
        wired = Wired(EmulatedCubeMars, "AK80-9", can_id=1, reply_first=first)
        wired.hear(1, ENABLE)
        wired.say()
        wired.hear(1, torque_of(4.0))
        ((_, data),) = wired.say()
        assert reference.value((data[4] & 15) << 8 | data[5], *limits["torque"], 12) == pytest.approx(torque, abs=0.02)


def test_another_torque_constant_and_a_wrapped_reading():
    wired = Wired(EmulatedCubeMars, "AK80-9", can_id=1, torque_scale=0.8, wrap=2.0 * math.pi)
    wired.hear(1, ENABLE)
    wired.hear(1, torque_of(5.0))
    wired.step(position=4.0, velocity=0.0)
    ((_, data), (_, again)) = wired.say()
    assert wired["torque"] == pytest.approx(4.0, abs=0.02) and data == again
    assert reference.value(data[1] << 8 | data[2], -12.5, 12.5, 16) == pytest.approx(4.0 - 2.0 * math.pi, abs=1e-3)


@pytest.mark.parametrize(
    "drive, model, inputs", [(CubeMarsServo, "AK80-9", "current"), (CubeMarsV3, "AK80-9-V3.0", "torque")]
)
def test_boards_on_extended_frames_give_no_current_after_their_time_out(drive, model, inputs):
    with Diagram("robot", rate=200):
        emulator = drive(model, name="knee").emulator(command_timeout=1.0)
    wired = Wired(type(emulator), model, can_id=1, command_timeout=1.0)
    if drive is CubeMarsServo:
        wired.hear(1 << 8 | 1 | 0x80000000, (3000).to_bytes(4, "big"))
    else:
        wired.hear(8 << 8 | 1 | 0x80000000, bytes.fromhex("0000007fff7ffbff"))
    wired.step(position=0.0, velocity=0.0)
    before = wired["torque"]
    wired.arena[0] += 1.01
    wired.step(position=0.0, velocity=0.0)
    assert before > 1.0 and wired["torque"] == 0.0
