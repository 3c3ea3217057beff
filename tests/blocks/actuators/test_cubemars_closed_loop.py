"""A drive, its emulator and a limb, through the wire and back, against closed forms."""

import math

import numpy as np
import pytest

from blocks.actuators import CubeMars
from blocks.controllers import Impedance
from blocks.limiters import TorqueLimiter
from blocks.models import Limb
from blocks.sources import Sine
from graph import Diagram
from tests.blocks.actuators import reference
from tests.blocks.actuators.wire import Wired
from tests.blocks.running import run

POSITION_STEP = 25.0 / 65535  # rad, one code
RATE, SUBSTEPS = 500, 20
INERTIA = 0.05  # kg·m²


def joint(robot, *, inertia=INERTIA, damping=0.0, start=0.0, path="drive"):
    """The plant of one joint: the drive on a free inertia with a viscous friction."""
    with Diagram("joint", rate=RATE * SUBSTEPS) as plant:
        emulated = robot[path].emulator()
        limb = Limb(inertia=inertia, damping=damping, stiffness=0.0, reflex=0.0, start=start)
        limb(torque=emulated.torque)
        emulated(position=limb.position, velocity=limb.velocity)
    return plant


def understood(invert=False, offset=0.0, **commands):
    """What an AK80-9 makes of constant commands, as seen from the joint: truncated to codes at the motor."""
    drive = Wired(CubeMars, "AK80-9", limit="peak", invert=invert, offset=offset)
    ((_, data),) = drive.say(**commands)
    heard, sign = reference.read_command(reference.ranges(50.0, 18.0), data), -1.0 if invert else 1.0
    return {
        **heard,
        "position": sign * heard["position"] - offset,
        "velocity": sign * heard["velocity"],
        "torque": sign * heard["torque"],
    }


def second_order(t, target, stiffness, damping, inertia):
    """Step response of I θ'' = K (θ₀ − θ) − B θ' from rest, under-damped."""
    natural = math.sqrt(stiffness / inertia)
    ratio = damping / (2.0 * math.sqrt(stiffness * inertia))
    assert ratio < 1.0
    damped = natural * math.sqrt(1.0 - ratio**2)
    return target * (
        1.0 - np.exp(-ratio * natural * t) * (np.cos(damped * t) + ratio * natural / damped * np.sin(damped * t))
    )


@pytest.mark.parametrize("invert, offset", [(False, 0.0), (True, 0.0), (False, 0.6), (True, -0.6)])
@pytest.mark.parametrize("stiffness, damping", [(20.0, 0.2), (60.0, 1.5), (20.0, 0.0)])
def test_a_position_loop_in_the_drive_answers_as_a_second_order_system(invert, offset, stiffness, damping):
    """Within one code of position and 1 % of the step: Euler's error over 1 s at 10 kHz is ω dt / 2, 0.2 % a radian of
    phase at most.

    The reply to the command of tick k is received at tick k + 1 and describes the instant k.
    """
    target = 0.2
    with Diagram("loop", rate=RATE) as robot:
        drive = CubeMars("AK80-9", limit="peak", invert=invert, offset=offset, name="drive")
        drive(position_command=target, stiffness_command=stiffness, damping_command=damping)
    recording = run(robot, RATE, plant=joint(robot), substeps=SUBSTEPS)
    assert recording.outcome.status == "ok" and recording.outcome.unconfirmed == ()
    heard = understood(invert, offset, position_command=target, stiffness_command=stiffness, damping_command=damping)
    t = recording.time[:-1]
    wanted = second_order(t, target, heard["stiffness"], heard["damping"], INERTIA)
    error = recording["drive.position"][1:] - wanted
    assert np.abs(error).max() < 2 * POSITION_STEP + 0.01 * target
    # The drive's own torque, from the same law: within a code of torque, and one of position and velocity times the
    # gains.
    position, velocity, torque = (recording[f"drive.{name}"][1:] for name in ("position", "velocity", "torque"))
    law = (
        heard["stiffness"] * (heard["position"] - position)
        + heard["damping"] * (heard["velocity"] - velocity)
        + heard["torque"]
    )
    codes = 36.0 / 4095 + heard["stiffness"] * POSITION_STEP + heard["damping"] * 100.0 / 4095
    assert np.abs(torque - law).max() < codes + 1e-9


def test_a_constant_torque_on_a_free_inertia_accelerates_it_evenly():
    """θ = τ t² / 2 I and ω = τ t / I, with Euler's first-order error τ t dt / 2 I and one code."""
    torque = 1.0
    with Diagram("push", rate=RATE) as robot:
        CubeMars("AK80-9", name="drive")(torque_command=torque)
    recording = run(robot, 201, plant=joint(robot), substeps=SUBSTEPS)
    given = understood(torque_command=torque)["torque"]
    t, step = recording.time[:-1], 1.0 / (RATE * SUBSTEPS)
    theta = given * t**2 / (2.0 * INERTIA)
    assert np.abs(recording["drive.position"][1:] - theta).max() < POSITION_STEP + given * t[-1] * step / INERTIA
    assert np.abs(recording["drive.velocity"][1:] - given * t / INERTIA).max() < 100.0 / 4095 + given * step / INERTIA
    assert np.abs(recording["drive.torque"][2:] - given).max() < 36.0 / 4095


def test_the_torque_of_a_joint_never_passes_the_peak_of_its_motor():
    """A stiff loop far from its target asks 250 N·m; it gets its limit, 18 N·m less rounding; the joint's speed stays
    within that.
    """
    with Diagram("far", rate=RATE) as robot:
        drive = CubeMars("AK80-9", limit="peak", name="drive")
        drive(position_command=1.0, stiffness_command=250.0, damping_command=5.0)
    recording = run(robot, 100, plant=joint(robot), substeps=SUBSTEPS)
    torque, t = recording["drive.torque"][1:], recording.time[:-1]
    assert 17.9 < torque.max() <= 18.0 and torque.min() >= -18.0
    assert np.all(np.abs(recording["drive.velocity"][1:]) <= 18.0 * t / INERTIA + 100.0 / 4095)


def test_a_spring_in_the_drive_neither_makes_nor_loses_energy():
    """Twenty swings of an undamped loop: K (θ₀ − θ)² / 2 + I ω² / 2 stays within 3 %; the codes of velocity alone are 1
    %.
    """
    with Diagram("swing", rate=RATE) as robot:
        drive = CubeMars("AK80-9", limit="peak", name="drive")
        drive(position_command=0.3, stiffness_command=50.0)
    stiffness = understood(stiffness_command=50.0)["stiffness"]
    period = 2.0 * math.pi * math.sqrt(INERTIA / stiffness)
    recording = run(robot, int(20 * period * RATE), plant=joint(robot), substeps=SUBSTEPS)
    position, velocity = recording["drive.position"][1:], recording["drive.velocity"][1:]
    energy = 0.5 * stiffness * (0.3 - position) ** 2 + 0.5 * INERTIA * velocity**2
    assert np.abs(energy / energy[0] - 1.0).max() < 0.03


def test_work_of_the_drive_equals_energy_of_the_limb_plus_friction():
    """W = ∫ τ ω dt against I ω² / 2 + ∫ d ω² dt: within 2 % of the work, trapezoids at 500 Hz on coded signals."""
    friction = 0.05
    with Diagram("work", rate=RATE) as robot:
        torque = TorqueLimiter(limit=5.0)(Sine(2.0, 1.5, name="torque")())
        CubeMars("AK80-9", name="drive")(torque_command=torque)
    recording = run(robot, 1000, plant=joint(robot, damping=friction), substeps=SUBSTEPS)
    torque, velocity = recording["drive.torque"][1:], recording["drive.velocity"][1:]
    held = 0.5 * INERTIA * velocity**2

    def integral(power):
        return np.concatenate(([0.0], np.cumsum(0.5 * (power[1:] + power[:-1])) / RATE))

    balance = integral(torque * velocity) - held - integral(friction * velocity**2)
    assert held.max() > 1.0 and np.abs(balance).max() < 0.02 * np.abs(integral(np.abs(torque * velocity))).max()


def test_an_impedance_in_the_diagram_closes_the_same_loop_one_tick_later():
    """Feedback of the last tick and torque held over a tick are a delay of 1.5 ticks, which takes K · 1.5 T of the
    damping.
    """
    stiffness, damping, target = 20.0, 1.0, 0.2
    with Diagram("impedance", rate=RATE) as robot:
        drive = CubeMars("AK80-9", name="drive")
        torque = Impedance(stiffness=stiffness, damping=damping)(drive.position, drive.velocity, target)
        drive(torque_command=TorqueLimiter(limit=9.0, slew=math.inf)(torque))
    recording = run(robot, RATE, plant=joint(robot), substeps=SUBSTEPS)
    t = recording.time[:-1]
    inertia = INERTIA + stiffness * (1.5 / RATE) ** 2 / 2.0 - damping * 1.5 / RATE
    wanted = second_order(t, target, stiffness, damping - stiffness * 1.5 / RATE, inertia)
    assert np.abs(recording["drive.position"][1:] - wanted).max() < 0.02 * target
    assert abs(recording["drive.position"][-1] - target) < 0.005 * target + POSITION_STEP


def test_arming_enables_drive_and_safe_stop_disables_it():
    with Diagram("life", rate=RATE) as robot:
        CubeMars("AK80-9", name="drive")(torque_command=1.0)
    plant = joint(robot)
    recording = run(robot, 10, plant=plant, substeps=SUBSTEPS, fade=1.0)
    assert recording.outcome.status == "ok" and recording.outcome.unanswered == recording.outcome.unconfirmed == ()
    assert recording.statistics["frames"]["foreign"] == recording.statistics["frames"]["malformed"] == 0


def test_a_diverging_plant_ends_the_run_and_names_the_drive():
    with Diagram("robot", rate=RATE) as robot:
        CubeMars("AK80-9", name="drive")(torque_command=0.0)
    with Diagram("broken", rate=RATE) as plant:
        emulated = robot["drive"].emulator()
        limb = Limb(inertia=1e-150, damping=1e6, stiffness=0.0, reflex=0.0, start=1.0)
        limb(torque=emulated.torque, rate=1.0)
        emulated(position=limb.position, velocity=limb.velocity)
    recording = run(robot, 200, plant=plant)
    assert recording.outcome.status == "not finite" and recording.outcome.culprit == "emulated_cube_mars"
    assert np.isfinite(recording["drive.position"]).all()
