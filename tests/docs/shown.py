"""Signals, parameters and time spans that show the behaviour of blocks better than those from their declarations."""

import math
from dataclasses import dataclass, field
from typing import Any

RATE = 200.0  # Hz


@dataclass(frozen=True)
class Shown:
    """What an example uses in place of what the declarations determine; None keeps that.

    parameters : parameters of the block
    inputs : {input: expression}
    style : curve, step or waves
    duration : s
    rate : Hz
    walker : parameters of the Walker; with them, its start is shown too
    plant : block that a controller drives, whose outputs its inputs use; closing : wires of its inputs to `command`
    """

    parameters: dict[str, Any] | None = None
    inputs: dict[str, str] = field(default_factory=dict)
    style: str | None = None
    duration: float | None = None
    rate: float = RATE
    walker: str = ""
    plant: str = ""
    closing: str = "torque=command"


JOINT = 'Limb(stiffness=0.0, reflex=0.0, name="plant")'  # a free inertia with friction
SET_POINT = {"reference": 'StepSource(time=0.1, after=0.5, unit="rad")()', "measurement": "plant.position"}
SPEED = {"reference": 'StepSource(time=0.1, unit="rad/s")()', "measurement": "plant.velocity"}
STATE = {"position": "plant.position", "velocity": "plant.velocity"}
TILT = Shown(
    inputs={
        "gyro": 'stack(Sine(frequency=0.5, unit="rad/s")(), 0.0, 0.0)',
        "accel": 'stack(0.0, 0.0, Constant(9.81, unit="m/s²")())',
    },
    duration=10.0,
)
ROTATING = f"Sine(phase={math.pi / 2:.3f})(), Sine()()"  # cosine and sine
LOW_PASS = (0.0201, 0.0402, 0.0201, 1.0, -1.561, 0.6414)  # Butterworth of second order, 10 Hz at 200 Hz
SHOWN = {
    "Admittance": Shown(  # held by a hand as stiff as a spring
        inputs={"torque": 'StepSource(time=0.1, after=15, unit="N·m")() - plant.y'},
        style="step",
        duration=1.0,
        plant='Gain(20.0, unit="N·m/rad", name="plant")',
        closing="command.position",
    ),
    "AdaptiveOscillator": Shown(duration=16.0),
    "BiquadCascade": Shown({"sos": (LOW_PASS,)}),
    "BouncingMass": Shown({"start": 0.5, "restitution": 0.8}, style="time", duration=3.0),
    "Chirp": Shown(duration=5.0),
    "Compiled": Shown(
        {
            "file": "spring.so",
            "takes": {"angle": "rad", "velocity": "rad/s"},
            "gives": {"torque": ("N·m", -40.0, 40.0)},
        },
        {"angle": "plant.position", "velocity": 'plant.velocity - Pulse(high=3.0, delay=0.2, unit="rad/s")()'},
        "waves",
        plant=JOINT,
    ),
    "Complementary": Shown(
        inputs={
            "rate": f'Sine(amplitude={2 * math.pi:.3f}, phase={math.pi / 2:.3f}, unit="rad/s")()',
            "angle": 'Sine(unit="rad")() + GaussianNoise(deviation=0.2, unit="rad")()',
        }
    ),
    "ComplementaryOrientation": TILT,
    "Constant": Shown({"value": 5.0, "unit": "N·m"}),
    "ContinuousIntegrator": Shown(inputs={"u": "StepSource(time=0.1)()"}, style="step", duration=1.0),
    "Cross": Shown(inputs={"a": "stack(1.0, 0.0, 0.0)", "b": f"stack({ROTATING}, 0.0)"}),
    "CubeMarsServo": Shown({"model": "AK80-9", "mode": "current"}),
    "Cuff": Shown({"zero": 10.0, "noise": 2.0}),
    "Debounce": Shown(inputs={"u": 'Compare(">")(Sine()() + Sine(amplitude=0.3, frequency=40.0)(), 0.0)'}),
    "Delay": Shown({"samples": 20}),
    "DirectCurrentMotor": Shown(
        inputs={"voltage": 'StepSource(time=0.1, after=24.0, unit="V")()'}, style="step", duration=0.5, rate=2000.0
    ),
    "Divide": Shown(inputs={"a": "Sine()()", "b": "Sine(frequency=2.0, bias=2.0)()"}),
    "Dot": Shown(inputs={"a": "stack(1.0, 0.0)", "b": f"stack({ROTATING})"}),
    "EmulatedFSR": Shown(inputs={"force": 'Ramp(slope=25.0, unit="N")()'}),
    "EmulatedLoadCell": Shown(inputs={"force": 'Ramp(slope=100.0, initial=-100.0, unit="N")()'}),
    "FSR": Shown(inputs={"voltage": 'Ramp(slope=1.6, unit="V")()'}),
    "DisturbanceObserver": Shown(  # of a load on the plant, which the drive cancels
        {"inertia": 0.35},
        {"torque": "drive.y", "velocity": "plant.velocity"},
        "step",
        1.0,
        plant=f'{JOINT}\n    drive = Gain(-1.0, name="drive")',
        closing='torque=drive.y + StepSource(time=0.1, after=2.0, unit="N·m")())\ndrive(command',
    ),
    "FeedForward": Shown(
        {"inertia": 0.35, "damping": 1.0},
        {
            "velocity": f'Sine(amplitude={math.pi:.3f}, phase={math.pi / 2:.3f}, unit="rad/s")()',
            "acceleration": f'Sine(amplitude={2 * math.pi**2:.3f}, phase={math.pi:.3f}, unit="rad/s²")()',
        },
        "waves",
        plant=JOINT,
        closing="\n    torque=command\n"
        '    + Impedance(stiffness=10.0)(plant.position, plant.velocity, Sine(amplitude=0.5, unit="rad")())\n',
    ),
    "Fmu": Shown(
        {
            "file": "knee.fmu",
            "takes": {"knee.angle": "rad", "velocity": "rad/s"},
            "gives": {"torque": ("N·m", -40.0, 40.0)},
        },
        {"knee_angle": "plant.position", "velocity": 'plant.velocity - Pulse(high=3.0, delay=0.2, unit="rad/s")()'},
        "waves",
        plant=JOINT,
    ),
    "FootContact": Shown(inputs={"heel": "0.7 * walker.left_ground_force[1]"}),
    "Gain": Shown({"gain": 2.5}),
    "IterativeLearning": Shown(  # the command to a drive that gives 70 % of it, 50 ms later
        {"lead": 0.05},
        {"phase": "walker.left_phase", "reference": "PeakProfile()(walker.left_phase)", "measurement": "plant.y"},
        duration=12.0,
        plant='Delay(10, name="plant")',
        closing="0.7 * (PeakProfile()(walker.left_phase) + command.command)",
    ),
    "GaitState": Shown(duration=8.0, walker='speed="0:0 2:0 4:1.2"'),
    "GyroEvents": Shown(inputs={"velocity": "walker.left_shank_motion[7]"}),
    "GravityCompensation": Shown(  # of the weight of the limb, which then stays where it is left
        inputs={"angle": "plant.position"},
        style="waves",
        plant=JOINT,
        closing="\n    torque=command\n"
        '    - Gain(5.884, unit="N·m")(Sin()(plant.position))\n'
        '    + Pulse(high=4.0, period=9.0, duty=0.05, delay=0.2, unit="N·m")()\n',
    ),
    "Hold": Shown({"every": 20}, {"u": "Sine()()"}, "waves"),
    "Impedance": Shown(inputs=STATE | {"equilibrium": SET_POINT["reference"]}, style="step", duration=1.0, plant=JOINT),
    "InverseDynamics": Shown({"file": "examples/leg.urdf"}),
    "Latch": Shown(inputs={"on": 'Compare(">")(Sine()(), 0.5)', "off": 'Compare("<")(Sine()(), -0.5)'}),
    "Limb": Shown(inputs={"torque": 'StepSource(time=0.1, after=15, unit="N·m")()'}, style="step", duration=2.0),
    "LoadCell": Shown(inputs={"signal": "StepSource(time=1.0)()"}, duration=2.0),
    "LookupTable1D": Shown({"breakpoints": (-1.0, 0.0, 0.5, 1.5), "values": (0.0, 1.0, 0.8, 2.0)}, style="curve"),
    "Madgwick": TILT,
    "Mahony": TILT,
    "MassSpringDamper": Shown(
        {"stiffness": 100.0, "damping": 2.0}, {"force": 'StepSource(time=0.1, after=10.0, unit="N")()'}, "step", 5.0
    ),
    "MatrixGain": Shown({"matrix": ((1.0, 1.0), (1.0, -1.0))}),
    "Median": Shown({"samples": 5}, {"u": "Sine()() + Pulse(period=0.3, duty=0.02)()"}, "waves"),
    "MovingAverage": Shown({"window": 0.1}, duration=0.5),
    "MovingMaximum": Shown(inputs={"u": "Chirp(stop=2.0)()"}, style="waves", duration=10.0),
    "MovingMinimum": Shown(inputs={"u": "Chirp(stop=2.0)()"}, style="waves", duration=10.0),
    "MovingRMS": Shown({"window": 0.1}, duration=0.5),
    "MujocoBody": Shown(
        {"file": "examples/leg.xml"},
        {"knee_torque": 'StepSource(time=0.1, after=4.0, unit="N·m")()'},
        "step",
        rate=1000.0,
    ),
    "MuscleTendon": Shown(
        inputs={"excitation": "StepSource(time=0.1)()", "length": 'Constant(0.305, unit="m")()'},
        style="step",
        duration=1.0,
    ),
    "Norm": Shown(inputs={"u": "stack(0.5, Sine()())"}, style="waves"),
    "OnnxModel": Shown(
        {"file": "networks/hip_torque.onnx"},
        {
            "hip_angle": "walker.left_hip_angle",
            "hip_velocity": "walker.left_hip_velocity",
            "opposite_hip_angle": "walker.right_hip_angle",
            "opposite_hip_velocity": "walker.right_hip_velocity",
        },
        "walk",
        10.0,
    ),
    "P": Shown({"kp": 5.0, "unit": "N·m"}, SPEED, "step", 1.0, plant=JOINT),
    "PD": Shown({"kp": 30.0, "kd": 4.0, "unit": "N·m"}, SET_POINT, "step", 1.0, plant=JOINT),
    "PI": Shown({"kp": 5.0, "ki": 20.0, "unit": "N·m"}, SPEED, "step", 1.0, plant=JOINT),
    "PID": Shown({"kp": 30.0, "ki": 30.0, "kd": 4.0, "unit": "N·m"}, SET_POINT, "step", 2.0, plant=JOINT),
    "Pendulum": Shown({"start": 1.0, "damping": 0.1}, style="time", duration=5.0),
    "PhaseKalmanFilter": Shown(inputs={"angle": "walker.left_hip_angle"}, duration=12.0),
    "Playback": Shown({"file": "walk.csv", "column": "knee"}),
    "Polynomial": Shown({"coefficients": (1.0, 0.0, -2.0, 0.5)}, style="curve"),
    "PowerLimiter": Shown({"power": 5.0}),
    "QuaternionFromEuler": Shown(inputs={"yaw": 'Sine(unit="rad")()'}, style="waves"),
    "Ramp": Shown({"slope": 2.0, "time": 0.5, "duration": 1.0}),
    "RMSTorqueLimiter": Shown({"limit": 9.0}, duration=60.0),
    "Select": Shown({"index": 1}, {"u": "stack(Sine()(), Sine(frequency=2)())"}, "waves"),
    "Selector": Shown(inputs={"index": 'Round("floor")(Ramp()())'}),
    "SoftStop": Shown(
        {"lower": -0.8, "upper": 0.8, "stiffness": 50.0},
        {
            "torque": "0.0",
            "position": 'Sine(unit="rad")()',
            "velocity": f'Sine(amplitude={2 * math.pi:.3f}, phase={math.pi / 2:.3f}, unit="rad/s")()',
        },
    ),
    "SegmentOrder": Shown(
        {},
        {
            "left_upper": "walker.left_thigh_motion[7]",
            "right_upper": "walker.right_thigh_motion[7]",
            "left_lower": "walker.left_shank_motion[7]",
            "right_lower": "walker.right_shank_motion[7]",
        },
    ),
    "SegmentPosture": Shown({}, {"left": "walker.left_thigh_pitch", "right": "walker.right_thigh_pitch"}),
    "SensorPlacement": Shown(
        {"sensors": "thigh IMUs", "reference": "hip drives"},
        {
            "left_reference": "walker.left_hip_velocity",
            "right_reference": "walker.right_hip_velocity",
            "left": "walker.left_thigh_motion[7]",
            "right": "walker.right_thigh_motion[7]",
        },
    ),
    "SplineProfile": Shown({"point_3": 4.0, "point_4": 10.0, "point_5": 2.0}),
    "StateMachine": Shown(inputs={"u": "Sine(amplitude=2.0)()"}, style="waves"),
    "StrideEnvelope": Shown(
        inputs={"u": 'walker.left_hip_angle + Pulse(high=0.4, period=20.0, duty=0.01, delay=10.0, unit="rad")()'},
        duration=14.0,
    ),
    "StrideReport": Shown(
        inputs={
            "phase": "walker.left_phase",
            "walking": "True",
            "angle": "walker.left_hip_angle",
            "velocity": "walker.left_hip_velocity",
            "torque": "PeakProfile()(walker.left_phase)",
        }
    ),
    "Tan": Shown(inputs={"u": 'Ramp(slope=1.4, initial=-1.4, unit="rad")()'}),
    "TemperatureDerating": Shown(inputs={"temperature": 'Ramp(slope=25.0, initial=60.0, unit="°C")()'}),
    "ThermalModel": Shown(
        inputs={"torque": 'StepSource(time=60.0, after=9.0, unit="N·m")()'}, duration=3600.0, rate=2.0
    ),
    "Timer": Shown(inputs={"restart": 'Compare(">")(Sine()(), 0.9)'}, style="waves", duration=3.0),
    "TorqueProfile": Shown({"points": ((0.0, 0.0), (0.3, 0.0), (0.5, 10.0), (0.65, 0.0))}),
    "TransferFunction": Shown({"numerator": (1.0,), "denominator": (0.01, 0.1, 1.0), "domain": "s"}),
    "UnitConversion": Shown(style="curve"),
}
