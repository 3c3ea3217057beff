"""Diagrams to draw, of every shape: made by chance from a number, so that each test can name the one that fails."""

import random

from blocks.actuators import CubeMars
from blocks.controllers import Impedance
from blocks.discrete import UnitDelay
from blocks.filters import Butterworth
from blocks.limiters import Saturation, TorqueLimiter
from blocks.mathematics import Gain, Sum
from blocks.recorders import CsvRecorder
from blocks.sources import Sine, StepSource
from graph import Diagram, subsystem


def leg(diagram_name="leg"):
    """One actuator with a filter, a controller and a limiter, in a subsystem; a recorder that takes every port."""
    with Diagram(diagram_name, rate=200) as diagram:
        with subsystem("left"):
            knee = CubeMars("AK10-9-V2.0", bus="legs", can_id=1, name="knee")
            velocity = Butterworth(order=2, cutoff=20.0)(knee.velocity)
            torque = Impedance(stiffness=30.0, damping=1.0)(position=knee.position, velocity=velocity)
            knee(torque_command=TorqueLimiter(limit=12.0, slew=200.0)(torque))
        CsvRecorder()
    return diagram


def by_chance(seed, size=40):
    """About `size` blocks in nested subsystems, with signals that fan out, cross frames, and go back through delays."""
    chance = random.Random(seed)
    with Diagram(f"chance {seed}", rate=100) as diagram:
        signals, delays = [Sine(frequency=float(n + 1))() for n in range(chance.randint(1, 4))], []
        if chance.random() < 0.5:
            knee = CubeMars("AK80-9", name="knee")
            signals += [knee.position, knee.velocity]
        grow(chance, size, signals, delays, depth=0)
        for delay in delays:
            delay(chance.choice(signals))
        if "knee" in diagram.blocks:
            knee(torque_command=TorqueLimiter(limit=5.0)(Gain(unit="N·m")(Gain(unit="1")(Sine()()))))
        if chance.random() < 0.7:
            CsvRecorder()
    return diagram


def grow(chance, size, signals, delays, depth):
    """Add blocks that listen to what there is; some of them in a subsystem of their own."""
    while size > 0:
        if depth < 3 and size > 4 and chance.random() < 0.15:
            inside = chance.randint(2, size - 1)
            with subsystem(chance.choice("abcdef")):
                grow(chance, inside, signals, delays, depth + 1)
            size -= inside
            continue
        signals.append(one_more(chance, signals[-chance.randint(1, 30) :], delays))
        size -= 1


def one_more(chance, near, delays):
    kind = chance.randrange(5)
    if kind == 0:
        delays.append(UnitDelay())
        return delays[-1].y
    if kind == 1:
        return Gain(2.0)(chance.choice(near))
    if kind == 2:
        return Saturation(-1.0, 1.0)(chance.choice(near))
    signs = chance.choice(("++", "+-", "+++"))
    return Sum(signs)(*(chance.choice(near) for _ in signs))


def nested():
    """Subsystems in subsystems on both sides of a body, one of them slow and one that is switched on; constants and a
    long name.
    """
    with Diagram("nested", rate=200) as diagram:
        switch = StepSource(name="switch")()
        with subsystem("supervisor", every=10):
            level = Gain(0.5)(Sine(frequency=2.0)())
        for side in ("left", "right"):
            with subsystem(side):
                for joint in ("hip", "knee"):
                    number = len([block for block in diagram if isinstance(block, CubeMars)]) + 1
                    with subsystem(joint):
                        drive = CubeMars("AK80-9", bus=side, can_id=number, name="drive")
                        spring = Impedance(stiffness=3.0, name="a_spring_with_a_rather_long_name")
                        torque = spring(position=drive.position, velocity=drive.velocity, equilibrium=0.25)
                        drive(torque_command=TorqueLimiter(limit=5.0, name="limiter")(torque))
                with subsystem("extra", enabled=switch):
                    Butterworth()(Sum("+-")(level, level))
        CsvRecorder()
    return diagram


def wrong():
    """A gain behind the limiter, and an input that nothing is wired to."""
    with Diagram("wrong", rate=100) as diagram:
        knee = CubeMars("AK80-9", name="knee")
        knee(
            torque_command=Gain(3.0)(
                TorqueLimiter(limit=8.0)(Impedance()(position=knee.position, velocity=knee.velocity))
            )
        )
        Sum("++", name="lonely")(knee.torque)
        CsvRecorder()
    return diagram


def walk():
    """Two legs that are driven by their common velocity: each senses and acts."""
    with Diagram("walk", rate=100) as diagram:
        legs = []
        for side in ("left", "right"):
            with subsystem(side):
                legs.append(CubeMars("AK80-9", bus=side, name="knee"))
        both = Sum("++", name="both")(legs[0].velocity, legs[1].velocity)
        for side, knee in zip(("left", "right"), legs):
            with subsystem(side):
                knee(torque_command=TorqueLimiter(limit=5.0, name="limiter")(Gain(unit="N·m·s/rad")(both)))
    return diagram
