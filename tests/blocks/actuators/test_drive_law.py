"""The law that a drive closes by itself stays inside the torque limit, and is the wanted one as far as the limit
allows.
"""

import csv
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from blocks.actuators import CubeMars, EmulatedCubeMars
from blocks.models import Limb
from blocks.sources import Sine
from graph import Block, Diagram, DiagramError, Input, Output, Param
from tests.blocks.actuators.drives_observed import KINDS, observed
from tests.blocks.actuators.observer import torque_of, worst
from tests.blocks.actuators.wire import AUTHORITY, OUT_OF_LIMITS
from tests.cext.rigs import Rig
from tests.shared import shared
from tests.soaking import soaked

FIELDS = ("position", "velocity", "stiffness", "damping", "torque")


def constant(**commands):
    return lambda t: commands


def sine(amplitude, frequency):
    """Position, velocity and acceleration of a joint that is turned to and fro."""
    w = 2.0 * math.pi * frequency
    return lambda t: (amplitude * np.sin(w * t), amplitude * w * np.cos(w * t), -amplitude * w * w * np.sin(w * t))


def from_rest(speed, duration, at):
    """Even acceleration from rest to a speed."""

    def motion(t):
        u = np.maximum(np.asarray(t, float) - at, 0.0)
        position = speed / duration * np.where(u < duration, 0.5 * u * u, duration * (u - 0.5 * duration))
        return position, speed / duration * np.minimum(u, duration), speed / duration * ((u > 0.0) & (u < duration))

    return motion


def shaking(random, most, count=6):
    """A sum of sines from 0.5 to 40 Hz whose acceleration never passes `most`."""
    w = 2.0 * math.pi * 0.5 * 80.0 ** random.random(count)
    share = random.random(count)
    amplitude = np.minimum(most * share / share.sum() / w**2, 0.5)
    phase = 2.0 * math.pi * random.random(count)

    def motion(t):
        angle = np.multiply.outer(t, w) + phase
        return np.sin(angle) @ amplitude, np.cos(angle) @ (amplitude * w), -np.sin(angle) @ (amplitude * w * w)

    return motion


# What the limit is about.

MOTIONS = {
    "AK80-9 with damping 2, 2 Hz": ("AK80-9", 200, 5.0, {"damping": 2.0}, sine(0.55, 2.0)),
    "AK80-9 with damping 5, 5 Hz": ("AK80-9", 200, 9.0, {"damping": 5.0}, sine(0.2, 5.0)),
    "AK80-9 with damping 5 at 100 Hz": ("AK80-9", 100, 5.0, {"damping": 5.0}, sine(0.55, 1.0)),
    "AK80-9 with a spring of 300, hit": ("AK80-9", 200, 9.0, {"stiffness": 300.0}, from_rest(6.0, 0.01, 0.1)),
    "AK10-9 with 300 and 5, hit": (
        "AK10-9",
        200,
        12.0,
        {"stiffness": 300.0, "damping": 5.0},
        from_rest(6.0, 0.01, 0.1),
    ),
    "AK10-9 V3.0 with damping 5, 5 Hz": ("AK10-9 V3.0", 200, 10.0, {"damping": 5.0}, sine(0.2, 5.0)),
    "RS03 in MIT protocol with damping 50, 5 Hz": ("RS03 MIT", 200, 10.0, {"damping": 50.0}, sine(0.2, 5.0)),
    "RS02 with 100 and 5, 3 Hz": ("RS02", 200, 6.0, {"stiffness": 100.0, "damping": 5.0}, sine(0.4, 3.0)),
}


@pytest.mark.parametrize("mounted", [False, True], ids=["plain", "inverted, offset and geared"])
@pytest.mark.parametrize("case", MOTIONS)
def test_imposed_motion_meets_at_most_the_torque_limit(case, mounted):
    """To one code of torque. The hits accelerate with 600 rad/s², which is beyond the assumption, and stay inside its
    margin.
    """
    name, rate, limit, commands, motion = MOTIONS[case]
    for age, late in ((1.0, 0.0), (0.05, 0.0), (1.0, 1.0), (2.0, 1.0)):
        drive = observed(name, rate, mounted, limit=limit)
        _, torques, _, wanted = drive.follow(motion, 0.6, constant(**commands), age, late)
        assert np.abs(torques).max() <= limit + drive.torque_code, (age, late)
        assert np.abs(wanted).max() > limit, "the whole law asks for more"


@pytest.mark.parametrize("mounted", [False, True], ids=["plain", "inverted, offset and geared"])
@pytest.mark.parametrize("name", soaked(KINDS, but=[0, 2, 4]))
def test_random_motion_within_assumption_meets_at_most_the_limit(name, mounted):
    random = np.random.default_rng(sum(map(ord, name)) + mounted)
    for rate in (100, 200, 333, 500, 1000):
        for trial in range(4):
            limit = random.uniform(0.1, 1.0) * observed(name, rate, mounted).limit
            drive = observed(name, rate, mounted, limit=limit)
            most = dict(zip(FIELDS, drive.wired["limits"]))
            commands = {
                "position": random.uniform(-1.0, 1.0),
                "velocity": random.uniform(-3.0, 3.0),
                "torque": limit * random.uniform(-1.0, 1.0),
                "stiffness": most["stiffness"] * random.random() ** 4,
                "damping": most["damping"] * random.random() ** 2,
            }
            if trial == 3:
                drive.wired.arena[AUTHORITY] = share = random.random()  # while commands fade in
                limit *= share
            times, torques, acceleration, _ = drive.follow(
                shaking(random, 500.0), 0.25, constant(**commands), 1.0, 1.0, random
            )
            assert acceleration.max() <= 500.0
            assert np.abs(torques).max() <= limit + drive.torque_code, (rate, commands)


@pytest.mark.hazard("H1c")
@given(data=st.data(), name=st.sampled_from(sorted(KINDS)), mounted=st.booleans())
def test_any_command_stays_within_the_limit_over_every_motion_until_a_late_frame(data, name, mounted):
    drive = observed(name, data.draw(st.sampled_from([100, 200, 500, 1000]), label="rate"), mounted)
    limit = drive.limit * data.draw(st.floats(0.01, 1.0), label="share of the peak")
    acceleration = data.draw(st.sampled_from([1.0, 50.0, 500.0, 5000.0]), label="acceleration")
    drive = drive.again(1.0 / drive.period, limit, acceleration)
    position_end, velocity_end = drive.wired["wire"][:2]
    position = data.draw(st.floats(-1.0, 1.0), label="position") * (position_end + abs(drive.offset))
    velocity = data.draw(st.floats(-1.0, 1.0), label="velocity") * velocity_end
    age = data.draw(st.floats(0.0, 2.5), label="age") * drive.period
    commands = {
        f: top * data.draw(st.floats(0.0 if f in ("stiffness", "damping") else -1.0, 1.0), label=f)
        for f, top in zip(FIELDS, drive.wired["limits"])
    }
    lowered = data.draw(st.sampled_from([1.0, 1.0, 0.5, 0.0]), label="share of the limit")
    allowed = data.draw(st.sampled_from([1.0, 1.0, 0.3, 0.0]), label="share of gains")
    drive.wired["limits"] = [*drive.wired["limits"][:5], limit * lowered, allowed]
    drive.hear(position, velocity, age)
    law = drive.law(**commands)
    at_end = abs(velocity) >= 0.999 * velocity_end or abs(position + drive.offset) >= 0.999 * position_end
    if not at_end:
        assert worst(law, position, velocity, age, drive.period, acceleration) <= limit * lowered + drive.torque_code
    else:
        assert law[2] == law[3] == 0.0 and abs(law[4]) <= limit * lowered + drive.torque_code
    assert law[2] <= allowed * commands["stiffness"] + 1e-9 and law[3] <= allowed * commands["damping"] + 1e-9


def test_the_bound_includes_the_truncation_of_opposing_gains():
    """RS03: a code of stiffness is 1.22 N·m/rad. A spring of 250 N·m, 5 rad from its rest, and a damper of 250 N·m
    leave nothing as they are wanted; as codes they leave 6 N·m.
    """
    for position, velocity in ((5.0, -2.5), (-5.0, 2.5)):
        drive = observed("RS03 MIT", 1000, limit=4.0, acceleration=1.0)
        drive.hear(0.0, 0.0, 0.0)
        law = drive.law(position=position, velocity=velocity, stiffness=50.0, damping=99.99)
        assert worst(law, 0.0, 0.0, 0.0, drive.period, 1.0) <= 4.0 + drive.torque_code


@pytest.mark.parametrize("name", ["RS03 MIT", "AK80-9"])
@pytest.mark.parametrize("share", [0.002, 0.05, 0.3])
def test_opposing_gains_stay_within_the_share_of_the_limit_during_fade_in(name, share):
    """A spring and a damper that cancel each other: their codes must still do so when both are small."""
    drive = observed(name, 1000, limit=8.0, acceleration=1.0)
    top = drive.wired["limits"][2:4]
    drive.wired.arena[AUTHORITY] = share
    drive.hear(0.0, 0.0, 0.0)
    for damping in np.linspace(0.3, 0.9, 40) * top[1]:
        law = drive.law(position=5.0, velocity=-2.5, stiffness=0.5 * damping, damping=damping)
        assert worst(law, 0.0, 0.0, 0.0, drive.period, 1.0) <= 8.0 * share + drive.torque_code


@pytest.mark.hazard("H1c")
def test_closed_loop_torque_under_hard_motion_stays_within_the_limit():
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
    assert rig["knee.limited"][-1] > 100  # it acts, and often
    assert 3.9 < abs(rig["knee.torque"]).max() <= 4.0 + 36.0 / 4095


class Mover(Block):
    """Moves a joint whatever torque acts on it, and keeps the torques."""

    amplitude, frequency = Param(0.0, "rad"), Param(0.0, "Hz")
    torque = Input("N·m")
    position, velocity = Output("rad"), Output("rad/s")

    feedthrough = ()

    def reset(self):
        self.felt = []

    def step(self, t):
        w = 2.0 * math.pi * self.frequency
        return self.amplitude * math.sin(w * t), self.amplitude * w * math.cos(w * t)

    def update(self, torque):
        self.felt.append(torque)


@pytest.mark.parametrize("name", ["AK80-9", "RS02", "RS03 MIT", "AK10-9 V3.0"])
def test_imposed_motion_in_closed_loop_meets_at_most_the_limit(name):
    """Ages as the loop measures them, 20 instants a tick; with the drive's own emulator, whose law is compared
    elsewhere.
    """
    kind, model, _ = KINDS[name]
    with Diagram("robot", rate=200) as robot:
        knee = kind(model, name="knee", limit=5.0)
        knee(position_command=0.2, stiffness_command=20.0, damping_command=3.0)
    with Diagram("plant", rate=4000) as plant:
        motor = robot["knee"].emulator()
        mover = Mover(amplitude=0.2, frequency=5.0)
        motor(position=mover.position, velocity=mover.velocity)
        mover(torque=motor.torque)
    rig = Rig(robot, plant)
    assert rig.run(200).status == "ok"
    assert 4.9 < np.abs(mover.felt).max() <= 5.0 + 2.0 * knee.wire[4] / 4095 and rig["knee.limited"][-1] > 50


# What is left of the impedance.


def strides(*harmonics):
    """A stride a second, of (cosine, sine) in rad of each harmonic."""

    def motion(t):
        position = velocity = acceleration = 0.0
        for k, (a, b) in enumerate(harmonics):
            w = 2.0 * math.pi * k
            position = position + a * np.cos(w * t) + b * np.sin(w * t)
            velocity = velocity + w * (b * np.cos(w * t) - a * np.sin(w * t))
            acceleration = acceleration - w * w * (a * np.cos(w * t) + b * np.sin(w * t))
        return position, velocity, acceleration

    return motion


KNEE = strides((0.42, 0.0), (0.05, -0.36), (-0.27, 0.06), (-0.02, 0.07))  # about as people walk: flexion to 1 rad
HIP = strides((0.2, 0.0), (0.36, 0.0), (-0.06, -0.05), (0.01, 0.02))


def error_on(motion, seconds, limit, name="AK10-9", **commands):
    """RMS of the drive's torque against the whole law cut to the limit, as a share of the limit; at 200 Hz, for 300
    rad/s².
    """
    drive = observed(name, limit=limit, acceleration=300.0)
    _, torques, acceleration, wanted = drive.follow(motion, seconds, constant(**commands))
    assert acceleration.max() < 300.0 and np.abs(torques).max() <= limit + drive.torque_code
    return math.sqrt(np.mean((torques - np.clip(wanted, -limit, limit)) ** 2)) / limit


IMPEDANCES = {"knee": ("AK10-9", 12.0, {"stiffness": 30.0, "damping": 1.0}), "hip": ("AK80-9", 9.0, {"damping": 2.0})}


@pytest.mark.parametrize("joint, motion", [("knee", KNEE), ("hip", HIP)])
def test_torque_error_on_walking_joint_is_within_3_percent_of_limit(joint, motion):
    name, limit, commands = IMPEDANCES[joint]
    for rest in (0.0, 0.4):
        assert error_on(motion, 2.0, limit, name, position=rest, **commands) < 0.03


@pytest.mark.parametrize("joint", soaked(IMPEDANCES, but=[0]))
def test_torque_error_on_recorded_gait_is_within_3_percent_of_limit(joint):
    name, limit, commands = IMPEDANCES[joint]
    with shared("gait/healthy_young.csv").open() as file:
        angle = np.radians([float(row[f"{joint}_flexion_lt_deg"]) for row in csv.DictReader(file)])
    played = CubicSpline(np.arange(len(angle)) / 200.0, angle)
    for rest in (0.0, 0.4):
        assert (
            error_on(lambda t: (played(t), played(t, 1), played(t, 2)), 10.0, limit, name, position=rest, **commands)
            < 0.03
        )


def test_within_the_limit_the_law_is_sent_unchanged():
    drive = observed("AK80-9")
    drive.hear(0.1, 0.2, drive.period)
    law = drive.law(position=0.0, velocity=0.5, stiffness=20.0, damping=0.5, torque=1.0)
    assert law == pytest.approx([0.0, 0.5, 20.0, 0.5, 1.0], abs=500.0 / 4095) and drive.wired["limited"] == 0.0


def test_a_stiff_spring_far_from_its_rest_pulls_with_the_limit_and_it_counts():
    drive = observed("AK80-9", limit=9.0)
    drive.hear(1.0, 0.0, drive.period)
    law = drive.law(position=0.0, stiffness=100.0, damping=1.0)
    assert torque_of(law, 1.0, 0.0) == pytest.approx(-9.0, abs=0.01) and drive.wired["limited"] == 1.0


def test_feed_forward_at_the_limit_removes_gains_that_add_to_it():
    drive = observed("AK80-9", limit=9.0)
    drive.hear(1.0, 0.0, drive.period)
    assert drive.law(position=0.0, stiffness=100.0, damping=1.0, torque=-9.0)[2:] == pytest.approx(
        [0.0, 0.0, -9.0], abs=0.01
    )
    against = drive.law(position=0.7, stiffness=40.0, damping=0.5, torque=9.0)
    assert torque_of(against, 1.0, 0.0) == pytest.approx(-3.0, abs=0.1), "9 N·m less 0.3 rad of 40 N·m/rad"


def test_stop_damping_is_limited_to_the_encoded_range():
    """2 limit / (a Δ) = 2 · 9 / (500 · 0.015) = 2.4 of 5 N·m·s/rad, in the torque; at rest the gain is half of that."""
    drive = observed("AK80-9", limit=9.0)
    drive.hear(0.0, 2.0, drive.period)
    assert torque_of(drive.law(damping=5.0), 0.0, 2.0) == pytest.approx(-4.8, abs=0.1)
    drive.hear(0.0, 0.0, drive.period)
    assert drive.law(damping=5.0)[3] == pytest.approx(1.2, abs=0.02)


# Where the cases meet.


def present_torque(drive, position, velocity, **commands):
    drive.hear(position, velocity, drive.period)
    return torque_of(drive.law(**commands), position, velocity)


@pytest.mark.parametrize(
    "commands",
    soaked(
        [
            {"stiffness": 60.0, "damping": 2.0},
            {"stiffness": 60.0},
            {"damping": 3.0},
            {"stiffness": 20.0, "damping": 0.3, "torque": 4.0},
        ],
        but=[0, 3],
    ),
)
@pytest.mark.parametrize("limit, velocity", soaked([(9.0, 0.0), (9.0, 1.5), (15.0, -1.0)], but=[1, 2]))
def test_along_a_fine_sweep_of_the_state_the_torque_at_the_state_has_no_jump(commands, limit, velocity):
    """Steps of a tenth of a code beside the largest slope that the wanted law has, and the codes of gains over what
    moves.
    """
    drive = observed("RS02", limit=limit)  # 16 bits
    for sweep in (np.linspace(-1.5, 1.5, 3001), np.linspace(-8.0, 8.0, 3001)):
        turns = sweep[-1] > 2.0
        torques = np.array([present_torque(drive, *((0.1, v) if turns else (v, velocity)), **commands) for v in sweep])
        slope = (
            (commands.get("damping", 0.0) + 0.03 * commands.get("stiffness", 0.0))
            if turns
            else commands.get("stiffness", 0.0)
        )
        assert np.abs(np.diff(torques)).max() <= 1.5 * slope * (sweep[1] - sweep[0]) + 0.05
        assert torques.max() - torques.min() > 0.5 or slope == 0.0, "the sweep crosses the cases"


def test_torque_is_continuous_as_gains_are_reduced():
    drive = observed("RS02", limit=9.0)
    torques = []
    for allowed in np.linspace(1.0, 0.0, 201):
        drive.wired["limits"] = [*drive.wired["limits"][:6], allowed]
        torques.append(present_torque(drive, 0.1, -0.5, stiffness=60.0, damping=2.0))
    assert np.abs(np.diff(torques)).max() < 0.1


# A free joint.


@pytest.mark.parametrize("rate", soaked([100, 200, 500, 1000], but=[0, 3]))
@pytest.mark.parametrize("stiffness, damping", [(0.0, 5.0), (30.0, 1.0), (100.0, 3.0), (500.0, 5.0)])
def test_a_free_joint_stops_with_damping(rate, stiffness, damping):
    """0.05 kg·m², thrown at 8 rad/s, and let go 0.5 rad from the rest of its spring."""
    for position, velocity in ((0.0, 8.0), (0.5, 0.0)):
        drive = observed("AK80-9", rate, limit=9.0)
        _, speed, torque = drive.move(0.05, 1.0, constant(stiffness=stiffness, damping=damping), position, velocity)
        assert np.abs(speed[-len(speed) // 5 :]).max() < 0.1 and np.abs(torque).max() <= 9.0 + drive.torque_code


@pytest.mark.parametrize("rate", [100, 200, 500, 1000])
@pytest.mark.parametrize("stiffness", [100.0, 300.0])
def test_a_spring_without_damping_gives_a_free_joint_no_energy(rate, stiffness):
    """0.05 kg·m², thrown at 8 rad/s. It never turns faster than it was thrown."""
    drive = observed("AK80-9", rate, limit=9.0)
    _, speed, torque = drive.move(0.05, 2.0, constant(stiffness=stiffness), 0.0, 8.0)
    assert np.abs(speed).max() <= 8.0 * 1.001 and np.abs(torque).max() <= 9.0 + drive.torque_code


# Torque alone.


def test_a_torque_alone_needs_no_feedback_and_is_not_counted():
    drive = observed("AK80-9")
    drive.wired["age"] = 1.0
    assert (
        drive.law(torque=3.0)[2:] == pytest.approx([0.0, 0.0, 3.0], abs=36.0 / 4095) and drive.wired["limited"] == 0.0
    )


@pytest.mark.parametrize("torque", [5.0, -5.0])
def test_lowered_limit_clips_torque_without_refusing_it(torque):
    drive = observed("AK80-9")
    drive.wired["limits"] = [*drive.wired["limits"][:5], 3.0, 1.0]
    sent = drive.law(torque=torque)[4]
    assert (
        abs(sent) <= 3.0
        and sent == pytest.approx(math.copysign(3.0, torque), abs=36.0 / 4095)
        and drive.wired["limited"] == 1.0
    )


@pytest.mark.parametrize(
    "age, kept",
    [(2.0, True), (2.0 + 1e-7, True), (2.0 + 5e-7, False), (2.1, False), (math.inf, False), (math.nan, False)],
)
def test_feedback_older_than_two_ticks_leaves_only_feed_forward(age, kept):
    drive = observed("AK80-9", limit=9.0)
    drive.hear(0.2, 0.0, age * drive.period)
    law = drive.law(stiffness=10.0, damping=0.2, torque=3.0)
    if kept:
        assert torque_of(law, 0.2, 0.0) == pytest.approx(1.0, abs=0.1) and law[2] > 5.0
    else:
        assert law[2:] == pytest.approx([0.0, 0.0, 3.0], abs=36.0 / 4095) and drive.wired["limited"] == 1.0


@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize("end", ["position", "velocity"])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_at_the_ends_of_the_encoded_ranges_only_torque_is_commanded(name, end, sign):
    """A code at its end may stand for anything beyond. With damping the wanted torque, as it is inside the ranges."""
    drive = observed(name, limit=5.0)
    position, velocity = (
        drive.wired["wire"][:2] * (1.0, 0.0) if end == "position" else drive.wired["wire"][:2] * (0.0, 1.0)
    )
    drive.hear(sign * position, sign * velocity, drive.period)
    law = drive.law(stiffness=2.0, damping=0.1)
    assert law[2] == law[3] == 0.0 and law[4] == pytest.approx(
        -5.0 * sign if end == "position" else -velocity * 0.1 * sign, abs=1.0
    )


@pytest.mark.parametrize("name", KINDS)
def test_nan_limit_or_gain_scale_has_no_torque(name):
    drive = observed(name, limit=5.0)
    drive.hear(0.5, 1.0, drive.period)
    limits = drive.wired["limits"]
    drive.wired["limits"] = [*limits[:6], math.nan]
    law = drive.law(position=-0.5, stiffness=100.0, damping=1.0)
    assert worst(law, 0.5, 1.0, drive.period, drive.period, 500.0) <= 5.0 + drive.torque_code
    for bad in (math.nan, -1.0):
        drive.wired["limits"] = [*limits[:5], bad, 1.0]
        assert drive.wired.say(torque_command=3.0) == OUT_OF_LIMITS


@pytest.mark.parametrize("acceleration", [0.0, -1.0, math.inf, math.nan, 2e5])
def test_invalid_max_acceleration_is_refused(acceleration):
    with pytest.raises(DiagramError, match="max_acceleration"):
        CubeMars("AK80-9", max_acceleration=acceleration)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("what", ["position", "velocity"])
def test_with_nan_feedback_only_feed_forward_is_sent(what, bad):
    drive = observed("AK80-9")
    drive.wired[what] = bad
    assert drive.law(stiffness=20.0, damping=1.0, torque=3.0)[2:] == pytest.approx([0.0, 0.0, 3.0], abs=36.0 / 4095)
