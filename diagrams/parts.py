"""Parts that the robots share: sensors and gait of both legs, neural networks, assisted joints.

Angles are flexion of the joint, or of the thigh from upright; positive torque flexes. Inertial sensors are upright in a
straight stand, with x forward and z down, so that their pitch is the pitch of the segment.
"""

from itertools import pairwise
from math import pi, radians
from typing import NamedTuple

from blocks.actuators import Actuator
from blocks.filters import Complementary
from blocks.gait import (
    BiologicalTorque,
    CirclePhase,
    ContactEvents,
    GaitState,
    PhaseKalmanFilter,
    SegmentOrder,
    SegmentPosture,
    SensorPlacement,
    ThighEvents,
    TorqueGate,
)
from blocks.imus import MicroStrain
from blocks.limiters import Saturation, TorqueLimiter
from blocks.mathematics import Gain, Sum
from blocks.networks import OnnxModel
from blocks.recorders import StrideReport
from blocks.sensors import Insole
from blocks.trigonometry import Atan2
from blocks.vectors import Select
from graph import Signal, subsystem

SIDES = ("left", "right")
SEGMENTS = ("thigh", "shank", "foot")
POSITIVE = {"hip": "flexion", "abduction": "hip abduction", "knee": "flexion", "ankle": "dorsiflexion"}
# Mean pitch of a segment in walking, in degrees: of people who walk on level ground, slopes and stairs, or crouched.
POSTURES = {"thigh": (-15.0, 45.0), "shank": (-45.0, 15.0), "foot": (-65.0, 20.0)}
STIFF_KNEE = 0.5  # smallest variance of the rate of a shank over that of its thigh: with a stiff knee, at least 0.56
CUFF_LEVER = 0.3  # m, distance of a cuff with a load cell from its joint
THIGH_OFFSET = 0.02  # of a stride, standard deviation of the strikes of ThighEvents between adults
LATENCY = 0.01  # s of the networks: one sample. A late result changes nothing in the loop

# Torque profiles of hip and knee (gait phase, N·m).
PROFILES = {
    "hip": ((0.06, 0.0), (0.20, -7.0), (0.38, 0.0), (0.58, 0.0), (0.68, 6.0), (0.80, 0.0)),
    "knee": ((0.16, 0.0), (0.24, -8.0), (0.34, 0.0), (0.48, 0.0), (0.60, 6.0), (0.70, 0.0)),
}


class Motion(NamedTuple):
    """Motion of a segment or a joint."""

    angle: Signal
    velocity: Signal


class Gait(NamedTuple):
    """Gait of one leg."""

    phase: Signal
    walking: Signal
    velocity: Signal
    shank_velocity: Signal | None = None
    uncertainty: Signal | float = 0.0


def imu(segment, serial):
    """Return the pitch of a segment as Motion, from its inertial sensor. serial : its number, or the last digits"""
    sensor = MicroStrain(serial, channels=("accel", "gyro", "euler"), name=f"{segment}_imu")
    return Motion(Select(1, name=f"{segment}_pitch")(sensor.euler), Select(1, name=f"{segment}_rate")(sensor.gyro))


def pitch(segment, sensor):
    """Return the pitch of a segment as Motion, from an inertial sensor without an attitude.

    At rest the specific force points up, and the pitch is atan2(x, −z) of it. It is limited to ±90°.
    """
    rate = Select(1, name=f"{segment}_rate")(sensor.gyro)
    inclination = Atan2(name=f"{segment}_inclination")(sensor.accel[0], -sensor.accel[2])
    angle = Complementary(time_constant=2.0, name=f"{segment}_angle")(rate, inclination)
    return Motion(Saturation(-0.5 * pi, 0.5 * pi, name=f"{segment}_pitch")(angle), rate)


def flexion(joint, above, below):
    """Return the Motion of a joint from those of two segments, as in `flexion("knee", thigh, shank)`."""
    angle = Sum("+-", name=f"{joint}_angle")(above.angle, below.angle)
    return Motion(angle, Sum("+-", name=f"{joint}_velocity")(above.velocity, below.velocity))


def insole(side):
    """Return the events of contact of one foot, with `strike`, from an insole."""
    address = f"0.0.0.0:{5005 + SIDES.index(side)}"
    return ContactEvents(name="events")(Insole(side=side, address=address, name="insole").force)


def gait(angle, velocity, strike=None, shank=None):
    """Return the Gait of a leg.

    angle, velocity : motion of thigh or hip; strike : by default from the angle; shank : its Motion, if it is measured
    """
    offset = 0.0
    if strike is None:
        strike, offset = ThighEvents(name="events")(angle).strike, THIGH_OFFSET
    estimate = PhaseKalmanFilter(strike_offset=offset, name="gait_phase")(angle=angle, velocity=velocity, strike=strike)
    return Gait(estimate.phase, estimate.walking, velocity, shank and shank.velocity, estimate.uncertainty)


def network(name):
    """Return a network of diagrams/networks, in a worker."""
    return OnnxModel(f"networks/{name}.onnx", run="worker", latency=LATENCY, name=f"{name}_network")


def leg_torque(joint, knee, thigh, mass):
    """Return the biological torque of a knee or ankle that a network estimates. knee, thigh : Motion; mass : kg"""
    estimate = network(f"{joint}_torque")(
        knee_angle=knee.angle, knee_velocity=knee.velocity, hip_angle=thigh.angle, hip_velocity=thigh.velocity
    )
    return Gain(mass, unit="kg", name=f"{joint}_torque")(getattr(estimate, f"{joint}_torque"))


def estimate(name, thighs):
    """Return {side: outputs of a network that receives both thighs}. thighs : {side: Motion}"""
    outputs = {}
    for side, other in zip(SIDES, reversed(SIDES)):
        with subsystem(side):
            outputs[side] = network(name)(
                hip_angle=thighs[side].angle,
                hip_velocity=thighs[side].velocity,
                opposite_hip_angle=thighs[other].angle,
                opposite_hip_velocity=thighs[other].velocity,
            )
    return outputs


def learned_gait(thighs, shanks=None):
    """Return {side: Gait} from the network gait_phase, whose outputs are 0 in standing.

    thighs, shanks : {side: Motion}; the shanks if they are measured
    """
    gaits = {}
    for side, circle in estimate("gait_phase", thighs).items():
        with subsystem(side):
            leg = CirclePhase(name="gait_phase")(cosine=circle.phase_cos, sine=circle.phase_sin)
            shank = shanks and shanks[side].velocity
            gaits[side] = Gait(leg.phase, leg.walking, thighs[side].velocity, shank, leg.uncertainty)
    return gaits


def hip_assistance(thighs, mass, scale, delay):
    """Return {side: torque}, the share of the biological torque of the hip that the network hip_torque estimates.

    thighs : {side: Motion}; mass : mass of the wearer, kg; scale, delay : as in BiologicalTorque
    """
    torques = {}
    for side, hip in estimate("hip_torque", thighs).items():
        with subsystem(side):
            moment = Gain(mass, unit="kg", name="hip_torque")(hip.hip_torque)
            torques[side] = BiologicalTorque(scale, delay, name="assistance")(moment)
    return torques


def walk(gaits):
    """Return whether both legs walk forward, half a stride apart. gaits : {side: Gait}"""
    named = ((f"{side}_{name}", signal) for side, leg in gaits.items() for name, signal in leg._asdict().items())
    used = {name: each for name, each in named if each is not None and not name.endswith("uncertainty")}
    return GaitState(name="state")(**used).walking


def rates(legs):
    """Return {side: velocity} of {side: Motion or actuator}."""
    return {side: leg.velocity for side, leg in legs.items()}


def placed(sensors, signals, reference, references, **options):
    """End the run if sensors of both legs are exchanged or reversed.

    sensors, reference : their names in the fault; signals, references : {side: Signal}; options : of SensorPlacement,
    and `enable`
    """
    enable = {"enable": options.pop("enable")} if "enable" in options else {}
    options.setdefault("name", f"{sensors.replace(' ', '_')}_placement")
    monitor = SensorPlacement(sensors, reference, **options)
    inputs = signals | {f"{side}_reference": signal for side, signal in references.items()}
    monitor(**inputs, **enable)


def ordered(walking, **segments):
    """End the run if sensors of one leg are exchanged between its segments, or one is turned or slips.

    segments : from the hip down, such as thigh={side: Motion}, shank={side: Motion}
    """
    for (upper, above), (lower, below) in pairwise(segments.items()):
        least = STIFF_KNEE if lower == "shank" else 0.85
        monitor = SegmentOrder(f"{upper} IMU", f"{lower} IMU", least, name=f"{upper}_{lower}_order")
        inputs = {f"{side}_{place}": leg[side] for place, leg in (("upper", above), ("lower", below)) for side in leg}
        monitor(**{name: motion.velocity for name, motion in inputs.items()}, enable=walking)
    for segment, motions in segments.items():
        lowest, highest = (radians(angle) for angle in POSTURES[segment])
        posture = SegmentPosture(f"{segment} IMU", lowest=lowest, highest=highest, name=f"{segment}_posture")
        posture(**{side: motion.angle for side, motion in motions.items()}, enable=walking)


def driven(joint, drives, sensors, loads, thighs, shanks, walking, opposite=False):
    """End the run if the drives of a joint have exchanged ids, also if they are mounted in mirror image.

    joint, sensors : their names in the fault; drives, loads, thighs, shanks : {side: drive, load on the foot, Motion}
    opposite : true for abduction

    While its foot bears load, an ankle is dorsiflexed, and a hip adducted, unlike those of the other leg. Both ankles
    plantarflex, and both hips abduct, while the knees flex: the sum of both angles shows the direction of the drives.
    """
    angles = {side: drive.position for side, drive in drives.items()}
    both = Sum("++", name=f"both_{joint}s")(*angles.values())
    velocities = (velocity for segments in (thighs, shanks) for velocity in rates(segments).values())
    knees = Sum("++--", name="both_knees")(*velocities)
    options = {"averaging": 5.0, "enable": walking}
    placed(f"{joint} drives", angles, sensors, loads, opposite=opposite, least=-0.45, **options)
    options |= {"opposite": not opposite, "one_leg": True, "name": f"{joint}_drives_direction"}
    placed(f"{joint} drives", {"left": both}, "knees", {"left": knees}, least=-0.45, **options)


def drive(side, joint, can_id, model="AK80-9", **parameters):
    """Return the actuator of a joint. Those of the right leg are mounted in mirror image."""
    return Actuator(model, bus="legs", can_id=can_id, invert=side == "right", name=joint, **parameters)


def assist(drive, torque, walking, leg, limit=8.0, slew=100.0, uncertainty: Signal | float = 0.0):
    """Command a joint with a limited torque while the wearer walks, and report its strides.

    leg : Gait; uncertainty : that of the phase which the torque follows
    """
    name = drive.path.rpartition("/")[2]
    gated = TorqueGate(name=f"{name}_gate")(u=torque, enable=walking, uncertainty=uncertainty)
    drive(torque_command=TorqueLimiter(limit=limit, slew=slew, name=f"{name}_limiter")(gated))
    StrideReport(title=drive.path.replace("/", " "), positive=POSITIVE[name], name=f"{name}_report")(
        phase=leg.phase, walking=walking, angle=drive.position, velocity=drive.velocity, torque=drive.torque
    )
