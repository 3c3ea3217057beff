"""Setpoints that cannot be meant: degrees typed as radians, angles outside a joint's range, speeds and torques that no
drive has.
"""

import math

import pytest

from blocks.actuators import CubeMars, CubeMarsServo, CubeMarsV3, RobStride
from blocks.controllers import PD, PID, Admittance, GaitPhase, Impedance, P, TorqueProfile
from blocks.discrete import UnitDelay
from blocks.filters import Butterworth
from blocks.limiters import Saturation, SoftStop, TorqueLimiter
from blocks.logic import Compare
from blocks.mathematics import Gain, Sum
from blocks.safety import EmergencyStop
from blocks.sources import Constant, Sine, StepSource
from graph import Diagram, DiagramError, Live, compile, deg
from runtime.robot.loading.file import load
from tests.graph.complaints import here
from tests.runtime.runs import ROOT

KNEE = (-0.1, 2.0)


def found(build, drive=CubeMars, model="AK80-9", **parameters):
    """[(severity, path and port, message, hint)] of TW026, and no other error, of a knee whose torque `build(knee)`
    makes.
    """
    with Diagram("robot", rate=200) as diagram:
        knee = drive(model, name="knee", **parameters)
        torque = build(knee)
        if torque is not None:
            knee(torque_command=TorqueLimiter(limit=5.0, name="last")(torque))
    try:
        diagnostics = compile(diagram).warnings
    except DiagramError as error:
        diagnostics = error.diagnostics
    assert {d.code for d in diagnostics} <= {"TW026", "TW020", "TW029"}, diagnostics
    return [(d.severity, f"{d.path}.{d.port}".strip("."), d.message, d.hint) for d in diagnostics if d.code == "TW026"]


def spring(equilibrium, **filters):
    return lambda knee: Impedance(name="spring")(knee.position, knee.velocity, equilibrium)


@pytest.mark.hazard("H5d")
def test_degrees_typed_as_radians_do_not_compile_and_the_message_suggests_deg():
    assert found(spring(30.0)) == [
        (
            "error",
            "spring.equilibrium",
            "30 rad is outside the limits of knee: -12.5 to 12.5 rad (command range of AK80-9)",
            "30 rad is 1719°: did you mean deg(30)?",
        )
    ]
    assert found(spring(deg(30))) == []


def test_setpoint_out_of_reach_is_reported_at_the_line_of_the_connection():
    with Diagram("robot", rate=200) as diagram:
        knee = CubeMars("AK80-9", name="knee")
        spring = Impedance()
        torque = spring(knee.position, knee.velocity, 30.0)
        at = here(-1)
        knee(torque_command=TorqueLimiter(limit=5.0)(torque))
    with pytest.raises(DiagramError) as caught:
        compile(diagram)
    assert [d.where for d in caught.value.diagnostics] == [at]


@pytest.mark.parametrize("drive, model", [(CubeMars, "AK10-9-V2.0"), (CubeMarsV3, "AK10-9-V3.0"), (RobStride, "RS03")])
def test_every_drive_with_a_position_command_has_a_reach(drive, model):
    assert [severity for severity, *_ in found(spring(30.0), drive, model)] == ["error"]
    assert found(spring(1.0), drive, model) == []


@pytest.mark.hazard("H5d")
@pytest.mark.parametrize(
    "angle, bounds", [(5.0, "did you mean deg(5)?"), (-0.5, "set -0.1 to 2 rad, or correct `range` of knee")]
)
def test_an_angle_outside_the_joints_range_is_an_error(angle, bounds):
    [(severity, _, message, hint)] = found(spring(angle), range=KNEE)
    assert (severity, message) == (
        "error",
        f"{angle:g} rad is outside the limits of knee: -0.1 to 2 rad (its range)",
    ) and bounds in hint
    assert found(spring(angle)) == [], "where no range is given, the drive can go there"
    for inside in (-0.1, 0.0, 2.0):
        assert found(spring(inside), range=KNEE) == []


def test_more_than_one_turn_that_would_be_a_likely_angle_in_degrees_is_a_warning():
    [(severity, _, message, hint)] = found(spring(10.0))
    assert (severity, hint) == ("warning", "10 rad is 573°: did you mean deg(10)?") and (
        "10 rad is more than one turn of knee"
    ) in message
    assert found(spring(6.0)) == []


@pytest.mark.parametrize(
    "wired, said",
    [
        (lambda: Constant(30.0, unit="rad")(), "30 rad"),
        (lambda: StepSource(0.0, 30.0, unit="rad")(), "covers 0 to 30 rad"),
        (lambda: Sine(30.0, unit="rad")(), "covers -30 to 30 rad"),
        (lambda: Sine(1.0, bias=30.0, unit="rad")(), "covers 29 to 31 rad"),
        (lambda: Constant(Live(30.0, min=0.0, max=60.0), unit="rad")(), "30 rad"),
    ],
)
def test_a_source_that_leaves_the_drives_reach_is_an_error(wired, said):
    [(severity, at, message, hint)] = found(lambda knee: spring(wired())(knee))
    assert (severity, at) == ("error", "spring.equilibrium") and said in message and "did you mean deg(3" in hint


def test_a_setpoint_partly_outside_the_range_is_a_warning_and_always_outside_an_error():
    assert [f[0] for f in found(lambda knee: spring(Sine(0.5, bias=1.8, unit="rad")())(knee), range=KNEE)] == [
        "warning"
    ]
    assert [f[0] for f in found(lambda knee: spring(Sine(0.5, bias=4.0, unit="rad")())(knee), range=KNEE)] == ["error"]
    assert found(lambda knee: spring(Sine(0.5, bias=1.0, unit="rad")())(knee), range=KNEE) == []


def test_live_bounds_out_of_reach_are_a_warning():
    [(severity, _, message, _)] = found(
        lambda knee: spring(Constant(Live(0.5, min=0.0, max=100.0), unit="rad", name="angle")())(knee)
    )
    assert (
        severity == "warning"
        and "the live bounds of angle allow 0 to 100 rad, which is outside the limits of knee" in message
    )
    assert found(lambda knee: spring(Constant(Live(0.5, min=0.0, max=2.0), unit="rad")())(knee), range=KNEE) == []


def test_a_position_behind_a_filter_or_a_delay_is_still_the_joints():
    for behind in (Butterworth(order=2, cutoff=20.0), UnitDelay()):

        def build(knee, kind=type(behind), behind=behind):
            block = Butterworth(order=2, cutoff=20.0) if kind is Butterworth else UnitDelay()
            return Impedance(name="spring")(block(knee.position), knee.velocity, 60.0)

        assert [f[:2] for f in found(build)] == [("error", "spring.equilibrium")]


def test_the_reference_of_a_controller_in_any_unit_counts_where_it_makes_a_torque():
    def pd(angle):
        return lambda knee: PD(kp=20.0, kd=1.0, unit="N·m", name="pd")(angle, knee.position)

    assert [f[:2] for f in found(pd(30.0))] == [("error", "pd.reference")]
    assert [f[:2] for f in found(pd(5.0), range=KNEE)] == [("error", "pd.reference")] and found(
        pd(1.0), range=KNEE
    ) == []
    [(severity, _, _, hint)] = found(lambda knee: PID(kp=2.0, lower=-5.0, upper=5.0, unit="N·m")(120.0, knee.velocity))
    assert severity == "error" and hint == "120 rad/s is 6875°/s: did you mean deg(120)?"


def test_a_manually_built_difference_is_checked():
    assert [
        f[:2] for f in found(lambda knee: Gain(20.0, unit="N·m/rad")(Sum("+-", name="error")(30.0, knee.position)))
    ] == [("error", "error.u1")]


@pytest.mark.parametrize(
    "build",
    [
        lambda knee: EmergencyStop()(Compare(">")(knee.position, 2.3)),  # past the end of the range on purpose
        lambda knee: EmergencyStop()(Compare(">")(knee.velocity, 20.0)),
        lambda knee: Impedance()(math.pi - knee.position, knee.velocity, deg(170)),  # the angle between the segments
        lambda knee: Impedance()(knee.position - deg(90), knee.velocity, -1.0),
        lambda knee: Impedance(stiffness=0.0, damping=1.0)(
            knee.position, knee.velocity
        ),  # unwired: 0, outside some ranges
        lambda knee: SoftStop(lower=-0.05, upper=1.9)(0.0, knee.position, knee.velocity),
        lambda knee: Gain(0.15)(TorqueProfile(((0.1, 0.0), (0.5, 120.0)))(phase=0.4)),  # of a person, scaled
        lambda knee: Gain(0.15)(Constant(120.0, unit="N·m")()),
        lambda knee: Sum("++")(Sine(8.0, unit="N·m")(), knee.torque),
        # up to 2000 N·m by its law, limited behind
        lambda knee: Impedance(stiffness=150.0)(knee.position, knee.velocity, 1.0),
    ],
)
def test_plausible_setpoints_are_not_reported(build):
    for limits in ((), KNEE):

        def made(knee):
            torque = build(knee)
            return torque if hasattr(torque, "block") else Constant(0.0, unit="N·m")()

        assert found(made, range=limits) == []


def test_a_threshold_that_is_never_reached_is_reported():
    [(severity, at, _, hint)] = found(
        lambda knee: EmergencyStop()(Compare(">", name="bent")(knee.position, 115.0)) and Constant(0.0, unit="N·m")()
    )
    assert (severity, at, hint) == ("error", "bent.b", "115 rad is 6589°: did you mean deg(115)?")


def test_a_parameter_beside_the_position_is_compared():
    def gait(knee):
        phase = GaitPhase(threshold=40.0, name="gait")(angle=knee.position, velocity=knee.velocity)
        return TorqueProfile(((0.1, 0.0), (0.5, 3.0)))(phase=phase.phase, enable=phase.walking)

    [(severity, at, message, hint)] = found(gait)
    assert (
        (severity, at) == ("error", "gait.threshold")
        and message.startswith("40 rad is outside the limits of knee")
        and "deg(40)" in hint
    )
    for limits, severity, port in (((-0.05, 115.0), "error", "stop.upper"), ((-5.0, 1.9), "warning", "stop.lower")):

        def stop(knee, limits=limits):
            return SoftStop(*limits, name="stop")(0.0, knee.position, knee.velocity)

        assert [f[:2] for f in found(stop, range=KNEE)] == [(severity, port)]


def test_a_position_command_has_to_lie_in_the_joints_range():
    def build(knee):
        knee(position_command=3.5, stiffness_command=1.0)

    [(severity, at, message, _)] = found(build, range=KNEE)
    assert (severity, at) == ("error", "knee.position_command") and "-0.1 to 2 rad (its range)" in message
    assert found(build) == []

    def behind(knee):
        knee(
            position_command=Saturation(-12.0, 12.0)(Sine(1.0, bias=30.0, unit="rad", name="sine")()),
            stiffness_command=1.0,
        )

    assert [f[:2] for f in found(behind)] == [("error", "sine")]


def test_an_equilibrium_that_becomes_a_position_command_is_compared():
    def build(knee):
        where = Admittance(name="soft")(knee.torque, 30.0)
        knee(position_command=Saturation(-12.0, 12.0)(where.position), stiffness_command=1.0)

    assert [f[:2] for f in found(build)] == [("error", "soft.equilibrium")]


def test_a_large_position_command_in_servo_mode_suggests_degrees():
    def build(knee):
        knee(position_command=45.0)

    [(severity, at, message, hint)] = found(build, CubeMarsServo, mode="position")
    assert (severity, at, hint) == ("warning", "knee.position_command", "45 rad is 2578°: did you mean deg(45)?")


@pytest.mark.parametrize(
    "build, at, said",
    [
        (
            lambda knee: TorqueProfile(((0.1, 0.0), (0.5, 400.0)), name="profile")(phase=0.4),
            "profile",
            "profile.torque can reach 0 to 400 N·m",
        ),
        (lambda knee: Sum("++", name="sum")(knee.torque, 400.0), "sum.u2", "400 N·m"),
        (
            lambda knee: TorqueLimiter(limit=400.0, name="first")(Impedance()(knee.position, knee.velocity)),
            "first",
            "first.limited can reach -400 to 400 N·m",
        ),
        (lambda knee: -Sine(400.0, unit="N·m", name="sine")(), "sine", "sine.y covers -400 to 400 N·m"),
        (lambda knee: Gain(0.5)(Constant(400.0, unit="N·m", name="push")()), "push", "200 N·m"),
    ],
)
def test_a_torque_beyond_the_peak_of_the_drive_is_a_warning(build, at, said):
    [(severity, where, message, hint)] = found(build)
    assert (
        (severity, where) == ("warning", at)
        and said in message
        and ("outside the limits of knee: -18 to 18 N·m (peak torque of AK80-9)") in message
    )
    assert hint.startswith("set at most 18 N·m")


def test_a_velocity_faster_than_the_drive_is_an_error():
    [(severity, at, message, hint)] = found(lambda knee: P(kp=1.0, unit="N·m", name="damper")(80.0, knee.velocity))
    assert (severity, at) == ("error", "damper.reference") and "-50 to 50 rad/s (command range of AK80-9)" in message


@pytest.mark.parametrize("file", ["diagrams/knee_exo.py", "diagrams/hip_exo.py"])
def test_the_diagrams_of_this_project_raise_no_alarm(file):
    _, diagram = load(ROOT / file)
    assert [d for d in compile(diagram).warnings if d.code == "TW026"] == []


def test_set_can_provoke_it_and_the_line_is_that_of_the_block():
    _, diagram = load(ROOT / "diagrams/knee_exo.py", [("left/events.smallest", "40")])
    message = "TW026 .*left/events.smallest: 40 rad is outside the limits of left/knee"
    with pytest.raises(DiagramError, match=message):
        compile(diagram)
