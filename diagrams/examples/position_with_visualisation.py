"""A leg of two motors that steps, shown in 3-D in Rerun, with plots of each joint."""

from blocks.actuators import CubeMars
from blocks.sinks import Rerun
from blocks.sources import Sine
from graph import Diagram, main, subsystem

with Diagram("position_with_visualisation", rate=200) as diagram:
    with subsystem("left"):
        for can_id, (joint, phase) in enumerate({"hip": 0.0, "knee": -1.0}.items(), 1):
            motor = CubeMars("AK80-9", can_id=can_id, zero_at_arming=True, name=joint)
            angle = Sine(amplitude=0.5, frequency=0.5, phase=phase, name=f"{joint}_angle")()
            motor(position_command=angle, stiffness_command=20.0, damping_command=1.0)
    Rerun()
main(diagram)
