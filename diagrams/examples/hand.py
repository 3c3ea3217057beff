"""Plant of imu_to_actuator.py and imu_to_torque.py: a hand tilts the sensor, and the motor has a load."""

from math import pi

from blocks.models import Limb
from blocks.quaternions import QuaternionFromEuler
from blocks.sources import Sine
from graph import Diagram, stack

AMPLITUDE, FREQUENCY = 0.5, 0.5  # rad, Hz


def plant(robot):
    """Return the plant, at 5 steps per tick."""
    with Diagram("hand", rate=5 * robot.rate) as hand:
        attitude = QuaternionFromEuler()(pitch=Sine(amplitude=AMPLITUDE, frequency=FREQUENCY)())
        rate = Sine(amplitude=AMPLITUDE * 2.0 * pi * FREQUENCY, frequency=FREQUENCY, phase=pi / 2.0, unit="rad/s")()
        robot["imu"].emulator()(quaternion=attitude, gyro=stack(0.0, rate, 0.0))
        motor, load = robot["motor"].emulator(), Limb(inertia=0.1, damping=0.1, stiffness=0.0, reflex=0.0)
        load(torque=motor.torque)
        motor(position=load.position, velocity=load.velocity)
    return hand
