"""The damped stop stays inside the limit at every speed: from the loop and from the watchdog, judged from the bytes on
the bus.
"""

import math
import signal
import time

import numpy as np
import pytest

from blocks.actuators import CubeMars, EmulatedCubeMars
from blocks.limiters import TorqueLimiter
from blocks.models import Limb
from cext.memory.shared_state import SharedState
from graph import Block, Diagram, Input, Output
from tests.blocks.actuators import reference
from tests.cext.rigs import STOP, Rig
from tests.played_drive import PlayedDrive, never_gains

AK80_9 = reference.ranges(velocity=50.0, torque=18.0)
LIMIT, CODE = 5.0, 36.0 / 4095  # N·m
STOP_TIME = 1.0  # s


class Trip(Block):
    """No torque, and an exception at tick 2."""

    u = Input("any")
    y = Output("N·m")

    def step(self, u, tick):
        if tick == 2:
            raise RuntimeError("tripped")
        return 0.0


class Thrown(Limb):
    """A limb that moves at the start."""

    speed = 8.0

    def configure(self):
        self.state = (self.start, self.speed)


class Imposed(Block):
    """A joint that is moved: velocity by time."""

    position = Output("rad")
    velocity = Output("rad/s")

    def __init__(self, motion, **options):
        self.motion = motion
        super().__init__(**options)

    def step(self, t):
        return 0.0, self.motion(t)


class Witness(Block):
    """Keeps the velocity of every substep."""

    velocity = Input("rad/s")
    y = Output("rad/s")

    def __init__(self, **options):
        self.seen = []
        super().__init__(**options)

    def step(self, velocity):
        self.seen.append(velocity)
        return velocity


def stopped(joint, rate=200, substeps=20, silent=False, **parameters):
    """A run that ends in a damped stop. Returns (torque, velocity) of the joint in every substep, judged from the
    bytes.

    joint : called in the plant with the emulated drive, gives its position and velocity
    """
    with Diagram("robot", rate=rate) as robot:
        knee = CubeMars(
            "AK80-9",
            can_id=1,
            name="knee",
            **{"limit": LIMIT, "safe_stop": "damp", "stop_damping": 1.0, "stop_time": STOP_TIME} | parameters,
        )
        knee(torque_command=TorqueLimiter(limit=0.4)(Trip(name="trip")(knee.position)))
    with Diagram("plant", rate=rate * substeps) as plant:
        drive = EmulatedCubeMars.of(robot["knee"], name="drive")
        position, velocity = joint(drive)
        witness = Witness(name="witness")
        witness(velocity)
        drive(position=position, velocity=velocity, silent=Late(name="late")() if silent else False)
    rig = Rig(robot, plant)
    assert rig.run(10, fade=0.0).status == "exception"
    step, ratio = round(1e9 / (rate * substeps)), robot["knee"].gear_ratio
    sent = [frame for frame in rig.frames if frame.sent and frame.id == 1]
    torque, law, place = [], None, 0
    for index, speed in enumerate(witness.seen):
        while place < len(sent) and sent[place].time <= index * step:
            law = None if sent[place].data == STOP[1] else reference.read_command(AK80_9, sent[place].data)
            place += 1
        torque.append(
            0.0 if law is None else ratio * (law["damping"] * (law["velocity"] - ratio * speed) + law["torque"])
        )
        assert law is None or law["stiffness"] == 0.0
    assert sent[-1].data == STOP[1]
    return np.array(torque), np.array(witness.seen)


class Late(Block):
    """True from tick 0 of the run on: the drive answers arming, and then no more."""

    y = Output("1", dtype=bool)

    def step(self, t):
        return t > 0.02


def free(drive):
    limb = Thrown(inertia=0.35, damping=0.0, stiffness=0.0, reflex=0.0, name="limb")
    limb(torque=drive.torque)
    return limb.position, limb.velocity


def moved(motion):
    def joint(drive):
        imposed = Imposed(motion, name="imposed")
        return imposed.position, imposed.velocity

    return joint


def test_a_limb_at_8_rad_per_s_is_damped_within_5_newton_metres():
    torque, velocity = stopped(free)
    assert np.abs(velocity[0]) == pytest.approx(8.0)
    assert np.abs(torque).max() <= LIMIT + CODE
    assert never_gains([(0, speed, 0.0) for speed in velocity])
    assert abs(velocity[-1]) < 1.0
    half = np.flatnonzero(velocity <= 4.0)[0] / 4000
    assert half < 0.55  # s; the clipped ideal takes 0.288


@pytest.mark.hazard("H10a")
@pytest.mark.parametrize("rate", [100, 200, 1000])
@pytest.mark.parametrize("frequency, peak", [(0.5, 45.0), (2.0, 30.0), (5.0, 15.9), (20.0, 3.9)])
def test_motion_within_max_acceleration_meets_at_most_the_limit(rate, frequency, peak):
    motion = lambda t: peak * math.sin(2.0 * math.pi * frequency * t + 0.7)  # noqa: E731
    torque, velocity = stopped(moved(motion), rate=rate, substeps=4000 // rate)
    assert np.abs(torque).max() <= LIMIT + CODE and (torque * velocity <= 0.05).all()


@pytest.mark.hazard("H10a")
def test_a_silent_drive_is_damped_within_the_limit_at_every_speed():
    torque, velocity = stopped(moved(lambda t: 50.0 * math.sin(9.0 * t)), silent=True)
    assert np.abs(torque).max() <= LIMIT + CODE
    torque, velocity = stopped(free, silent=True)
    assert 0.0 < np.abs(torque).max() <= LIMIT + CODE and never_gains([(0, speed, 0.0) for speed in velocity])


@pytest.mark.parametrize(
    "parameters",
    [
        {"gear_ratio": 2.0},
        {"invert": True, "offset": 0.3},
        {"limit": 0.5},
        {"stop_damping": 5.0},
        {"limit": 9.0, "stop_damping": 0.1},
    ],
)
def test_the_limit_holds_for_every_mounting_and_every_damping(parameters):
    limit, ratio = parameters.get("limit", LIMIT), parameters.get("gear_ratio", 1.0)
    torque, _ = stopped(moved(lambda t: 24.0 / ratio * math.sin(15.0 * t)), **parameters)
    assert np.abs(torque).max() <= limit + CODE * ratio


class Playing(Block):
    """Hangs once, at tick 20 or the next that is not missed, with a drive that it plays itself, in real time."""

    u = Input("any")
    y = Output("N·m")

    def __init__(self, **options):
        self.bus = self.drive = None
        self.played = False
        super().__init__(**options)

    def step(self, u, tick):
        if tick >= 20 and not self.played:
            self.played = True
            self.play(0.3)
        return 0.0

    def play(self, seconds):
        before = signal.signal(signal.SIGURG, signal.SIG_IGN)
        began = self.drive.now = time.monotonic_ns()
        while (now := time.monotonic_ns()) < began + seconds * 1e9:
            for _, _, data, _ in self.bus.receive():
                self.bus.send(1, self.drive.hear(data, now), time=now - self.zero())
            self.drive.advance(now)
            time.sleep(0.0002)
        signal.signal(signal.SIGURG, before)


def test_a_drive_under_a_tick_that_hangs_is_damped_inside_the_limit_by_the_watchdog():
    with Diagram("robot", rate=200) as robot:
        knee = CubeMars(
            "AK80-9", can_id=1, name="knee", limit=LIMIT, safe_stop="damp", stop_damping=1.0, stop_time=0.2, timeout=0.0
        )
        law = Playing(name="law")
        knee(torque_command=TorqueLimiter(limit=1.0)(law(knee.position)))
    with Diagram("plant", rate=200) as plant:
        drive = EmulatedCubeMars.of(robot["knee"], name="drive")
        drive(position=0.0, velocity=0.0)
    shared = SharedState(1 << 20)
    shared.look_after(time.monotonic_ns())
    rig = Rig(robot, plant, virtual=False, shared=shared, guard=60.0)
    law.bus, law.zero, law.drive = rig.buses["can"].device, lambda: rig.shared.began, PlayedDrive(AK80_9)
    assert rig.run(100, fade=0.0).status == "hung"
    played = law.drive
    assert played.worst() <= LIMIT + CODE and never_gains(played.log)
    damped = [torque for _, velocity, torque in played.log if abs(torque) > 0.6 * LIMIT]
    # 50 ms of more than B = limit / top speed would give
    assert len(damped) > 1000, "the watchdog does not read the velocity"
    assert abs(played.log[-1][1]) < 7.0
