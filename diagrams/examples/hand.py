"""Plant of imu_to_actuator.py: a hand that tilts the inertial sensor, and the load of the motor."""

from blocks.models import Limb
from blocks.quaternions import QuaternionFromEuler
from blocks.sources import Sine
from graph import Diagram


def plant(robot):
    """Return the plant, at 5 steps per tick."""
    with Diagram("hand", rate=5 * robot.rate) as hand:
        attitude = QuaternionFromEuler()(pitch=Sine(amplitude=0.5, frequency=0.5)())
        robot["imu"].emulator()(quaternion=attitude)
        motor, load = robot["motor"].emulator(), Limb(inertia=0.1, damping=0.1, stiffness=0.0, reflex=0.0)
        load(torque=motor.torque)
        motor(position=load.position, velocity=load.velocity)
    return hand
