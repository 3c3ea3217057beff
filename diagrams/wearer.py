"""Wearer of the robots in simulation: a walking adult, with every device at the place that its path names.

left/hip is the actuator of the left hip, left/hip_cell the load cell of its cuff, right/shank_imu an inertial sensor on
the right shank, pelvis_imu one on the pelvis, left/insole an insole. A converter in left has the voltages of the
resistors left/heel and, if it has a second channel, left/forefoot.
"""

from contextlib import nullcontext
from math import cos, pi, radians, sin

from blocks.discrete import Derivative
from blocks.models import Limb
from blocks.sensors import ADS1115, NAU7802
from blocks.tables import LookupTable1D
from blocks.wearer import Cuff, SegmentIMU, SoleForce, Walker
from graph import Actuator, Device, Diagram, stack, subsystem
from parts import CUFF_LEVER

# Places of sensors: distance along the segment and in front of it in m. Pelvis and trunk are one rigid segment.
PLACES = {
    "pelvis": (-0.08, -0.1),
    "trunk": (-0.4, -0.1),
    "thigh": (0.2, 0.08),
    "shank": (0.2, 0.05),
    "foot": (0.03, 0.08),
}
# Hip abduction about its mean in walking: cosine and sine of three harmonics of the stride, in degrees, of two adults
# (Sy et al. 2021, sample of gaittoolbox; OpenSense example of OpenSim).
ABDUCTION = ((0.6, -4.1), (0.3, 1.2), (1.5, -0.8))
RESISTOR_SHARE = 0.1  # of the load under heel or forefoot that a force-sensitive resistor bears


def wearer(robot, speed="1.2", mass=70.0, height=1.7, person=0, seed=0, recording=""):
    """Return the plant: an adult who wears the robot.

    speed : m/s, 1.5 s after the first step, or as in "0:0 2:1.2 20:1.2"
    mass, height : kg, m
    person : 0 for the average adult, or the number of another
    recording : path of a recorded motion, as in Walker, instead of speed and person
    """
    devices = [block for block in robot if isinstance(block, Device)]
    cells = {device.path: device for device in devices if isinstance(device, NAU7802)}
    with Diagram("wearer", rate=5 * robot.rate) as plant:
        schedule = speed if ":" in str(speed) else f"0:0 0.5:0 2:{speed}"
        adult = Walker(schedule, mass=mass, height=height, person=person, seed=seed, recording=recording)
        motion = adult()._asdict()
        for device in devices:
            side, _, name = device.path.rpartition("/")
            body = {key.removeprefix(f"{side}_"): signal for key, signal in motion.items()}
            with subsystem(side) if side else nullcontext():
                if isinstance(device, Actuator):
                    torque = actuator(device, name, body, cells.get(f"{device.path}_cell"))
                    if f"{side}_{name}_assistance" in adult.inputs:
                        adult(**{f"{side}_{name}_assistance": torque})
                elif device.path not in cells:
                    emulated = device.emulator(name=name)
                    measured = sensor(robot, device, name, body)
                    emulated(**{port: signal for port, signal in measured.items() if port in emulated.inputs})
    return plant


def actuator(device, name, body, cell):
    """Emulate an actuator and return its torque. body : {output of the Walker without the side: signal}

    cell : the load cell between the limb and its cuff, or None. The adult walks in the sagittal plane; in the frontal
    plane the muscles hold the leg about a usual motion.
    """
    emulated = device.emulator(name=name)
    if name == "abduction":
        frontal = Limb(inertia=2.0, name="frontal_plane")(torque=emulated.torque)
        usual = LookupTable1D(*abduction(), unit="rad", name="usual_abduction")(body["phase"])
        velocity = Derivative(0.01, name="abduction_velocity")(usual)
        emulated(position=frontal.position + usual, velocity=frontal.velocity + velocity)
    elif cell is None:
        emulated(position=body[f"{name}_angle"], velocity=body[f"{name}_velocity"])
    else:
        cuff = Cuff(lever=CUFF_LEVER, name=f"{name}_cuff")
        cuff(angle=body[f"{name}_angle"], velocity=body[f"{name}_velocity"], torque=emulated.torque)
        emulated(position=cuff.position, velocity=cuff.speed)
        cell.emulator(name=f"{name}_cell")(force=cuff.measured)
    return emulated.torque


def abduction(points=100):
    """Return gait phases, and hip abduction in rad at them."""
    phases = [point / points for point in range(points + 1)]
    angles = [
        sum(a * cos(2.0 * pi * n * phase) + b * sin(2.0 * pi * n * phase) for n, (a, b) in enumerate(ABDUCTION, 1))
        for phase in phases
    ]
    return phases, [radians(angle) for angle in angles]


def sensor(robot, device, name, body):
    """Return {input of its emulator: signal} of a sensor. body : as in `actuator`"""
    if name.endswith("_imu"):
        segment = name.removesuffix("_imu")
        along, forward = PLACES[segment]
        motion = body["pelvis_motion" if segment == "trunk" else f"{segment}_motion"]
        return SegmentIMU(along=along, forward=forward, name=f"{segment}_sensor")(motion)._asdict()
    resistors = isinstance(device, ADS1115)
    loads = SoleForce(gain=RESISTOR_SHARE if resistors else 1.0, name="sole")
    load = loads(**{port: body[port] for port in ("ground_force", "centre_of_pressure", "phase")})
    if resistors:
        folder = device.path.rpartition("/")[0]
        places = zip(device.channels, ("heel", "forefoot"))
        return {channel: robot[f"{folder}/{at}"].emulator(name=at)(getattr(load, at)) for channel, at in places}
    return {"force": load.force, "centre": stack(load.centre, 0.0)}
