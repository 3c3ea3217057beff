"""The damped stop of every family of drives, played by its emulator: the velocity is read from its replies, and the
limit holds.
"""

import math

import numpy as np
import pytest

from blocks.actuators import CubeMars, CubeMarsServo, CubeMarsV3, RobStride, RobStrideMIT
from blocks.limiters import TorqueLimiter
from graph import Block, Diagram, Input, Output, compile
from tests.cext.rigs import Rig
from tests.cext.safety.test_damped_stop import Trip

DRIVES = {
    "CubeMars": (CubeMars, "AK80-9", {}),
    "CubeMars behind a gear": (CubeMars, "AK80-9", {"gear_ratio": 2.0, "invert": True}),
    "V3.0": (CubeMarsV3, "AK80-9-V3.0", {}),
    "V3.0 inverted": (CubeMarsV3, "AK80-9-V3.0", {"invert": True, "gear_ratio": 1.5}),
    "RobStride": (RobStride, "RS02", {}),
    "RobStride behind a gear": (RobStride, "RS02", {"gear_ratio": 2.0, "invert": True}),
    "RobStride that reports": (RobStride, "RS02", {"active_reporting": True}),
    "RobStride in MIT": (RobStrideMIT, "RS02", {}),
    "CyberGear": (RobStride, "CyberGear", {}),
}
LIMIT, PEAK = 4.0, 8.0  # N·m; rad/s


class Moved(Block):
    """A joint whose motion is imposed."""

    position = Output("rad")
    velocity = Output("rad/s")

    def step(self, t):
        return -math.cos(20.0 * t) * PEAK / 20.0, PEAK * math.sin(20.0 * t)


class Witness(Block):
    torque = Input("N·m")
    velocity = Input("rad/s")
    y = Output("1")

    def __init__(self, **options):
        self.seen = []
        super().__init__(**options)

    def step(self, torque, velocity):
        self.seen.append((torque, velocity))
        return 0.0


def seen_in_the_stop(robot):
    """Rows (torque, velocity) of every substep of a run whose knee moves by itself, and which an exception ends."""
    with Diagram("plant", rate=4000) as plant:
        drive = robot["knee"].emulator(name="drive")
        moved, witness = Moved(name="moved"), Witness(name="witness")
        drive(position=moved.position, velocity=moved.velocity)
        witness(torque=drive.torque, velocity=moved.velocity)
    assert Rig(robot, plant).run(10, fade=0.0).status == "exception"
    return np.array(witness.seen)


@pytest.mark.parametrize("name", DRIVES)
def test_every_family_is_damped_by_its_speed_and_inside_its_limit(name):
    kind, model, parameters = DRIVES[name]
    with Diagram("robot", rate=200) as robot:
        knee = kind(model, can_id=5, name="knee", limit=LIMIT, safe_stop="damp", stop_damping=4.0, **parameters)
        knee(torque_command=TorqueLimiter(limit=1.0)(Trip(name="trip")(knee.position)))
    torque, velocity = seen_in_the_stop(robot).T
    code = 2.0 * knee.wire[4] / (0xFFFF if kind is RobStride else 0xFFF)
    assert np.abs(torque).max() <= LIMIT + code
    # which is what damping for the wire's top speed gives
    assert np.abs(torque).max() > 1.5 * LIMIT * PEAK / knee.wire[1]
    assert (torque * velocity <= code * PEAK).all()


def test_a_rarely_reported_velocity_ages_until_the_next_report():
    """50 reports a second: between them the speed may have changed by 10 rad/s."""
    with Diagram("robot", rate=50) as robot:
        knee = CubeMarsV3("AK80-9-V3.0", name="knee", limit=LIMIT, safe_stop="damp", report_rate=50.0)
        knee(torque_command=TorqueLimiter(limit=1.0)(Trip(name="trip")(knee.position)))
    assert np.abs(seen_in_the_stop(robot)[:, 0]).max() <= LIMIT + 2.0 * knee.wire[4] / 0xFFF


def test_a_braking_current_is_the_same_at_every_speed():
    with Diagram("robot", rate=200) as robot:
        CubeMarsServo("AK80-9", name="knee", safe_stop="brake", stop_current=2.0)(current_command=0.0)
    [device] = compile(robot).devices
    [(speed, [frame])] = device.damp.bands
    assert speed == math.inf and frame == (2 << 8 | 1, True, (2000).to_bytes(4, "big")) and device.damp.velocity is None
    assert device.damp.limit == pytest.approx(2.0 * robot["knee"].scales[2])


def test_a_drive_that_is_disabled_at_once_has_no_damped_stop():
    with Diagram("robot", rate=200) as robot:
        CubeMars("AK80-9", name="knee")(torque_command=0.0)
    assert compile(robot).devices[0].damp is None
