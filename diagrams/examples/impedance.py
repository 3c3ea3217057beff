"""A virtual spring and damper, whose equilibrium jumps every two seconds; stiffness and damping change in the run."""

from blocks.actuators import CubeMars
from blocks.controllers import Impedance
from blocks.limiters import TorqueLimiter
from blocks.recorders import CsvRecorder
from blocks.sources import Pulse
from graph import Diagram, main

with Diagram("impedance", rate=500) as diagram:
    motor = CubeMars("AK80-9", can_id=1, zero_at_arming=True, name="motor")
    angle = Pulse(high=0.5, period=4.0)()
    spring = Impedance(stiffness=10.0, damping=1.0, name="spring")
    torque = spring(position=motor.position, velocity=motor.velocity, equilibrium=angle)
    motor(torque_command=TorqueLimiter(limit=9.0)(torque))
    CsvRecorder()
main(diagram)
