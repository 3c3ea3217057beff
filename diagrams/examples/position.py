"""A motor follows a sine about the angle at which it was started: position control in the drive."""

from blocks.actuators import CubeMars
from blocks.recorders import CsvRecorder
from blocks.sources import Sine
from graph import Diagram, main

with Diagram("position", rate=200) as diagram:
    motor = CubeMars("AK80-9", can_id=1, zero_at_arming=True, name="motor")
    angle = Sine(amplitude=0.5, frequency=0.5)()
    motor(position_command=angle, stiffness_command=20.0, damping_command=1.0)
    CsvRecorder()
main(diagram)
