"""Ankle exoskeleton: AK80-9 or CyberGear push off, with five inertial sensors, two insoles, load cells and networks.

    python -m runtime diagrams/ankle_exo.py --duration 20
    python -m runtime diagrams/ankle_exo.py --duration 20 --set model=CyberGear
    python -m runtime diagrams/ankle_exo.py --duration 20 --set right_model=CyberGear
    python -m runtime diagrams/ankle_exo.py --duration 20 --set mass=90 --set assistance=0.5 --set peak_time=0.5

One network estimates the gait phase from both thighs, the other the biological torque of each ankle from its leg. One
peak per stride extends the ankle at push-off, by at most a share of the biological torque, and fades with the load on
the insole. Peak, peak time, rise and fall are live, for both legs at once, as optimisation with the wearer in the loop
needs them. With one actuator of each kind, both have the limit of the weaker one. Positive torque is in dorsiflexion.
"""

from blocks.gait import BiologicalTorque, PeakProfile
from blocks.limiters import Saturation
from blocks.mathematics import Gain, Max
from blocks.recorders import CsvRecorder
from blocks.sensors import NAU7802
from blocks.sinks import PlotJuggler
from graph import Diagram, Live, stack, subsystem
from parts import CUFF_LEVER, SIDES, assist, drive, flexion, imu, insole, learned_gait, leg_torque, placed, rates, walk
from wearer import wearer as plant  # noqa: F401

LIMITS = {"AK80-9": 8.0, "CyberGear": 4.0}  # N·m
FULL_LOAD = 0.5  # load on the insole above which the torque is full, relative to the peak of a stride


def build(model="AK80-9", right_model="", mass=70.0, assistance=1.0, peak_time=0.53, share=0.2):
    """Return the robot.

    model, right_model : AK80-9 or CyberGear, of both actuators, or of the left and the right one
    mass : mass of the wearer, kg
    assistance : peak torque as a share of the limit, from 0 to 1
    peak_time : gait phase of the peak
    share : largest share of the biological torque
    """
    models = {"left": model, "right": right_model or model}
    limit = min(LIMITS[name] for name in models.values())
    with Diagram("ankle_exo", rate=200) as diagram:
        imu("pelvis", "133960")
        thighs, shanks, bounds, soles, loads = {}, {}, {}, {}, {}
        for number, side in enumerate(SIDES, 1):
            with subsystem(side):
                thighs[side], shanks[side] = imu("thigh", f"13396{number}"), imu("shank", f"13397{number}")
                torque = leg_torque("ankle", flexion("knee", thighs[side], shanks[side]), thighs[side], mass)
                bounds[side] = BiologicalTorque(share, delay=0.0, name="bound")(torque)
                soles[side] = insole(side).load
                loads[side] = Saturation(0.0, 1.0, name="load")(soles[side] / FULL_LOAD)
                cell = NAU7802(
                    bus="cells", mux=0x70, channel=number - 1, rate=80, capacity=200.0, timeout=0.1, name="ankle_cell"
                )
                Gain(CUFF_LEVER, unit="m", name="measured_torque")(cell.force)
        gaits = learned_gait(thighs, shanks)
        walking = walk(gaits)
        peak = Live(-assistance * limit, min=-limit, max=0.0)
        push_off = PeakProfile(peak, Live(peak_time, min=0.4, max=0.6), rise=0.1, fall=0.09, name="push_off")
        torques = push_off(stack(*(leg.phase for leg in gaits.values())))
        for number, (side, leg) in enumerate(gaits.items()):
            with subsystem(side):
                torque = Max(name="bounded")(torques[number], bounds[side]) * loads[side]
                assist(drive(side, "ankle", number + 1, models[side]), torque, walking, leg, limit=limit, slew=300.0)
        placed("thigh IMUs", rates(thighs), "insoles", soles, opposite=True, enable=walking)
        placed("shank IMUs", rates(shanks), "insoles", soles, opposite=True, enable=walking)
        CsvRecorder()
        PlotJuggler()
    return diagram
