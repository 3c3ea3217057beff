"""The torque of a motor follows the angular rate of an inertial sensor that is held in the hand."""

from blocks.actuators import CubeMars
from blocks.discrete import Derivative
from blocks.imus import MicroStrain
from blocks.limiters import TorqueLimiter
from blocks.mathematics import Gain
from blocks.recorders import CsvRecorder
from graph import Diagram, main
from hand import plant  # noqa: F401

with Diagram("imu_to_torque", rate=200) as diagram:
    rate = MicroStrain("133931", channels=("gyro",), name="imu").gyro[1]
    motor = CubeMars("AK80-9", can_id=1, zero_at_arming=True, name="motor")
    torque = Gain(0.25, unit="N·m·s/rad")(rate) + Gain(0.01, unit="N·m·s²/rad")(Derivative()(rate))
    motor(torque_command=TorqueLimiter(limit=motor.torque_limit)(torque))
    CsvRecorder()
main(diagram)
