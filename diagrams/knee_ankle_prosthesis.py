"""Prosthetic knee and ankle of one leg: two RS04, an inertial sensor on the thigh, and a load cell in the shank.

    python -m runtime diagrams/knee_ankle_prosthesis.py --duration 20
    python -m runtime diagrams/knee_ankle_prosthesis.py --duration 20 --set side=right --set mass=90
    python -m runtime diagrams/knee_ankle_prosthesis.py --duration 20 --set controller=phase

A state machine selects stiffness, damping and equilibrium of both joints: early stance, late stance from the
dorsiflexion that the weight causes, early swing when the foot leaves the ground, late swing when the knee begins to
extend, and standing after a stance of 1 s. (Sup et al. 2008) Weight on the foot ends each swing. With
`controller=phase`, as in Best et al. 2023, the same quantities are continuous functions of a gait phase, which the
residual thigh determines; while the phase is not known, or the foot bears weight in its swing, those of early stance
hold. Stiffness and damping of each joint that add to those of the controller are live.

As published: the structure of both controllers, and impedances that scale with the mass of the wearer. What differs:
their values, which were tuned on the simulated wearer (diagrams/amputee.py) from those of the Open-Source Leg's
example; stance and swing both have impedances, where Best et al. track angles in swing; and the drives, two RS04. After
a safe stop both joints are damped for 5 s and then free: the wearer must not stand on them. Without torque the leg does
not bear weight either, also in the first half second. Positive torque flexes the knee and the ankle (dorsiflexion).
"""

from math import radians

from amputee import amputee as plant  # noqa: F401
from blocks.controllers import Impedance
from blocks.limiters import TorqueLimiter
from blocks.logic import And, Compare, Switch
from blocks.mathematics import Gain
from blocks.recorders import CsvRecorder, StrideReport
from blocks.sensors import NAU7802
from blocks.sinks import PlotJuggler
from blocks.states import StateMachine
from blocks.tables import LookupTable1D
from graph import Diagram, Live, subsystem
from parts import POSITIVE, drive, gait, imu

LIMITS = {"knee": 60.0, "ankle": 110.0}  # N·m
ADDED = (30.0, 1.0)  # N·m/rad and N·m·s/rad, live, at most
HEAVIEST = 90.0  # kg, with which the RMS torque of the ankle in walking is the rated one
UNITS = {"stiffness": "N·m/rad", "damping": "N·m·s/rad", "equilibrium": "rad"}

# Stiffness in N·m/rad/kg, damping in N·m·s/rad/kg and equilibrium in degrees of the knee, then of the ankle.
STATES = {
    "early_stance": ((1.65, 0.05, 20.0), (0.9, 0.055, 0.0)),
    "late_stance": ((1.65, 0.03, 12.0), (2.3, 0.05, -14.0)),
    "early_swing": ((0.5, 0.01, 55.0), (0.3, 0.03, 6.0)),
    "late_swing": ((0.8, 0.09, 20.0), (0.5, 0.055, 0.0)),
    "standing": ((1.65, 0.05, 10.0), (1.5, 0.055, 2.0)),
}
TRANSITIONS = [  # load in body weights, angles in rad, velocities in rad/s
    ("early_stance", "late_stance", "ankle > 0.12 and ankle_velocity > 0.2 and load > 0.25 and time_in_state > 0.1"),
    ("early_stance", "early_swing", "load < 0.02 and time_in_state > 0.2"),
    ("early_stance", "standing", "time_in_state > 1"),
    ("late_stance", "early_swing", "load < 0.15"),
    ("late_stance", "standing", "time_in_state > 1"),
    ("standing", "early_swing", "load < 0.02"),
    ("early_swing", "early_stance", "load > 0.4 and time_in_state > 0.1"),
    ("early_swing", "late_swing", "knee > 0.7 and knee_velocity < 0.05 or time_in_state > 0.4"),
    ("late_swing", "early_stance", "load > 0.2 or time_in_state > 1"),
]
PHASES = {  # the same over the gait phase
    0.0: ((1.65, 0.05, 20.0), (0.9, 0.055, 0.0)),
    0.2: ((1.65, 0.05, 20.0), (0.9, 0.055, 0.0)),
    0.4: ((1.65, 0.03, 12.0), (2.3, 0.05, -10.0)),
    0.54: ((1.65, 0.03, 12.0), (2.3, 0.05, -14.0)),
    0.62: ((0.5, 0.01, 55.0), (0.3, 0.03, 0.0)),
    0.72: ((0.5, 0.02, 55.0), (0.3, 0.03, 6.0)),
    0.78: ((0.7, 0.08, 18.0), (0.5, 0.055, 0.0)),
    0.95: ((0.8, 0.09, 20.0), (0.5, 0.055, 0.0)),
    1.0: ((1.65, 0.05, 20.0), (0.9, 0.055, 0.0)),
}


def build(side="left", controller="states", mass=70.0):
    """Return the robot. side : left or right; controller : states or phase; mass : mass of the wearer, kg"""
    if controller not in ("states", "phase"):
        raise ValueError(f"controller must be 'states' or 'phase', got {controller!r}")
    if mass > HEAVIEST:
        raise ValueError(f"mass is at most {HEAVIEST:g} kg, got {mass:g}: the drive of the ankle would overheat")
    with Diagram("knee_ankle_prosthesis", rate=200) as diagram:
        with subsystem(side):
            drives = {
                joint: drive(side, joint, number, "RS04", limit="peak", stop_time=5.0)
                for number, joint in enumerate(LIMITS, 1)
            }
            force = NAU7802(
                bus="cells", rate=320, capacity=2500.0, tare_at_start=False, timeout=0.1, name="pylon_cell"
            ).force
            load = Gain(1.0 / (9.80665 * mass), unit="1/N", name="load")(force)
            leg = gait(*imu("thigh", "133951"))
            chosen = by_state(drives, load, mass) if controller == "states" else by_phase(leg, load, mass)
            for joint, motor in drives.items():
                stiffness, damping, equilibrium = (chosen[f"{joint}_{name}"] for name in UNITS)
                law = Impedance(*(Live(0.0, min=0.0, max=most) for most in ADDED), name=f"{joint}_impedance")
                torque = law(motor.position, motor.velocity, equilibrium, stiffness, damping)
                motor(torque_command=TorqueLimiter(LIMITS[joint], slew=2000.0, name=f"{joint}_limiter")(torque))
                StrideReport(title=f"{side} {joint}", positive=POSITIVE[joint], name=f"{joint}_report")(
                    phase=leg.phase,
                    walking=leg.walking,
                    angle=motor.position,
                    velocity=motor.velocity,
                    torque=motor.torque,
                )
        CsvRecorder()
        PlotJuggler()
    return diagram


def scaled(values, mass):
    """Return {joint_quantity: value} of one row of STATES or PHASES. mass : kg"""
    return {
        f"{joint}_{name}": radians(value) if name == "equilibrium" else mass * value
        for joint, row in zip(LIMITS, values)
        for name, value in zip(UNITS, row)
    }


def by_state(drives, load, mass):
    """Return {joint_quantity: signal} of the state machine. load : body weights; mass : kg"""
    states = {state: scaled(values, mass) for state, values in STATES.items()}
    machine = StateMachine(
        takes={"load": "1", "ankle": "rad", "ankle_velocity": "rad/s", "knee": "rad", "knee_velocity": "rad/s"},
        gives={f"{joint}_{name}": unit for joint in LIMITS for name, unit in UNITS.items()},
        states=states,
        transitions=TRANSITIONS,
        name="machine",
    )
    motion = {name: drive.position for name, drive in drives.items()}
    machine(load=load, **motion, **{f"{name}_velocity": drive.velocity for name, drive in drives.items()})
    return {name: getattr(machine, name) for name in states["early_stance"]}


def by_phase(leg, load, mass):
    """Return {joint_quantity: signal} over the gait phase. load : body weights; mass : kg"""
    swings, loaded = Compare(">", name="swings")(leg.phase, 0.6), Compare(">", name="loaded")(load, 0.4)
    trusted = And(name="trusted")(leg.walking, Compare("==")(And()(swings, loaded), 0.0))
    phase = Switch(name="phase")(trusted, leg.phase, 0.1)
    rows = [scaled(values, mass) for values in PHASES.values()]
    return {
        name: LookupTable1D(tuple(PHASES), tuple(row[name] for row in rows), unit=unit, name=name)(phase)
        for joint in LIMITS
        for name, unit in ((f"{joint}_{quantity}", unit) for quantity, unit in UNITS.items())
    }
