"""Robots on in-memory buses with emulated drives, and what a third party sees of their runs."""

import json
import struct
from contextlib import nullcontext
from typing import NamedTuple

import numpy as np

from blocks.actuators import CubeMars, EmulatedCubeMars
from blocks.actuators.mit_frames import DISABLE, ENABLE, NOTHING
from blocks.models import Limb
from blocks.recorders import CsvRecorder
from cext.bus.memory_bus import MemoryBus
from cext.memory.shared_state import RECORD_CHANGE, RECORD_EVENT, RECORD_FRAME, RECORD_ROW, SharedState
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Diagram, compile
from runtime.robot.emulation.priority import priority_of_loop

FRAME = struct.Struct("=qIBBBB64s")
CHANGE = struct.Struct("=q4i3d")
STOP = [NOTHING, DISABLE]


class Frame(NamedTuple):
    """A frame as the page has it: time in ns from the run's begin; `sent` by the robot, or received."""

    time: int
    id: int
    bus: int
    sent: bool
    data: bytes


class Change(NamedTuple):
    """What the mailbox has brought, as the page has it. kind : 0 a set, 1 a mark, 2 a stop; index : of the live
    parameter
    """

    tick: int
    kind: int
    origin: int
    writer: int
    index: int
    value: float
    before: float
    slew: float


class Rig:
    """A robot, its plant and the page between them.

    robot, plant : Diagrams
    shared : capacity of the ring in bytes, or a SharedState
    options : of the Executor
    """

    def __init__(self, robot, plant=None, *, shared=1 << 21, virtual=True, record=True, **options):
        if record and not any(isinstance(block, CsvRecorder) for block in robot):
            with robot:
                CsvRecorder()
        self.schedule = compile(robot)
        self.buses = {name: MemoryBus() for name in self.schedule.buses}
        self.control = Program(self.schedule, [bus.host for bus in self.buses.values()])
        self.sleeps = not virtual and options.get("spin", 0.0) == 0.0
        self.plant, substeps = None, 1
        if plant is not None:
            model = compile(plant)
            self.plant = Program(model, [self.buses[name].device for name in model.buses])
            substeps = round(plant.rate / robot.rate)
        self.shared = shared if isinstance(shared, SharedState) else SharedState(shared)
        self.executor = Executor(
            self.control,
            self.schedule.rate,
            plant=self.plant,
            substeps=substeps,
            shared=self.shared,
            virtual=virtual,
            **options,
        )

    def run(self, ticks, **options):
        """Run, and take what was recorded: rows by column, frames and events in their order. Returns the Outcome."""
        with priority_of_loop() if self.sleeps else nullcontext():  # no load of a computer delays a tick
            outcome = self.executor.run(ticks, **options)
        width = 2 + len(self.schedule.columns)
        rows, self.frames, self.changes, self.events = [], [], [], []
        for kind, record in self.shared.drain(1 << 30):
            if kind == RECORD_ROW:
                rows.append(struct.unpack(f"={width}d", record))
            elif kind == RECORD_FRAME:
                time, identifier, length, _, bus, sent, data = FRAME.unpack(record)
                assert sent in (0, 1)
                self.frames.append(Frame(time, identifier, bus, bool(sent), data[:length]))
            elif kind == RECORD_EVENT:
                self.events.append(json.loads(record))
            elif kind == RECORD_CHANGE:
                self.changes += map(Change._make, CHANGE.iter_unpack(record))
        rows = np.array(rows).reshape(-1, width)
        self.tick, self.time = rows[:, 0].astype(int), rows[:, 0] / self.schedule.rate
        self.signals = {
            column.path: rows[:, 2 + column.index] for sink in self.schedule.sinks for column in sink.columns
        }
        return outcome

    def __getitem__(self, path):
        return self.signals[path]

    def sent(self, can_id=1):
        """Data of every frame that was sent to one drive."""
        return [frame.data for frame in self.frames if frame.sent and frame.id == can_id]

    def commands(self, can_id=1):
        """The same between arming and the safe stop."""
        data = self.sent(can_id)
        while data[:2] == [ENABLE, NOTHING]:
            del data[:2]
        while data[-2:] == STOP:
            del data[-2:]
        return data

    def statistics(self):
        return self.shared.statistics()


def plant_of(robot, *, substeps=5, **parameters):
    """Every drive of a robot, emulated on a limb of its own. parameters : of the emulators."""
    with Diagram("plant", rate=substeps * robot.rate) as plant:
        for block in [block for block in robot if isinstance(block, CubeMars)]:
            name = block.path.replace("/", "_")
            drive = EmulatedCubeMars.of(block, name=name, **parameters)
            limb = Limb(inertia=0.1, damping=0.5, stiffness=0.0, reflex=0.0, name=f"{name}_limb")
            limb(torque=drive.torque)
            drive(position=limb.position, velocity=limb.velocity)
    return plant


def ends_in_the_safe_stop(rig, can_id=1):
    """Whether the last frames to a drive are zero torque, then disable, behind the fence."""
    return rig.sent(can_id)[-2:] == STOP and rig.shared.fenced and rig.shared.state == "safe"


def one_drive(law, *, rate=200, virtual=True, plant=True, options=None, **parameters):
    """A rig with one drive. law(drive) : the signal that commands its torque; options : of the Executor; parameters :
    of the drive
    """
    with Diagram("robot", rate=rate) as robot:
        drive = CubeMars("AK10-9-V2.0", can_id=1, name="knee", **parameters)
        drive(torque_command=law(drive))
    return Rig(robot, plant_of(robot) if plant else None, virtual=virtual, **(options or {}))
