"""The time from a command to its reply is measured and part of the age: with any transit, loss and jitter, a drive
that closes its own law stays within the limit, or its gains are gone.
"""

import json

import numpy as np
import pytest

from blocks.actuators import CubeMars, CubeMarsServo, CubeMarsV3, RobStride, RobStrideMIT
from graph import Diagram, compile
from tests.cext.delayed import KINDS, bursts, connected, constant, irregular, lossy, shaken
from tests.cext.imposed import imposed, sine, still
from tests.soaking import crossed, soaked

RATES = [100, 200, 500, 1000]
LAWS = {
    "K30 B1 L12": (12.0, {"stiffness_command": 30.0, "damping_command": 1.0}),
    "K100 B3 L6": (6.0, {"stiffness_command": 100.0, "damping_command": 3.0}),
}
WAYS = {
    "1 ms": constant(0.001),
    "8 ms": constant(0.008),
    "8 ms there": constant(0.008, 1.0),
    "8 ms back": constant(0.008, 0.0),
    "16 ms": constant(0.016),
    "16 ms there": constant(0.016, 1.0),
    "16 ms back": constant(0.016, 0.0),
}
IRREGULAR = {
    "6 to 30 ms": lambda: irregular(0.006, 0.03),
    "bursts of 16 ms": lambda: bursts(0.016),
    "0.2 to 4 ms": lambda: irregular(0.0002, 0.004),
}


def largest(rig, since=0.0):
    """The largest torque from `since` s on, after arming."""
    return np.abs(rig.torques[rig.torques[:, 0] >= since][:, 1]).max()


@pytest.mark.hazard("H1c")
@pytest.mark.parametrize("ways, rate, law", crossed(WAYS, RATES, LAWS))
def test_with_a_constant_transit_the_drive_gives_at_most_the_limit(ways, rate, law):
    limit, commands = LAWS[law]
    for name in KINDS:
        rig, outcome = connected(
            name,
            shaken(490.0, 5.0),
            WAYS[ways],
            rate=rate,
            seconds=0.6,
            limit=limit,
            commands=commands,
            **({"restart_time": 0.1} if "V3" in name else {}),
        )
        assert outcome.status == "ok" and largest(rig) <= limit + rig.torque_code, name


@pytest.mark.hazard("H1c")
@pytest.mark.parametrize("ways, rate, law, lost", crossed(IRREGULAR, RATES, LAWS, [0.0, 0.05]))
def test_with_late_and_lost_frames_the_drive_gives_at_most_the_limit(ways, rate, law, lost):
    limit, commands = LAWS[law]
    for frequency in (3.0, 9.0):
        rig, outcome = connected(
            "AK10-9",
            shaken(490.0, frequency),
            lossy(IRREGULAR[ways](), lost),
            rate=rate,
            seconds=1.0,
            limit=limit,
            commands=commands,
        )
        assert outcome.status == "ok" and largest(rig) <= limit + rig.torque_code


@pytest.mark.hazard("H1c")
@pytest.mark.parametrize("later", [0.001, 0.002, 0.005, 0.008, 0.016])
@pytest.mark.parametrize("rate", soaked(RATES, but=[1, 3]))
def test_replies_that_become_late_during_the_run_take_the_gains(rate, later):
    """By one period or several exactly: the replies that arrive then look like those to the newest commands. While the
    first command is late, the drive obeys the one before: from the first late reply on, the limit holds again.
    """
    limit, commands = LAWS["K100 B3 L6"]
    rig, outcome = connected(
        "AK10-9",
        shaken(490.0, 5.0),
        lambda t: (0.0, 0.0 if t < 0.3 - 1e-9 else later),
        rate=rate,
        seconds=1.5,
        limit=limit,
        commands=commands,
    )
    assert outcome.status == "ok" and largest(rig) <= limit + rig.torque_code
    permitted = max(0.005, 1.0 / rate) + 1e-9
    assert (rig.watched["transit_ticks"] > 0) == (later > permitted)
    told = [event["what"] for event in rig.events if "max_transit" in event.get("what", "")]
    assert len(told) == (later > permitted)


@pytest.mark.hazard("H1c")
@pytest.mark.parametrize("rate", [200, 1000, 2000])
@pytest.mark.parametrize("name", KINDS)
def test_a_command_that_is_later_than_those_before_stays_within_the_limit_for_the_time_that_check_prints(name, rate):
    """On its way to the drive, which obeys the command before it meanwhile."""
    limit, more = 3.0, {"restart_time": 0.1} if "V3" in name else {}
    kind, model, _ = KINDS[name]
    with Diagram("robot", rate=rate) as robot:
        kind(model, name="knee", limit=limit)(stiffness_command=100.0)
    [bound] = compile(robot).torque_bounds.values()
    [later] = [value for figure, value, _, _ in bound.figures if figure == "later_command"]
    reached = []
    for share in (1.0, 3.0):
        rig, _ = connected(
            name,
            shaken(490.0, 5.0),
            lambda t: (0.0 if t < 0.401 - 1e-9 else share * later, 0.0),
            rate=rate,
            seconds=0.7,
            limit=limit,
            commands={"stiffness_command": 100.0},
            **more,
        )
        reached.append(largest(rig) - rig.torque_code)
    assert reached[0] <= limit
    assert reached[1] > limit or rate == 200, "which the measurement does not prevent"


@pytest.mark.parametrize("rate", RATES)
def test_a_lost_reply_costs_no_gains_and_its_age_is_forgotten(rate):
    """One frame in a hundred. A lost reply makes the next ones seem one period older, until the loop has shown that it
    was lost.
    """
    rig, outcome = connected(
        "AK10-9",
        shaken(50.0, 2.0),
        lossy(constant(0.0), 0.005),
        rate=rate,
        seconds=2000 / rate,
        limit=12.0,
        substeps=1,
        commands=LAWS["K30 B1 L12"][1],
    )
    age = rig["knee.age"] * rate
    assert outcome.status == "ok" and rig.watched["transit_ticks"] == 0
    assert np.mean(age < 1.5) > 0.9 and age.max() >= 2.0 - 1e-6 and np.mean(age > 2.0 + 1e-6) < 0.02


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize(
    "drive, model", [(CubeMars, "AK80-9"), (CubeMarsV3, "AK80-9-V3.0"), (RobStride, "RS02"), (RobStrideMIT, "RS02")]
)
def test_a_prompt_drive_has_its_gains_from_the_first_ticks_on(drive, model, rate):
    rig, outcome = imposed(
        still(0.1),
        rate=rate,
        drive=drive,
        model=model,
        seconds=0.3,
        limit=5.0,
        commands={"stiffness_command": 10.0},
        substeps=5,
    )
    assert outcome.status == "ok" and rig.watched["transit_ticks"] == 0
    assert rig["knee.age"] == pytest.approx(1.0 / rate) and rig["knee.limited"][-1] == 0
    times = rig.torques[:, 0]
    after = (times >= 3.5 / rate) & (times < 0.29)
    assert np.abs(rig.torques[after, 1]) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("rate", [200, 1000])
@pytest.mark.parametrize(
    "drive, model", [(CubeMars, "AK80-9"), (CubeMarsV3, "AK80-9-V3.0"), (RobStride, "RS02"), (RobStrideMIT, "RS02")]
)
def test_late_replies_of_every_family_take_the_gains(drive, model, rate):
    rig, outcome = imposed(
        sine(0.3, 3.0),
        rate=rate,
        drive=drive,
        model=model,
        seconds=1.0,
        limit=5.0,
        commands={"stiffness_command": 100.0, "damping_command": 2.0},
        emulator={"delay": lambda t: 0.0 if t < 0.3 else 0.012},
        **({"restart_time": 0.1} if drive is CubeMarsV3 else {}),
    )
    assert outcome.status == "ok" and rig.watched["transit_ticks"] > 0
    assert np.abs(rig.torques[:, 1]).max() <= 5.0 + 0.03


@pytest.mark.parametrize("report_rate, extra", [(0.0, 0.0), (500.0, 0.005)])
def test_reports_whose_transit_cannot_be_measured_are_bounded_over_max_transit(report_rate, extra):
    """A drive that reports by itself answers no command: the law allows for max_transit, so less stiffness is left."""
    rig, outcome = imposed(
        sine(0.5, 2.0), drive=CubeMarsV3, model="AK80-9-V3.0", limit=5.0, report_rate=report_rate,
        commands={"stiffness_command": 30.0, "damping_command": 1.0}, substeps=10,
    )  # fmt: skip
    assert outcome.status == "ok" and rig.watched["transit_ticks"] == 0
    assert rig["knee.limited"][-1] > (100 if extra else 20)


def test_a_servo_drive_has_no_gains_and_no_transit():
    rig, outcome = imposed(
        sine(0.3, 2.0), drive=CubeMarsServo, model="AK80-9", commands={"current_command": 0.5}, report_rate=100.0
    )
    assert outcome.status == "ok" and rig.watched["transit_ticks"] == 0
    assert json.dumps(rig.watched)


def test_the_longest_certain_transit_is_reported():
    for total in (0.001, 0.004):
        rig, _ = connected(
            "AK10-9", shaken(50.0, 2.0), constant(total), rate=200, seconds=0.5, limit=12.0,
            commands=LAWS["K30 B1 L12"][1],
        )  # fmt: skip
        assert rig.control.reports.transits == {"knee": pytest.approx(total, abs=0.0006)}


def accelerating(begin, acceleration=500.0, top=20.0):
    """A joint that rests until `begin`, and is then accelerated to `top` rad/s."""

    def motion(t):
        rising = min(max(t - begin, 0.0), top / acceleration)
        after = max(t - begin - top / acceleration, 0.0)
        return 0.5 * acceleration * rising**2 + top * after, acceleration * rising

    return motion


@pytest.mark.hazard("H1c")
@pytest.mark.parametrize(
    "name, total, begin, lost", crossed(KINDS, [0.0, 0.008, 0.016, 0.030], [0.49, 0.5, 0.505, 0.52], [0.0, 0.2])
)
def test_a_damped_stop_stays_within_the_limit_over_any_transit(name, total, begin, lost):
    """The replies are as old as their frames, and the damping acts later: the joint may be faster by then.
    While lost frames leave the transit in doubt, the damping is that of an unknown speed.
    """
    limit, options = 5.0, {"restart_time": 0.0} if "V3" in name else {}
    rig, outcome = connected(
        name,
        accelerating(begin),
        lossy(constant(total), lost),
        rate=200,
        seconds=0.5,
        limit=limit,
        commands={"torque_command": 0.0},
        safe_stop="damp",
        stop_damping=2.0,
        stop_time=0.15,
        **options,
    )
    torques = np.abs(rig.torques[:, 1])
    assert outcome.status == "ok" and 0.35 * limit < torques.max() <= limit + rig.torque_code
