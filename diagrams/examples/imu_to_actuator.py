"""A motor turns with the pitch of an inertial sensor that is held in the hand."""

from blocks.actuators import CubeMars
from blocks.imus import MicroStrain
from blocks.recorders import CsvRecorder
from graph import Diagram, main
from hand import plant  # noqa: F401

with Diagram("imu_to_actuator", rate=200) as diagram:
    imu = MicroStrain("133931", channels=("euler",), name="imu")
    motor = CubeMars("AK80-9", can_id=1, zero_at_arming=True, name="motor")
    motor(position_command=imu.euler[1], stiffness_command=20.0, damping_command=1.0)
    CsvRecorder()
main(diagram)
