"""The figures that `check` prints of a law that the drive closes, against the law itself."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest

from blocks.actuators import CubeMars, CubeMarsServo, CubeMarsV3, RobStride, RobStrideMIT
from blocks.actuators.law_figures import Law
from graph import Interval
from tests.blocks.actuators.drives_observed import observed
from tests.blocks.actuators.observer import torque_of
from tests.soaking import crossed

NOTHING = Interval.point(0.0)


def law(limit=9.0, acceleration=500.0, rate=200.0, stiffness=0.0, damping=0.0):
    return Law(limit, acceleration, 1.0 / rate, Interval(0.0, stiffness), Interval(0.0, damping))


def is_calm(make, inertia, **gains):
    """Whether a free joint, thrown or let go, comes to rest: at the end its speed still falls, or is a few codes."""
    for position, velocity in ((0.0, 8.0), (0.6, 0.0), (0.3, -12.0)):
        _, speed, _ = make().move(inertia, 1.5, lambda t: gains, position, velocity)
        before, late = (
            np.abs(speed[begin:end]).max()
            for begin, end in ((-len(speed) // 4, -len(speed) // 8), (-len(speed) // 8, len(speed)))
        )
        if late > 0.3 and late > 0.95 * before:
            return False
    return True


@pytest.mark.parametrize("rate, figures", crossed([100, 200, 500], [(9.0, 500.0), (9.0, 250.0), (3.0, 500.0)]))
def test_a_free_joint_of_the_smallest_inertia_does_not_chatter(rate, figures):
    limit, acceleration = figures
    for stiffness, damping in ((0.0, 5.0), (30.0, 1.0), (100.0, 3.0), (300.0, 0.2), (500.0, 5.0)):
        smallest = law(limit, acceleration, rate, stiffness, damping).smallest_inertia
        make = partial(observed, "AK80-9", rate, limit=limit, acceleration=acceleration)
        assert is_calm(make, 1.001 * smallest, stiffness=stiffness, damping=damping), (stiffness, damping, smallest)


def test_a_joint_of_half_the_smallest_inertia_chatters():
    assert not is_calm(
        lambda: observed("AK80-9", 200, limit=9.0),
        0.5 * law(stiffness=500.0, damping=5.0).smallest_inertia,
        stiffness=500.0,
        damping=5.0,
    )


def test_usable_damping_follows_from_the_limit_over_three_periods():
    assert law().usable_damping == pytest.approx(2.0 * 9.0 / (500.0 * 0.015)) == pytest.approx(2.4)


@pytest.mark.parametrize("rate, time", [(200.0, 0.045), (1000.0, 0.045), (100.0, 0.055)])
def test_a_stall_lasts_until_the_guardian_has_checked(rate, time):
    assert law(rate=rate).stall_time == pytest.approx(time)


@pytest.mark.parametrize("stiffness, damping", [(30.0, 1.0), (300.0, 0.0), (0.0, 2.0), (100.0, 5.0)])
@pytest.mark.parametrize("motion", [125.0, 500.0])
def test_torque_of_a_stalled_loop_stays_within_the_reported_figure(stiffness, damping, motion):
    figures = law(12.0, 500.0, 200.0, stiffness, damping)
    drive, random = observed("AK10-9", 200, limit=12.0), np.random.default_rng(3)
    after = np.linspace(0.005, 0.005 + figures.stall_time, 12)
    largest = 0.0
    for _ in range(400):
        position, velocity = random.uniform(-1.0, 1.0) ** 3, random.uniform(-10.0, 10.0)
        drive.hear(position, velocity, drive.period)
        sent = drive.law(
            stiffness=stiffness * random.choice([1.0, random.random()]),
            damping=damping * random.choice([1.0, random.random()]),
        )
        for a in (-motion, motion):
            torques = torque_of(sent, position + velocity * after + 0.5 * a * after**2, velocity + a * after)
            largest = max(largest, np.abs(torques).max())
    assert 0.5 * figures.stall_torque(motion) < largest <= figures.stall_torque(motion) + 0.1


def test_the_stall_torque_of_a_knee_is_bounded_by_the_limit_and_the_acceleration():
    figures = Law(12.0, 500.0, 0.005, Interval.point(30.0), Interval.point(1.0))
    assert figures.stall_torque(125.0) / 12.0 == pytest.approx(2.0, abs=0.1)
    assert figures.stall_torque(500.0) / 12.0 == pytest.approx(4.75, abs=0.1)


def test_documented_rates_follow_from_the_frame_bits():
    page = (Path(__file__).parents[3] / "docs" / "reference" / "actuators.md").read_text()
    knee = Law(12.0, 500.0, 0.005, Interval.point(30.0), Interval.point(1.0))
    assert f"{law().usable_damping:.1f} N·m·s/rad for 9 N·m, 500 rad/s² and 200 Hz" in page
    assert f"{knee.smallest_inertia:.3f} kg·m² for K = 30, B = 1, 12 N·m and 200 Hz" in page
    assert f"stop, {1e3 * knee.stall_time:.0f} ms at 200 Hz and faster" in page
    assert all(
        f"{knee.stall_torque(motion) / 12.0:.0f} times {words}" in page
        for motion, words in ((125.0, "the limit at"), (500.0, "at 500"))
    )


# What bounds the torque of an actuator.


@pytest.mark.parametrize(
    "kind, model", [(CubeMars, "AK80-9"), (CubeMarsV3, "AK10-9-V3.0"), (RobStride, "RS02"), (RobStrideMIT, "RS02")]
)
@pytest.mark.parametrize("stiffness, damping", [(0.0, 0.0), (5.0, 0.0), (0.0, 0.1)])
def test_pure_torque_is_proved_and_gains_rest_on_the_assumption(kind, model, stiffness, damping):
    drive = kind(model, max_acceleration=300.0)
    commands = {name: NOTHING for name in drive.inputs}
    bound = drive.torque_bound(
        commands | {"stiffness_command": Interval(0.0, stiffness), "damping_command": Interval(0.0, damping)}, 0.005
    )
    assert bound.limit == drive.torque_limit
    if stiffness or damping:
        assert (bound.kind, bound.acceleration, bound.holds) == (
            "assumed",
            300.0,
            "while |α| <= 300 rad/s²",
        ) and bound.figures
    else:
        assert (bound.kind, bound.holds, bound.figures) == ("proved", "", ())


@pytest.mark.parametrize(
    "drive, kind",
    [
        (lambda: RobStride("RS02", mode="current"), "proved"),
        (lambda: RobStride("RS02", mode="position"), "drive"),
        (lambda: RobStride("RS02", mode="csp"), "drive"),
        (lambda: RobStride("RS02", mode="velocity"), "drive"),
        (lambda: CubeMarsServo("AK80-9", mode="current"), "proved"),
        (lambda: CubeMarsServo("AK80-9", mode="current_brake"), "proved"),
        (lambda: CubeMarsServo("AK80-9", mode="position"), "none"),
        (lambda: CubeMarsServo("AK80-9", mode="velocity"), "none"),
        (lambda: CubeMarsServo("AK80-9", mode="duty"), "none"),
        (lambda: CubeMarsServo("AK80-9", mode="position_velocity"), "none"),
    ],
)
def test_a_loop_inside_the_drive_is_never_reported_as_proved(drive, kind):
    drive = drive()
    bound = drive.torque_bound({name: Interval.point(0.1) for name in drive.inputs}, 0.005)
    assert bound.kind == kind and (bound.kind == "proved") == (bound.holds == "")
