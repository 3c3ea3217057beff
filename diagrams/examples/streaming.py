"""Two motors in antiphase, shown live in PlotJuggler at 100 samples per second."""

from blocks.actuators import CubeMars
from blocks.sinks import PlotJuggler
from blocks.sources import Sine
from graph import Diagram, main

with Diagram("streaming", rate=200) as diagram:
    for can_id, (side, amplitude) in enumerate({"left": 0.5, "right": -0.5}.items(), 1):
        motor = CubeMars("AK80-9", can_id=can_id, zero_at_arming=True, name=side)
        angle = Sine(amplitude=amplitude, frequency=0.5)()
        motor(position_command=angle, stiffness_command=20.0, damping_command=1.0)
    PlotJuggler(signals="left, right", decimation=2)
main(diagram)
