"""The watch over a drive's motion and torque: each rule finds what it is for, and nothing in walking, noise, lost
frames or a fade-in.
"""

import csv
import math

import numpy as np
import pytest

from blocks.actuators import CubeMars, CubeMarsServo, CubeMarsV3, RobStride, RobStrideMIT
from tests.cext.imposed import accelerated, imposed, sine, still
from tests.shared import shared
from tests.soaking import soaked

GAINS = {"stiffness_command": 30.0, "damping_command": 1.0}
RATES = [100, 200, 500, 1000]


@pytest.fixture(scope="module")
def knee():
    """A recorded knee: (position in rad, velocity in rad/s) as a function of time, of 10 s of walking; its largest
    acceleration is 269 rad/s².
    """
    with open(shared("gait/healthy_young.csv")) as file:
        rows = list(csv.DictReader(file))[:2200]
    name = next(name for name in rows[0] if name.startswith("knee"))
    angle = np.radians([float(row[name]) for row in rows])
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(np.arange(len(angle)) / 200.0, angle)
    rate = spline.derivative()
    return lambda t: (float(spline(t)), float(rate(t)))


# Acceleration


def gains_sent(rig):
    """Of each command between arming and the safe stop, the codes of stiffness and damping."""
    data = np.array([list(frame) for frame in rig.commands()])
    return (data[:, 3] & 15) * 256 + data[:, 4], data[:, 5] * 16 + (data[:, 6] >> 4)


@pytest.mark.hazard("H1d")
@pytest.mark.parametrize("rate", RATES)
def test_an_impact_removes_stiffness_and_damping_in_the_tick_of_its_first_reply(rate):
    begin, period = 0.5, 1.0 / rate
    rig, outcome = imposed(
        accelerated(4.0 / period / 2, begin - 1e-9, until=8.0),
        rate=rate,
        substeps=20,
        seconds=1.0,
        model="AK10-9-V2.0",
        limit=12.0,
        commands={"stiffness_command": 300.0, "damping_command": 5.0},
        max_acceleration=150.0,
    )
    assert outcome.status == "ok" and rig.watched["acceleration_ticks"] > 0
    stiffness, damping = gains_sent(rig)
    shows = int(np.argmax(rig["knee.velocity"] > 0.1))
    assert damping[shows - 1] > 0 and not stiffness[shows : shows + 3].any() and not damping[shows : shows + 3].any()
    told = [event for event in rig.events if "acceleration exceeds" in event["what"]]
    assert [event["tick"] for event in told] == [shows]
    assert told[0]["what"] == (
        "acceleration exceeds max_acceleration, 150 rad/s²: stiffness and damping are zero until it is below that limit"
    )
    # the plant is a period ahead: it moves while the robot is armed
    after = rig.torques[:, 0] >= (shows + 1) * period + 1e-9
    assert np.abs(rig.torques[after, 1]).max() <= 12.0 + 2 * 65.0 / 4095


@pytest.mark.parametrize(
    "stiffness, damping, rate, acceleration",
    [(0.0, 5.0, 500, 3000.0), (300.0, 5.0, 1000, 3000.0), (0.0, 5.0, 200, 1500.0)],
)
def test_an_impact_exceeds_the_limit_for_at_most_two_ticks_after_its_first_reply(
    stiffness, damping, rate, acceleration
):
    """Three to six times the default bound, begun just before the end of a period, so that the first reply shows a
    tenth of it.
    """
    limit, period = 12.0, 1.0 / rate
    rig, _ = imposed(
        accelerated(acceleration, 0.3 + 0.9 * period, until=12.0),
        rate=rate,
        substeps=20,
        seconds=0.45,
        drive=CubeMarsV3,
        model="AK10-9-V3.0",
        limit=limit,
        commands={"stiffness_command": stiffness, "damping_command": damping},
    )
    shows = int(np.argmax(np.abs(rig["knee.velocity"]) > 0.06))  # a reply of this grid point, by the clock of the plant
    above = rig.torques[np.abs(rig.torques[:, 1]) > limit + 108.0 / 4095][:, 0]
    assert above.size and above.min() > (shows - 1) * period and above.max() < (shows + 2) * period


def test_stiffness_and_damping_return_over_100_ms_once_the_window_is_calm():
    rig, outcome = imposed(
        accelerated(2000.0, 0.5 - 1e-9, until=9.0), rate=1000, commands={"damping_command": 0.5}, limit=9.0
    )
    damping, shows = gains_sent(rig)[1], int(np.argmax(rig["knee.velocity"] > 0.1))
    assert outcome.status == "ok" and not damping[shows : shows + 15].any()
    ramp = damping[shows + 15 : shows + 122]
    assert np.all(np.diff(ramp) >= 0) and ramp[0] <= 8 < ramp[50] < 0.6 * ramp[-1] and ramp[-1] == damping[shows - 1]


@pytest.mark.parametrize("bound", [300.0, 500.0])
@pytest.mark.parametrize("rate", soaked(RATES, but=[0, 3]))
def test_velocity_noise_of_0_15_rad_s_raises_no_acceleration_fault(knee, rate, bound):
    rig, outcome = imposed(
        knee,
        rate=rate,
        substeps=1,
        seconds=min(10.0, 4000 / rate),
        noise=0.15,
        commands=GAINS,
        limit=9.0,
        max_acceleration=bound,
    )
    assert outcome.status == "ok" and rig.watched["acceleration_ticks"] == 0


@pytest.mark.hazard("H1d")
@pytest.mark.parametrize("rate", RATES)
def test_sustained_acceleration_beyond_bound_ends_run(rate):
    """12 Hz, of a peak of 1000 rad/s²: twice the bound, and beyond it for two thirds of the time."""
    rig, outcome = imposed(sine(1000.0 / (24.0 * math.pi) ** 2, 12.0), rate=rate, commands=GAINS, limit=9.0)
    assert (outcome.status, outcome.culprit) == ("acceleration", "knee") and 0.05 <= outcome.tick / rate < 0.3
    assert 500.0 < rig.watched["value"] < 1050.0 and rig.watched["bound"] == 500.0


def test_without_stiffness_and_damping_no_acceleration_is_a_fault():
    rig, outcome = imposed(sine(0.5, 10.0), commands={"torque_command": 2.0})
    assert outcome.status == "ok" and rig.watched["acceleration_ticks"] == 0 and rig.events == []


def test_single_impacts_are_not_faults():
    rig, outcome = imposed(lambda t: (0.0, 6.0 if t > 0.5 else 0.0), seconds=0.8, commands=GAINS, limit=9.0)
    assert outcome.status == "ok" and rig.watched["acceleration_ticks"] == 2


# Torque


@pytest.mark.hazard("H1e")
@pytest.mark.parametrize(
    "drive, model, parameters, emulator",
    [
        (CubeMars, "AK80-9", {}, {"wire_stiffness": 5000.0}),
        (CubeMarsV3, "AK80-9-V3.0", {}, {"wire_stiffness": 5000.0}),
        (RobStrideMIT, "RS02", {}, {"wire_stiffness": 5000.0}),
    ],
)
def test_a_measured_torque_beyond_limit_and_accuracy_ends_the_run(drive, model, parameters, emulator):
    """A drive whose stiffness is ten times what was sent."""
    rig, outcome = imposed(
        still(),
        drive=drive,
        model=model,
        limit=4.0,
        emulator=emulator,
        commands={"stiffness_command": 20.0, "position_command": lambda t: 0.1 if t >= 0.2 else 0.0},
        **parameters,
    )
    assert (outcome.status, outcome.culprit) == ("excess torque", "knee")
    assert 0.2 + 0.02 <= outcome.tick / 200 <= 0.2 + 0.035
    assert rig.watched["value"] > 12.0 and rig.watched["bound"] == 4.0


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize(
    "drive, model", [(CubeMars, "AK80-9"), (CubeMarsV3, "AK80-9-V3.0"), (RobStride, "RS02"), (RobStrideMIT, "RS02")]
)
def test_a_drive_that_lost_its_power_for_50_ms_is_detected(drive, model, rate):
    rig, outcome = imposed(
        still(),
        drive=drive,
        model=model,
        rate=rate,
        commands={"torque_command": 3.0},
        emulator={"power_lost": lambda t: 0.5 <= t < 0.55},
        timeout=0.1,
    )
    # a RobStride reports its mode in twelve replies; a board V3.0 would obey, and one in MIT mode is disabled
    told = {RobStride: "device fault" if rate > 100 else "not following", CubeMarsV3: "silent"}
    told = told.get(drive, "not following")
    assert (outcome.status, outcome.culprit) == (told, "knee")
    assert (0.51 if drive is CubeMarsV3 else 0.54) <= outcome.tick / rate < 0.8
    if told == "not following":
        assert rig.watched["value"] < 0.2 * 3.0 and 2.5 < rig.watched["bound"] <= 3.0


@pytest.mark.hazard("H6c")
def test_power_cycled_stiff_drive_is_reported_as_not_following():
    _, outcome = imposed(
        sine(0.3, 1.0),
        commands={**GAINS, "position_command": 0.1},
        emulator={"power_lost": lambda t: 0.5 <= t < 0.55},
        limit=9.0,
        seconds=1.5,
    )
    assert outcome.status == "not following" and outcome.tick / 200 < 0.9


@pytest.mark.parametrize(
    "commands, emulator, options",
    [
        ({"torque_command": lambda t: 4.0 * math.copysign(1.0, math.sin(2.0 * math.pi * 50.0 * t))}, {}, {}),
        ({"torque_command": lambda t: 0.5 * math.sin(2.0 * math.pi * 3.0 * t)}, {}, {}),
        ({"torque_command": 9.0}, {"peak": 7.0}, {"fade": 0.5}),
        ({"torque_command": lambda t: 9.0 * math.sin(2.0 * math.pi * 2.0 * t)}, {"peak": 5.0}, {}),
        ({"torque_command": lambda t: 9.0 * math.sin(2.0 * math.pi * 4.0 * t)}, {"dropped": lambda t: 0.3}, {}),
        ({"torque_command": lambda t: 9.0 * math.sin(2.0 * math.pi * 4.0 * t)}, {"delay": lambda t: 0.012}, {}),
        (
            {**GAINS, "position_command": lambda t: math.sin(2.0 * math.pi * t)},
            {"delay": lambda t: 0.002},
            {"fade": 1.0},
        ),
    ],
    ids=[
        "changes of sign",
        "near zero",
        "a drive at its limit",
        "a sine at the drive's limit",
        "lost frames",
        "late replies",
        "fade-in",
    ],
)
def test_drive_that_follows_raises_no_fault(commands, emulator, options):
    _, outcome = imposed(still(), seconds=3.0, commands=commands, emulator=emulator, limit=9.0, **options)
    assert outcome.status == "ok"


@pytest.mark.parametrize("rate", RATES)
def test_walking_with_every_law_raises_no_fault(knee, rate):
    for commands in (
        GAINS,
        {"damping_command": 2.0},
        {"stiffness_command": 100.0, "damping_command": 3.0, "position_command": 0.3},
    ):
        rig, outcome = imposed(
            knee,
            rate=rate,
            substeps=1,
            seconds=1000 / rate,
            noise=0.02,
            commands=commands,
            limit=9.0,
            range=(-0.3, 1.6),
        )
        assert outcome.status == "ok", commands


# Motion


def test_a_joint_outside_its_range_ends_the_run_at_once():
    rig, outcome = imposed(sine(1.0, 0.5), range=(-0.9, 0.9), seconds=2.0)
    beyond = rig["knee.position"]
    assert (outcome.status, outcome.culprit) == ("over-travel", "knee") and 0.94 < beyond[-1] <= 0.951
    assert 0.95 < rig.watched["value"] < 0.96 and rig.watched["bound"] == 0.9


@pytest.mark.hazard("H5c")
def test_over_travel_to_the_other_side_with_an_offset_on_an_inverted_joint():
    rig, outcome = imposed(lambda t: (-t, -1.0), range=(-0.5, 2.0), offset=1.0, invert=True)
    assert outcome.status == "over-travel" and -0.57 < rig.watched["value"] < -0.55 and rig.watched["bound"] == -0.5


@pytest.mark.parametrize(
    "drive, model, parameters, fastest",
    [
        (CubeMars, "AK80-9", {"max_velocity": 10.0}, 10.0),
        (CubeMars, "AK80-64", {}, 0.995 * 8.0),
        (CubeMarsV3, "AKH70-48", {"gear_ratio": 2.0}, 0.995 * 2.5),
        (RobStride, "RS03", {}, 0.995 * 20.0),
        (RobStride, "RS01", {}, 315 * math.pi / 30),
        (CubeMarsServo, "AK80-9", {"max_velocity": 12.0, "report_rate": 200.0}, 12.0),
    ],
)
def test_a_joint_that_is_too_fast_for_three_replies_ends_the_run(drive, model, parameters, fastest):
    commands = {"current_command": 0.0} if drive is CubeMarsServo else None
    rig, outcome = imposed(
        accelerated(100.0, 0.0, until=50.0), drive=drive, model=model, commands=commands, **parameters
    )
    assert (outcome.status, outcome.culprit) == ("overspeed", "knee") and rig.watched["bound"] == pytest.approx(fastest)
    velocity = rig["knee.velocity"]
    assert (velocity > fastest).sum() == 2 and rig.watched["value"] > fastest


# Scales

FIRMWARES = [
    (CubeMars, "AK80-9", {"wire_velocity": 45.0}, 50.0 / 45.0, "velocity"),
    (CubeMars, "AK60-6-V1.1", {"wire_velocity": 50.0}, 0.9, "velocity"),
    (CubeMars, "AK80-9", {"wire_velocity": 25.64}, 50.0 / 25.64, "velocity"),
    (CubeMars, "AK80-9", {"wire_position": 95.5}, 95.5 / 12.5, "velocity"),
    (CubeMarsV3, "AK80-9-V3.0", {"pole_pairs": 14}, 14 / 21, "velocity"),
    (CubeMarsServo, "AK80-9", {"pole_pairs": 14}, 14 / 21, "velocity"),
    (RobStrideMIT, "RS02", {"ranges": "private"}, 33.0 / 44.0, "velocity"),
    (CubeMarsV3, "AK80-9-V3.0", {"wire_torque": 21.0}, 21.0 / 18.0, "torque"),
    (CubeMarsV3, "AK80-9-V3.0", {"torque_constant": 0.945}, 0.5701 / 0.945, "torque"),
    (RobStride, "RS03", {"wire_stiffness": 500.0}, 0.1, "torque"),
]


@pytest.mark.hazard("H1f")
@pytest.mark.parametrize(
    "drive, model, emulator, scale, about",
    FIRMWARES,
    ids=[f"{model} {emulator}" for _, model, emulator, *_ in FIRMWARES],
)
def test_firmware_with_other_scale_is_detected_after_a_second(drive, model, emulator, scale, about):
    commands = (
        {"current_command": 0.0}
        if drive is CubeMarsServo
        else {"torque_command": lambda t: (2.0 if model.startswith("AK60") else 4.0) * math.sin(2.0 * math.pi * t)}
    )
    if "wire_stiffness" in emulator:
        commands = {"stiffness_command": 30.0, "position_command": lambda t: 0.3 * math.sin(2.0 * math.pi * t)}
    motion = still() if about == "torque" else sine(0.5, 1.0)
    unasked = {"verify_ranges": False} if drive is RobStrideMIT else {}
    rig, outcome = imposed(
        motion, drive=drive, model=model, seconds=3.0, emulator=emulator, commands=commands, noise=0.02, **unasked
    )
    expected = "not following" if scale == 0.1 else "scale mismatch"
    assert (outcome.status, outcome.culprit) == (expected, "knee")
    if expected == "scale mismatch":
        assert 1.0 < outcome.tick / 200 < 1.8
        assert rig.watched["about"] == about and rig.watched["value"] == pytest.approx(scale, rel=0.02)


def test_position_opposing_velocity_is_detected():
    rig, outcome = imposed(lambda t: (0.5 * math.sin(5.0 * t), -2.5 * math.cos(5.0 * t)), seconds=2.5)
    assert outcome.status == "scale mismatch" and rig.watched["value"] == pytest.approx(-1.0, abs=0.02)


@pytest.mark.parametrize("rate", RATES)
def test_noise_lag_and_lost_replies_are_no_scale_mismatch(knee, rate):
    """The velocity 10 ms behind the position, as a filter of it would be."""

    def behind(t):
        return knee(t)[0], knee(max(0.0, t - 0.01))[1]

    _, outcome = imposed(
        behind,
        rate=rate,
        substeps=1,
        seconds=6.0 if rate < 500 else 3.0,
        noise=0.15,
        emulator={"dropped": lambda t: 0.1},
    )
    assert outcome.status == "ok"


def test_replies_lost_at_the_fastest_motion_are_no_scale_mismatch():
    """An ankle that extends by 0.45 rad in 0.12 s and returns in 0.5 s: over the 55 ms without a reply, the mean of the
    velocities before and after is 0.85 times the rate of the position.
    """

    def pushing(t):
        t %= 1.0
        begin, angle, change, duration = (0.0, 0.0, -0.45, 0.12) if t < 0.12 else (0.12, -0.45, 0.45, 0.5)
        x = min(1.0, (t - begin) / duration)
        return angle + change * x * x * (3.0 - 2.0 * x), change * 6.0 * x * (1.0 - x) / duration

    _, outcome = imposed(pushing, seconds=4.0, emulator={"dropped": lambda t: float(0.035 < t % 1.0 < 0.085)})
    assert outcome.status == "ok"


def test_a_position_at_the_end_of_its_range_is_not_compared():
    """A drive turns on, past the end of what it can report."""
    _, outcome = imposed(lambda t: (11.0 + 2.0 * t, 2.0), seconds=3.0)
    assert outcome.status == "ok"


# What cannot be


@pytest.mark.hazard("H11c")
@pytest.mark.parametrize(
    "drive, model, heard", [(CubeMars, "AK80-9", -40.0), (RobStride, "RS02", -100.0), (CubeMarsV3, "AK70-9", -100.0)]
)
def test_an_implausible_temperature_ends_the_run(drive, model, heard):
    rig, outcome = imposed(
        still(), drive=drive, model=model, emulator={"temperature": lambda t: 30.0 if t < 0.2 else -100.0}
    )
    assert (outcome.status, outcome.culprit) == ("implausible", "knee") and outcome.tick in (39, 40)  # 0.2 s
    assert (rig.watched["about"], rig.watched["value"]) == ("temperature", heard)


def test_a_missing_temperature_is_not_a_fault():
    """Replies of 7 bytes have none: it is NaN."""
    rig, outcome = imposed(still(), model="AK80-9", reply=7, emulator={"reply": 7})
    assert outcome.status == "ok" and np.isnan(rig["knee.temperature"]).all()


class Nowhere(CubeMars):
    """A drive whose replies are decoded to what is no number: half a range of it is infinite, as no parameter
    allows.
    """

    place = 0

    def configure(self):
        super().configure()
        self.wire = tuple(math.inf if place == self.place else half for place, half in enumerate(self.wire))


@pytest.mark.parametrize("place, about", [(0, "position"), (1, "velocity"), (4, "torque")])
def test_nan_measurement_ends_arming(monkeypatch, place, about):
    monkeypatch.setattr(Nowhere, "place", place)
    rig, outcome = imposed(still(), drive=Nowhere, commands={"torque_command": 2.0})
    assert (outcome.status, outcome.culprit, outcome.tick) == ("implausible", "knee", -1)
    assert rig.watched["about"] == about and math.isnan(rig.watched["value"])


def test_an_angle_at_the_end_of_its_encoded_range_is_reported():
    """In simulation a joint needs no range: beyond 12.5 rad its angle stands still while it turns on."""
    rig, outcome = imposed(
        lambda t: (min(20.0 * t, 12.4) if t < 0.8 else 12.4 + 5.0 * (t - 0.8), 20.0 if t < 0.62 else 5.0 * (t > 0.8)),
        seconds=1.2, commands={"torque_command": 1.0}, max_velocity=30.0,
    )  # fmt: skip
    assert outcome.status == "ok" and rig.watched["end_ticks"] == pytest.approx(0.38 * 200, abs=6)
    [told] = [event["what"] for event in rig.events if event["event"] == "warning"]
    assert "12.5 rad" in told and "declare its `range`" in told
