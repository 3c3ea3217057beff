"""A reported angle that changes by more than motion can explain removes stiffness and damping in that tick and ends
the run; motion of any kind, noise, late and lost replies do not.
"""

import math

import numpy as np
import pytest

from blocks.actuators import CubeMars, CubeMarsServo, CubeMarsV3, RobStride, RobStrideMIT
from tests.cext.imposed import accelerated, imposed, sine, still
from tests.soaking import crossed, soaked

RATES = [100, 200, 500, 1000]
MOUNTED = {"invert": True, "offset": -0.4, "gear_ratio": 1.5}
GAINS = {"stiffness_command": 30.0, "damping_command": 1.0, "position_command": 0.2}

DRIVES = {
    "AK80-9": (CubeMars, "AK80-9"),
    "AK80-64": (CubeMars, "AK80-64"),
    "AK80-9 V3.0": (CubeMarsV3, "AK80-9-V3.0"),
    "AKH70-48 V3.0": (CubeMarsV3, "AKH70-48"),
    "RS02": (RobStride, "RS02"),
    "RS02 in MIT mode": (RobStrideMIT, "RS02"),
    "AK80-9 in servo mode": (CubeMarsServo, "AK80-9"),
}


def turn_of(kind, model, mounted):
    """The angle of the joint in one turn of the motor."""
    return kind(model, name="probe", **(MOUNTED if mounted else {})).shift


def jumping(change, at=0.5, motion=None):
    motion = motion or still()

    def jumps(t):
        position, velocity = motion(t)
        return position + (change if t > at - 1e-9 else 0.0), velocity

    return jumps


def run_of(name, motion, mounted=False, commands=GAINS, **options):
    kind, model = DRIVES[name]
    if kind is CubeMarsServo:
        commands, options = {"current_command": 0.0}, {"report_rate": 500.0, **options}
    else:
        options = {"limit": 6.0, **options}
    return imposed(motion, drive=kind, model=model, commands=commands, **(MOUNTED if mounted else {}), **options)


# Jumps


@pytest.mark.hazard("H5e")
@pytest.mark.parametrize("name, rate, mounted", crossed(DRIVES, RATES, [False, True]))
def test_an_angle_that_jumps_by_a_motor_turn_at_rest_ends_the_run(name, rate, mounted):
    turn = turn_of(*DRIVES[name], mounted)
    if name == "AK80-64" and mounted and rate == 100:
        pytest.skip("0.065 rad in 10 ms are motion")
    for change in (turn, -turn):
        rig, outcome = run_of(name, jumping(change), mounted, rate=rate, seconds=0.7)
        assert (outcome.status, outcome.culprit) == ("position jump", "knee")
        waits = math.ceil(4 * rate / 500.0) / rate if "servo" in name else 0.0  # arming counts its reports
        assert 0.5 <= outcome.tick / rate + waits <= 0.5 + 2.0 / rate + 1e-9
        assert rig.watched["value"] == pytest.approx(change, abs=0.02) and rig.watched["bound"] < abs(turn)


@pytest.mark.hazard("H1c")
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("name", [name for name in DRIVES if "servo" not in name])
def test_after_a_jump_the_drive_gives_at_most_the_limit_from_the_tick_of_its_first_reply_on(name, rate):
    """Without a law that is adapted in that tick, K = 30 gives the limit and 30 N·m/rad of the jump."""
    limit = 6.0
    rig, outcome = run_of(name, jumping(turn_of(*DRIVES[name], False)), rate=rate, seconds=0.7, substeps=10)
    shows = 0.5 + 1.0 / rate  # the command of the tick that sees it is in force from here on
    torques = rig.torques[rig.torques[:, 0] >= 0.5 + rig.torques[0, 0] + 1.0 / rate + 1e-9]
    assert outcome.status == "position jump" and shows > 0.5
    assert np.abs(torques[:, 1]).max() <= limit + 0.04


@pytest.mark.parametrize("lost", [1, 2, 4, 8])
@pytest.mark.parametrize("rate", RATES)
def test_a_jump_across_lost_replies_is_found(rate, lost):
    """Up to 45 ms of silence. A motor turn of 0.7 rad in a longer silence can be motion."""
    if (lost + 1) / rate > 0.045:
        pytest.skip("a longer silence")
    emulator = {"dropped": lambda t: float(0.5 - 1e-9 <= t < 0.5 + (lost - 0.5) / rate)}
    _, outcome = run_of("AK80-9", jumping(2 * math.pi / 9, 0.5), rate=rate, seconds=0.8, emulator=emulator)
    assert outcome.status == "position jump" and outcome.tick / rate < 0.5 + (lost + 2) / rate + 1e-9


@pytest.mark.parametrize("speed", [-6.0, -2.0, 2.0, 6.0])
def test_a_jump_of_a_moving_joint_is_found(speed):
    for change in (0.35, -0.35):
        _, outcome = run_of("AK80-9", jumping(change, motion=lambda t: (speed * (t - 0.5), speed)), seconds=0.7)
        assert outcome.status == "position jump" and outcome.tick <= 102


def test_a_position_that_wraps_from_one_end_of_its_range_to_the_other_is_a_jump():
    """The firmware of some drives encodes 12.5 rad as -12.5 rad."""

    def wraps(t):
        angle = 12.2 + t
        return angle - 25.0 if angle > 12.5 else angle, 1.0

    _, outcome = imposed(wraps, commands=GAINS, limit=6.0)
    assert outcome.status == "position jump" and 0.3 <= outcome.tick / 200 < 0.32


def test_a_jump_of_torque_controlled_joint_is_a_fault_too():
    """A controller of the diagram uses the angle."""
    _, outcome = run_of("AK80-9", jumping(0.7), commands={"torque_command": 2.0}, seconds=0.7)
    assert outcome.status == "position jump"


# No jumps


def plausible(random, most, count=6):
    """A sum of sines up to 40 Hz with accelerations up to `most`, about as fast as joints are."""
    w = 2.0 * math.pi * 0.5 * 80.0 ** random.random(count)
    share = random.random(count)
    amplitude = np.minimum(most * share / share.sum() / w**2, 0.5)
    amplitude = np.minimum(amplitude, 4.0 / w)
    phase = 2.0 * math.pi * random.random(count)
    return lambda t: (float(np.sin(w * t + phase) @ amplitude), float(np.cos(w * t + phase) @ (amplitude * w)))


@pytest.mark.parametrize("rate, noise", crossed([50, 100, 200, 500, 1000, 2000], [0.0, 0.15, 1.2]))
def test_random_motion_with_late_and_lost_replies_is_no_jump(rate, noise):
    random = np.random.default_rng(rate)
    for _ in range(2):
        luck, due = np.random.default_rng(3), {}

        def late(t, luck=luck, due=due):
            return due.setdefault(t, luck.uniform(0.0, 1.5 / rate))

        rig, outcome = imposed(
            plausible(random, 900.0),
            rate=rate,
            substeps=8,
            seconds=min(2.0, 800 / rate),
            noise=noise,
            commands={"torque_command": 1.0},
            emulator={"dropped": lambda t: 0.1, "delay": late},
            timeout=0.2,
        )
        assert outcome.status == "ok", rig.watched


@pytest.mark.parametrize("lag", soaked([0.0, 0.003, 0.01], but=[0, 2]))
@pytest.mark.parametrize("rate", soaked(RATES, but=[0, 3]))
@pytest.mark.parametrize("acceleration", [600.0, 980.0])
def test_an_impact_is_no_jump(acceleration, rate, lag):
    """Landing from a jump, 10 ms long, with a velocity that a filter delays: it is for the acceleration watch."""
    for begin in (0.3, 0.3 + 0.4 / rate):
        given = accelerated(acceleration, begin, until=0.01 * acceleration)
        _, outcome = imposed(
            lambda t, given=given: (given(t)[0], given(t - lag)[1]),
            rate=rate,
            substeps=10,
            seconds=0.5,
            commands={"damping_command": 0.3},
            limit=9.0,
        )
        assert outcome.status == "ok"


@pytest.mark.parametrize("rate", RATES)
def test_a_blow_that_stops_and_returns_within_a_period_is_no_jump(rate):
    """3000 rad/s² for 2 ms and back."""

    def blow(t):
        x = t - 0.3
        if x < 0.0:
            return 0.0, 0.0
        if x < 0.002:
            return 1500.0 * x * x, 3000.0 * x
        if x < 0.004:
            return 0.012 - 1500.0 * (0.004 - x) ** 2, 3000.0 * (0.004 - x)
        return 0.012, 0.0

    _, outcome = imposed(blow, rate=rate, substeps=20, seconds=0.4, commands=GAINS, limit=6.0)
    assert outcome.status == "ok"


def test_a_joint_that_rests_beyond_the_end_of_its_range_is_no_jump():
    """The drive reports the end of its range, and a velocity."""
    _, outcome = imposed(sine(14.0, 0.1), seconds=6.0, commands={"torque_command": 0.0})
    assert outcome.status == "ok"


def test_replies_that_arrive_in_bursts_are_no_jumps():
    """As with an adapter that delivers every 16 ms what it has received."""
    _, outcome = imposed(
        sine(0.5, 2.0),
        rate=1000,
        seconds=2.0,
        commands={"torque_command": 0.0},
        emulator={"delay": lambda t: 0.016 - (t + 1e-9) % 0.016},
    )
    assert outcome.status == "ok"
