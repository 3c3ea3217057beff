"""Hip exoskeleton with two degrees of freedom: four AK80-9, eight inertial sensors, and two resistors under each foot.

    python -m runtime diagrams/hip_exo_2dof.py --duration 20
    python -m runtime diagrams/hip_exo_2dof.py --duration 20 --set mass=90 --set scale=0.1

Two neural networks receive the motion of both thighs: one estimates the biological torque of each hip, of which a share
assists flexion and extension (Molinaro et al. 2024), the other the gait phase, without which no torque acts. While the
resistors under a foot bear load, the other actuator of that hip supports abduction, which keeps the pelvis level.
"""

from blocks.gait import ContactEvents, TorqueGate
from blocks.recorders import CsvRecorder
from blocks.sensors import ADS1115, FSR
from blocks.sinks import PlotJuggler
from graph import Diagram, subsystem
from parts import (
    SEGMENTS,
    SIDES,
    assist,
    drive,
    driven,
    hip_assistance,
    imu,
    learned_gait,
    ordered,
    placed,
    rates,
    walk,
)
from wearer import wearer as plant  # noqa: F401


def build(mass=70.0, scale=0.15, delay=0.15, support=5.0):
    """Return the robot.

    mass : mass of the wearer, kg
    scale, delay : share of the biological torque, and its delay in s
    support : torque in abduction in stance, N·m
    """
    with Diagram("hip_exo_2dof", rate=200) as diagram:
        imu("trunk", "133910")
        imu("pelvis", "133911")
        thighs, shanks, feet, loads, stances, hips, abductors = ({} for _ in range(7))
        for number, side in enumerate(SIDES):
            with subsystem(side):
                segments = (imu(segment, f"1339{2 + number}{place}") for place, segment in enumerate(SEGMENTS))
                thighs[side], shanks[side], feet[side] = segments
                sole = resistors(number)
                loads[side], stances[side] = sole.load, sole.contact
        gaits = learned_gait(thighs, shanks)
        walking = walk(gaits)
        torques = hip_assistance(thighs, mass, scale, delay)
        for number, (side, leg) in enumerate(gaits.items()):
            with subsystem(side):
                hips[side] = drive(side, "hip", 1 + 2 * number)
                assist(hips[side], torques[side], walking, leg)
                held = TorqueGate(fade_in=0.1, fade_out=0.05, name="stance_gate")(u=support, enable=stances[side])
                abductors[side] = drive(side, "abduction", 2 + 2 * number)
                assist(abductors[side], held, walking, leg)
        placed("thigh IMUs", rates(thighs), "hip drives", rates(hips))
        placed("resistors", loads, "thigh IMUs", rates(thighs), opposite=True, enable=walking)
        placed("shank IMUs", rates(shanks), "resistors", loads, opposite=True, enable=walking)
        placed("foot IMUs", rates(feet), "shank IMUs", rates(shanks), enable=walking)
        ordered(walking, thigh=thighs, shank=shanks, foot=feet)
        driven("abduction", abductors, "resistors", loads, thighs, shanks, walking, opposite=True)
        CsvRecorder()
        PlotJuggler()
    return diagram


def resistors(number):
    """Return the events of contact of one foot, from its two resistors. number : 0 left, 1 right"""
    converter = ADS1115(channels=("a0", "a1"), address=0x48 + number, timeout=0.1, bus="feet", name="converter")
    load = FSR(name="heel")(converter.a0).force + FSR(name="forefoot")(converter.a1).force
    return ContactEvents(smallest=10.0, name="events")(load)
