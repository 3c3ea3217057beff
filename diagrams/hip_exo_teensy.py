"""Hip exoskeleton with microcontrollers: two AK80-9 V2.0, and on each thigh a Teensy with a six-axis inertial sensor.

    python -m runtime diagrams/hip_exo_teensy.py --duration 20
    python -m runtime diagrams/hip_exo_teensy.py --duration 20 --set feedback.gain=5

docs/sketches/imu.ino runs on the microcontrollers. A complementary filter estimates the flexion of each thigh, from
which delayed output feedback assists both hips. The computer of this robot is a Raspberry Pi 5, at 100 Hz.
"""

from math import radians

from blocks.gait import DelayedOutputFeedback
from blocks.recorders import CsvRecorder
from blocks.sensors import Microcontroller
from blocks.sinks import PlotJuggler
from graph import Diagram, Live, subsystem
from parts import SIDES, assist, drive, gait, ordered, pitch, placed, rates, walk
from wearer import wearer as plant  # noqa: F401

FIELDS = (
    ("t", "uint32", "s", 1e-6),
    ("accel", "int16[3]", "m/s²", 9.80665 / 4096),
    ("gyro", "int16[3]", "rad/s", radians(1.0 / 32.8)),
)


def build(gain=6.0, delay=0.22):
    """Return the robot. gain : N·m, 9 at most; delay : s, about a fifth of a stride"""
    with Diagram("hip_exo_teensy", rate=100) as diagram:
        thighs, gaits = {}, {}
        for side in SIDES:
            with subsystem(side):
                sensor = Microcontroller(fields=FIELDS, clock="t", packet_rate=100, name="thigh_imu")
                thighs[side] = pitch("thigh", sensor)
                gaits[side] = gait(*thighs[side])
        walking = walk(gaits)
        torques = DelayedOutputFeedback(Live(gain, max=9.0), delay, name="feedback")(
            left_angle=thighs["left"].angle, right_angle=thighs["right"].angle
        )
        hips = {}
        for can_id, (side, torque) in enumerate(zip(SIDES, torques), 1):
            with subsystem(side):
                hips[side] = drive(side, "hip", can_id, "AK80-9-V2.0")
                assist(hips[side], torque, walking, gaits[side])
        placed("thigh IMUs", rates(thighs), "hip drives", rates(hips))
        ordered(walking, thigh=thighs)
        CsvRecorder()
        PlotJuggler()
    return diagram
