"""Ankle exoskeleton: two AK80-9 push off, with five inertial sensors, two insoles and two load cells.

    python -m runtime diagrams/ankle_exo.py --duration 20
    python -m runtime diagrams/ankle_exo.py --duration 20 --set model=CyberGear
    python -m runtime diagrams/ankle_exo.py --duration 20 --set assistance=0.5 --set peak_time=0.5

The insole gives the strikes and the thigh the gait phase; one peak per stride extends the ankle at push-off. Peak,
peak time, rise and fall are live, for both legs at once, as optimisation with the wearer in the loop needs them.
Positive torque is in dorsiflexion.
"""

from blocks.gait import PeakProfile
from blocks.mathematics import Gain
from blocks.recorders import CsvRecorder
from blocks.sensors import NAU7802
from blocks.sinks import PlotJuggler
from graph import Diagram, Live, stack, subsystem
from parts import CUFF_LEVER, SIDES, assist, drive, flexion, gait, imu, insole, walk
from parts import wearer as plant  # noqa: F401

LIMITS = {"AK80-9": 8.0, "CyberGear": 4.0}  # N·m


def build(model="AK80-9", assistance=1.0, peak_time=0.54):
    """Return the robot.

    model : of both actuators, AK80-9 or CyberGear
    assistance : peak torque as a share of the limit, from 0 to 1
    peak_time : gait phase of the peak
    """
    limit = LIMITS[model]
    with Diagram("ankle_exo", rate=200) as diagram:
        pelvis = imu("pelvis", "133960")
        ankles, gaits = {}, {}
        for number, side in enumerate(SIDES, 1):
            with subsystem(side):
                ankles[side] = drive(side, "ankle", number, model)
                thigh, shank = imu("thigh", f"13396{number}"), imu("shank", f"13397{number}")
                flexion("hip", thigh, pelvis)
                flexion("knee", thigh, shank)
                cell = NAU7802(bus="cells", mux=0x70, channel=number - 1, rate=80, capacity=200.0, name="ankle_cell")
                Gain(CUFF_LEVER, unit="m", name="measured_torque")(cell.force)
                gaits[side] = gait(*thigh, insole(side).strike)
        peak = Live(-assistance * limit, min=-limit, max=0.0)
        push_off = PeakProfile(peak, Live(peak_time, min=0.4, max=0.6), rise=0.1, fall=0.09, name="push_off")
        torques = push_off(
            phase=stack(*(leg.phase for leg in gaits.values())), enable=stack(*(leg.walking for leg in gaits.values()))
        )
        walking = walk(gaits)
        for index, (side, leg) in enumerate(gaits.items()):
            with subsystem(side):
                assist(ankles[side], torques[index], walking, leg, limit=limit, slew=300.0)
        CsvRecorder()
        PlotJuggler()
    return diagram
