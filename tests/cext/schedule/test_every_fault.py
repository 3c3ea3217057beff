"""Whatever ends a run, and on whichever of its buses, both drives on both buses receive zero torque, then
disable, within two ticks.

In virtual time, on in-memory buses. The same with processes over real sockets:
tests/runtime/robot/guardian/test_every_fault.py.
"""

import ctypes
import math
import signal
import sys
import time
from dataclasses import dataclass, field

import pytest

from blocks.actuators import CubeMars, EmulatedCubeMars
from blocks.actuators.mit_frames import DISABLE, ENABLE, NOTHING
from blocks.filters import Butterworth
from blocks.limiters import RMSTorqueLimiter, SlewRate, TorqueLimiter
from blocks.mathematics import Gain
from blocks.safety import EmergencyStop, EmulatedEStop, EStopHeartbeat
from cext.kernels import mathematics as kernels
from cext.memory.shared_state import SharedState
from cext.schedule.mailbox_writer import Writer
from graph import Block, Diagram, Input, Kernel, Output
from tests.cext.rigs import STOP, Rig

RATE, SUBSTEPS = 200, 5
PERIOD = 1e9 / RATE  # ns
AT = 40  # the tick in which it goes wrong
BUSES = {"left": 1, "right": 2}  # id of the one drive of each


class Law(Block):
    """2 N·m; from some tick on what `action` gives."""

    torque = Output("N·m")

    def __init__(self, action, **options):
        self.action = action
        super().__init__(**options)

    def step(self, tick):
        return self.action() if tick >= AT else 2.0


class From(Block):
    """One number, and from some tick on another."""

    y = Output("1")

    def __init__(self, before, after, tick=AT, **options):
        self.before, self.after, self.when = before, after, tick
        super().__init__(**options)

    def step(self, tick):
        return self.before if tick < self.when else self.after


class Truth(From):
    y = Output("1", dtype=bool)


class Celsius(From):
    y = Output("°C")


class Radians(From):
    y = Output("rad")


class Sliding(Radians):
    """By 0.01 rad in each tick of the robot."""

    def step(self, tick):
        return min(self.after, self.before + 0.01 * max(tick - self.when, 0) / SUBSTEPS)


class Speed(From):
    y = Output("rad/s")


class Shaken(Speed):
    """To and fro, every second tick of the robot."""

    def step(self, tick):
        return self.before if tick < self.when else self.after * (-1) ** (tick // (2 * SUBSTEPS))


class Outage(Truth):
    def step(self, tick):
        return self.after if self.when <= tick < self.when + RATE // 20 * SUBSTEPS else self.before


class Code(From):
    y = Output("1", dtype=int)


class Thief(Block):
    """In the plant: takes away what a drive has answered, from some tick of the plant on."""

    taken = Output("1")

    def step(self, tick):
        return len(self.host.receive()) if tick >= AT * SUBSTEPS else 0.0


class Wall(Block):
    """In the plant: fails."""

    y = Output("1")

    def step(self, tick):
        if tick >= (AT + 1) * SUBSTEPS:
            raise ValueError("the wall is gone")
        return 0.0


class Liar(Block):
    """Declares an output range of one newton metre."""

    gain = Gain.parameters["gain"]
    u = Input("any")
    y = Output("any", range=(-1.0, 1.0))
    kernel = kernels.gain


@ctypes.CFUNCTYPE(ctypes.c_int, ctypes.POINTER(ctypes.c_double), ctypes.c_void_p, ctypes.c_void_p)
def own_status(arena, slots, sizes):
    return 77 if arena[1] >= AT else 0


class Own(Block):
    """A native kernel with a fault of its own."""

    kernel = Kernel(own_status, "")


def raises(error):
    def action():
        raise error

    return action


@dataclass
class Fault:
    """How a fault is injected, and the expected outcome of the run.

    status, culprit, unconfirmed : of the Outcome
    late : ticks after AT at which it can be detected at the latest
    law : of the left drive, called from AT on; between : block between law and drive, a limiter; parameters : of
        the left drive
    left : {input of the left drive's emulator: (block class, before, after)}; emulated : its parameters; wired : more
        inputs of the left drive
    more, plant : make blocks in the robot, in the plant; act : called with the Rig, at AT; guard : whether a guardian
        is looked for
    commanded : whether the torque of the newest tick has gone out; ticks : most that are run
    """

    status: str
    culprit: str | None
    late: int = 0
    law: object = lambda: 2.0
    between: object = None
    parameters: dict = field(default_factory=dict)
    left: dict = field(default_factory=dict)
    emulated: dict = field(default_factory=dict)
    wired: dict = field(default_factory=dict)
    more: object = None
    plant: object = None
    act: object = None
    guard: bool = False
    commanded: bool = False
    unconfirmed: tuple = ()
    ticks: int = 400


def limited(signal):
    return TorqueLimiter(limit=5.0, name="limiter")(signal)


def command_by_somebody_else(data):
    return lambda rig: rig.buses["left"].device.send(1, data)


LIMITERS = {
    "a torque limiter": limited,
    "a limiter with slew": lambda u: TorqueLimiter(limit=5.0, slew=50.0)(u),
    "a slew rate": lambda u: limited(SlewRate(100.0)(u)),
    "an RMS limiter": lambda u: limited(RMSTorqueLimiter(limit=4.0, window=0.5, fade=0.1)(u)),
    "a filter": lambda u: limited(Butterworth(cutoff=20.0)(u)),
}

FAULTS = {
    "an exception in a block": Fault("exception", "law", law=raises(ValueError("torn"))),
    "sys.exit in a block": Fault("exception", "law", law=lambda: sys.exit("enough")),
    "a KeyboardInterrupt in a block": Fault("exception", "law", law=raises(KeyboardInterrupt())),
    "more exceptions than are held": Fault(
        "exception", "law", 3, law=raises(ValueError("torn")), parameters={"hold": 3}
    ),
    "a status of a native kernel's own": Fault("kernel status 77", "own", more=lambda: Own(name="own")),
    "NaN": Fault("not finite", "left", law=lambda: math.nan, between=lambda u: Liar(1.0)(u)),
    "infinity": Fault("not finite", "left", law=lambda: math.inf, between=lambda u: Liar(1.0)(u)),
    "minus infinity": Fault("not finite", "left", law=lambda: -math.inf, between=lambda u: Liar(1.0)(u)),
    **{
        f"NaN through {name}": Fault("not finite", "left", law=lambda: math.nan, between=between)
        for name, between in LIMITERS.items()
    },
    "infinity through a filter": Fault("not finite", "left", 2, law=lambda: math.inf, between=LIMITERS["a filter"]),
    "a command past its limit": Fault("out of limits", "left", law=lambda: 30.0, between=lambda u: Liar(1.0)(u)),
    "a silent drive": Fault(
        "silent", "left", 12, unconfirmed=("left",), parameters={"timeout": 0.05}, plant=lambda: Thief(name="thief")
    ),
    "a fault bit": Fault("device fault", "left", 2, left={"fault": (Code, 0, 5)}),
    "a drive that is too hot": Fault("too hot", "left", 2, left={"temperature": (Celsius, 30.0, 101.0)}),
    "a temperature that cannot be": Fault("implausible", "left", 2, left={"temperature": (Celsius, 30.0, -100.0)}),
    "a joint outside its range": Fault(
        "over-travel", "left", 2, left={"position": (Radians, 0.545, 0.556)}, parameters={"range": (0.0, 0.5)}
    ),
    "an angle that jumps": Fault("position jump", "left", 2, left={"position": (Radians, 0.1, 0.8)}),
    "a joint that is too fast": Fault(
        "overspeed", "left", 4, left={"velocity": (Speed, 0.0, 6.0)}, parameters={"max_velocity": 5.0}
    ),
    "a drive that is without power for 50 ms": Fault(
        "not following", "left", 45, left={"power_lost": (Outage, False, True)}
    ),
    "torque beyond the limit": Fault(
        "excess torque",
        "left",
        18,
        left={"position": (Sliding, 0.1, 0.5)},
        wired={"position_command": 0.1, "stiffness_command": 20.0},
        emulated={"wire_stiffness": 5000.0},
    ),
    "acceleration that goes on": Fault(
        "acceleration", "left", 15, left={"velocity": (Shaken, 0.0, 4.0)}, wired={"damping_command": 0.2}
    ),
    "a velocity with another scale": Fault("scale mismatch", "left", 205, left={"velocity": (Speed, 0.0, 1.0)}),
    "RMS torque that shall end the run": Fault(
        "rms torque",
        "left",
        250,
        law=lambda: 17.0,
        between=lambda u: TorqueLimiter(limit=18.0)(u),
        parameters={"rms_mode": "disable", "rms_window": 1.0, "limit": "peak"},
    ),
    "an emergency stop": Fault(
        "e-stop", "stop", more=lambda: EmergencyStop(name="stop")(Truth(False, True, name="hand").y)
    ),
    "a button that is pressed": Fault(
        "e-stop",
        "button",
        6,
        more=lambda: EStopHeartbeat(bus="left", name="button"),
        left={"pressed": (Truth, False, True)},
    ),
    "a button that is older than its timeout": Fault(
        "silent",
        "button",
        26,
        more=lambda: EStopHeartbeat(bus="left", name="button", timeout=0.1),
        left={"silent": (Truth, False, True)},
    ),
    "an exception in the plant": Fault(
        "exception", "wall", 1, commanded=True, unconfirmed=("left", "right"), plant=lambda: Wall(name="wall")
    ),
    "a fence": Fault("fenced", None, act=lambda rig: rig.shared.raise_fence()),
    "a guardian that is gone": Fault("unguarded", None, 1, act=lambda rig: rig.shared.look_after(0), guard=True),
    "somebody else who enables": Fault("foreign command", "left", 1, act=command_by_somebody_else(ENABLE), guard=True),
    "somebody else who commands": Fault(
        "foreign command", "left", 1, act=command_by_somebody_else(NOTHING), guard=True
    ),
    "the space bar": Fault("ok", None, 1, act=lambda rig: Writer(rig.shared, "keys").stop()),
    "SIGINT": Fault("ok", None, 1, act=lambda rig: signal.raise_signal(signal.SIGINT), commanded=True),
    "SIGTERM": Fault("ok", None, 1, act=lambda rig: signal.raise_signal(signal.SIGTERM), commanded=True),
    "SIGHUP": Fault("ok", None, 1, act=lambda rig: signal.raise_signal(signal.SIGHUP), commanded=True),
    "the end": Fault("ok", None, commanded=True, ticks=AT + 1),
}


class Acts(Block):
    """Calls something with the rig, once."""

    y = Output("N·m", range=(0.0, 2.0))
    rig = None

    def __init__(self, action, **options):
        self.action = action
        super().__init__(**options)

    def step(self, tick):
        if tick == AT:
            self.action(self.rig)
        return 2.0


def build(fault):
    """A Rig of two drives on two buses, of which the left one has the fault."""
    parameters = dict(fault.parameters)
    hold = parameters.pop("hold", 0)
    with Diagram("robot", rate=RATE) as robot:
        law = Law(fault.law, name="law", hold_exceptions=hold).torque
        CubeMars("AK80-9", bus="left", can_id=1, name="left", **parameters)(
            torque_command=(fault.between or limited)(law), **fault.wired
        )
        CubeMars("AK80-9", bus="right", can_id=2, name="right")(torque_command=1.0)
        if fault.more is not None:
            fault.more()
        acts = Acts(fault.act, name="acts") if fault.act is not None else None
    with Diagram("plant", rate=SUBSTEPS * RATE) as plant:
        signals = {
            name: kind(before, after, AT * SUBSTEPS, name=name).y for name, (kind, before, after) in fault.left.items()
        }
        drive = {
            name: signals[name] for name in signals if name in EmulatedCubeMars.inputs and "button" not in robot.blocks
        }
        EmulatedCubeMars.of(robot["left"], name="left_drive", **fault.emulated)(
            **{"position": 0.1, "velocity": 0.0} | drive
        )
        EmulatedCubeMars.of(robot["right"], name="right_drive")(position=0.1, velocity=0.0)
        if "button" in robot.blocks:
            EmulatedEStop.of(robot["button"], name="emulated")(
                **{name: signals[name] for name in signals if name not in drive}
            )
        thief = fault.plant() if fault.plant is not None else None
    shared = SharedState(1 << 21)
    shared.look_after(time.monotonic_ns())
    rig = Rig(robot, plant, shared=shared, guard=30.0 if fault.guard else 0.0)
    if acts is not None:
        acts.rig = rig
    if thief is not None:
        thief.host = rig.buses["left"].host
    return rig


@pytest.mark.hazard("H6d")
@pytest.mark.parametrize("what", FAULTS)
def test_every_drive_on_every_bus_receives_only_stop_within_two_ticks(what):
    fault = FAULTS[what]
    rig = build(fault)
    outcome = rig.run(fault.ticks, fade=0.0)
    assert (outcome.status, outcome.culprit) == (fault.status, fault.culprit) and AT <= outcome.tick <= AT + fault.late
    detected = rig.shared.first_tick + outcome.tick * PERIOD
    number = {name: index for index, name in enumerate(rig.schedule.buses)}
    first = min(place for place, frame in enumerate(rig.frames) if frame.sent and frame.data == DISABLE)
    behind = [frame for frame in rig.frames[first - 1 :] if frame.sent]
    assert {frame.data for frame in behind} == set(STOP), (
        "only zero torque and disable, on any bus, from the first of them on"
    )
    for bus, can_id in BUSES.items():
        sent = [frame for frame in rig.frames if frame.sent and frame.bus == number[bus] and frame.id == can_id]
        place = next(place for place, frame in enumerate(sent) if frame.data == DISABLE)
        assert [frame.data for frame in sent[place - 1 : place + 1]] == STOP
        assert 0 <= sent[place - 1].time - detected <= sent[place].time - detected <= 2 * PERIOD
        torques = [frame for frame in sent if frame.data not in (ENABLE, NOTHING, DISABLE)]
        ticks = {frame.time for frame in torques}  # a command is repeated in its tick where replies are missing
        assert len(ticks) == outcome.tick + fault.commanded, "none of a tick that failed"
        assert rig.shared.fenced and rig.shared.state == "safe"
    assert outcome.unconfirmed == fault.unconfirmed


def test_exceptions_beyond_held_limit_are_reported_with_earlier_commands():
    rig = build(FAULTS["more exceptions than are held"])
    outcome = rig.run(100, fade=0.0)
    assert outcome.tick == AT + 3 and str(outcome.error) == "torn"
    assert rig["left.torque_sent"][AT:].tolist() == [rig["left.torque_sent"][AT - 1]] * 3
