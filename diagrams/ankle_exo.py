"""Ankle exoskeleton: AK80-9 or CyberGear push off, with five inertial sensors, two insoles, load cells and networks.

    python -m runtime diagrams/ankle_exo.py --duration 20
    python -m runtime diagrams/ankle_exo.py --duration 20 --set mass=90 --set peak_torque=0.3 --set peak_time=0.5
    python -m runtime diagrams/ankle_exo.py --duration 20 --set model=CyberGear
    python -m runtime diagrams/ankle_exo.py --duration 20 --set right_model=CyberGear

One network estimates the gait phase from both thighs, the other the biological torque of each ankle from its leg. One
peak per stride extends the ankle at push-off. Its peak, peak time, rise and fall are live, for both legs at once, as
optimisation with the wearer in the loop needs them. Positive torque is in dorsiflexion.

As published: the profile of Zhang et al. 2017, at the mean of the values that were optimised for its subjects (peak at
52.9 % of the stride, rise of 26.2 %, fall of 9.8 %), with a peak of 0.54 N·m/kg (Poggensee and Collins 2021). What
differs: the drives are those of Leestma et al. behind a transmission of 3 : 1, where the two papers have cables to
off-board motors. The torque is at most half of the estimated biological torque, fades with the load on the insole, and
is limited to what the drive can repeat in every stride: 50 N·m, or 30 N·m with a CyberGear on either leg.

An ankle that turns faster than 16.6 rad/s, or 9.9 rad/s with a CyberGear, ends the run: in simulations of 41 adults at
1.2 m/s none, or three, and at 1.6 m/s one, or eight. A CyberGear is for slower walking.
"""

from blocks.gait import BiologicalTorque, PeakProfile
from blocks.limiters import Saturation
from blocks.mathematics import Gain, Max, Min
from blocks.recorders import CsvRecorder
from blocks.sensors import NAU7802
from blocks.sinks import PlotJuggler
from graph import Diagram, Live, stack, subsystem
from parts import (
    CUFF_LEVER,
    SIDES,
    assist,
    drive,
    driven,
    flexion,
    imu,
    insole,
    learned_gait,
    leg_torque,
    ordered,
    placed,
    rates,
    walk,
)
from wearer import wearer as plant  # noqa: F401

TRANSMISSION = 3.0  # motor angle over ankle angle
LIMITS = {"AK80-9": 50.0, "CyberGear": 30.0}  # N·m at the ankle: below the peak torque, RMS of a stride below the rated
FULL_LOAD = 0.7  # load on the insole above which the torque is full, relative to the peak of a stride


def build(model="AK80-9", right_model="", mass=70.0, peak_torque=0.54, peak_time=0.529, rise=0.262, fall=0.098):
    """Return the robot.

    model, right_model : AK80-9 or CyberGear, of both actuators, or of the left and the right one
    mass : mass of the wearer, kg
    peak_torque : of the profile, N·m/kg
    peak_time, rise, fall : gait phase of the peak, phase from 0 to it, and from it to 0
    """
    models = {"left": model, "right": right_model or model}
    for name in models.values():
        if name not in LIMITS:
            raise ValueError(f"model must be {' or '.join(LIMITS)}, got {name!r}")
    limit = min(LIMITS[name] for name in models.values())
    with Diagram("ankle_exo", rate=200) as diagram:
        imu("pelvis", "133960")
        thighs, shanks, bounds, soles, loads, ankles = ({} for _ in range(6))
        for number, side in enumerate(SIDES, 1):
            with subsystem(side):
                thighs[side], shanks[side] = imu("thigh", f"13396{number}"), imu("shank", f"13397{number}")
                torque = leg_torque("ankle", flexion("knee", thighs[side], shanks[side]), thighs[side], mass)
                bounds[side] = Min()(BiologicalTorque(0.5, delay=0.0, name="bound")(torque), 0.0)
                soles[side] = insole(side).load
                loads[side] = Saturation(0.0, 1.0, name="load")(soles[side] / FULL_LOAD)
                cell = NAU7802(
                    bus="cells", mux=0x70, channel=number - 1, rate=80, capacity=200.0, timeout=0.1, name="ankle_cell"
                )
                Gain(CUFF_LEVER, unit="m", name="measured_torque")(cell.force)
        gaits = learned_gait(thighs, shanks)
        walking = walk(gaits)
        peak = Live(-min(peak_torque * mass, limit), min=-limit, max=0.0)
        push_off = PeakProfile(peak, Live(peak_time, min=0.4, max=0.6), rise=rise, fall=fall, name="push_off")
        torques = push_off(stack(*(leg.phase for leg in gaits.values())))
        for number, (side, leg) in enumerate(gaits.items()):
            with subsystem(side):
                torque = Max(name="bounded")(torques[number], bounds[side]) * loads[side]
                ankles[side] = drive(side, "ankle", number + 1, models[side], limit="peak", gear_ratio=TRANSMISSION)
                assist(ankles[side], torque, walking, leg, limit=limit, slew=2000.0, uncertainty=leg.uncertainty)
        placed("thigh IMUs", rates(thighs), "insoles", soles, opposite=True, enable=walking)
        placed("shank IMUs", rates(shanks), "insoles", soles, opposite=True, enable=walking)
        ordered(walking, thigh=thighs, shank=shanks)
        driven("ankle", ankles, "insoles", soles, thighs, shanks, walking)
        CsvRecorder()
        PlotJuggler()
    return diagram
