"""The readings of one IMU: in a simulation, whose plant turns it, or over the real bus, where a person does. Nothing
else is armed.
"""

import math
from contextlib import ExitStack

import numpy as np

from blocks.recorders import CsvRecorder
from cext.safety.shared_state import RECORD_ROW, SharedState
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Device, Diagram, subsystem
from runtime.base.ending import uninterrupted
from runtime.base.errors import BadInput
from runtime.diagrams.file import compiled
from runtime.diagrams.simulation import Simulation
from runtime.recording.format import row_struct
from runtime.rig.buses import RigBuses

PORTS = ("accel", "gyro", "mag")
LONGEST = 1200.0  # s
PAUSE = 0.05  # s between two readings, about: each arms anew
FRAME_BYTES = 96  # of a frame in the page, and what is around it

FAILURES = {"no answer": "it does not answer", "silent": "it has fallen silent"}


class Readings:
    """time : (n,) s; accel, gyro, mag : (n, 3) m/s², rad/s, µT, each measurement of the magnetometer once"""

    def __init__(self, time, accel, gyro, mag):
        self.time, self.accel, self.gyro = time, accel, gyro
        fresh = (
            np.any(np.diff(mag, axis=0, prepend=np.nan) != 0.0, axis=1) & np.any(mag != 0.0, axis=1) if len(mag) else []
        )
        self.mag = mag[fresh]

    def plus(self, later):
        start = self.time[-1] + PAUSE if len(self.time) else 0.0
        joined = Readings(
            np.concatenate([self.time, start + later.time]),
            np.concatenate([self.accel, later.accel]),
            np.concatenate([self.gyro, later.gyro]),
            np.zeros((0, 3)),
        )
        joined.mag = np.concatenate([self.mag, later.mag])
        return joined


NOTHING = Readings(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3)))


def sensor_of(diagram, path=None):
    """The block that can be calibrated. BadInput where there is none, or several and no name."""
    there = {block.path: block for block in diagram if isinstance(block, Device) and "calibration" in block.parameters}
    if path is None and len(there) == 1:
        return next(iter(there.values()))
    listed = ", ".join(there) or "none"
    if path is None:
        raise BadInput(
            f"{diagram.name} has {listed} that can be calibrated; name one"
            if there
            else f"{diagram.name} has no sensor that can be calibrated: one whose block has the parameter `calibration`"
        )
    if path not in there:
        raise BadInput(f"{path} is no sensor that can be calibrated; there is {listed}")
    return there[path]


def simulated(file, diagram, sensor, seconds):
    """Readings of a whole simulation in virtual time; its plant turns the sensor. file : DiagramFile"""
    recorder = record(diagram, sensor)
    schedule = compiled(file.path, diagram)
    simulation = Simulation(file, diagram, schedule)
    control = Program(schedule, simulation.ends())
    return read(
        schedule, recorder, control, seconds, plant=simulation.program, substeps=simulation.substeps, virtual=True
    )


class OnRig:
    """One sensor on its rig, asked as in a run. rig : RigFile, whose values the sensor has already. RigError

    `with OnRig(...) as there: there.read(seconds)` as often as wanted.
    """

    def __init__(self, rig, sensor):
        parameters = {name: getattr(sensor, name) for name in sensor.parameters}
        with (
            Diagram("calibration", rate=max(sensor.rate, 1.0) if hasattr(sensor, "rate") else 200.0) as diagram,
            ExitStack() as inside,
        ):
            *rooms, name = sensor.path.split("/")
            for room in rooms:
                inside.enter_context(subsystem(room))
            self.sensor = type(sensor)(**parameters, name=name)
        self.recorder = record(diagram, self.sensor)
        self.schedule = compiled(rig.path, diagram)
        self.buses = RigBuses(rig, diagram, self.schedule.buses)
        self.control = Program(self.schedule, self.buses.ends())

    def __enter__(self):
        self.buses.start_sensors(0)
        return self

    def __exit__(self, *exception):
        self.buses.close()

    def read(self, seconds):
        return read(self.schedule, self.recorder, self.control, seconds)


def record(diagram, sensor):
    """A recorder of its three vectors; that is all that is kept."""
    with diagram:
        recorder = CsvRecorder(name="calibration_of_one_sensor")
        recorder(*(getattr(sensor, name) for name in PORTS))
    return recorder


def read(schedule, recorder, control, seconds, **how):
    """Readings of so many seconds. BadInput where the sensor does not answer, or falls silent."""
    if not 0.0 < seconds <= LONGEST:
        raise BadInput(f"{seconds:g} s: more than 0, and at most {LONGEST:g}")
    ticks = math.ceil(seconds * schedule.rate)
    row = row_struct(len(schedule.columns))
    frames = FRAME_BYTES * 8 * len(schedule.devices)
    page = SharedState(max(1 << 20, (row.size + 16 + frames) * (ticks + 1000)))
    try:
        outcome = uninterrupted(Executor(control, schedule.rate, page=page, **how).run(ticks))
        records = [row.unpack(payload) for kind, payload in page.drain(1 << 30) if kind == RECORD_ROW]
    finally:
        page.close()
    if outcome.faulted:
        who = outcome.culprit or ", ".join(outcome.unanswered) or schedule.name
        raise BadInput(f"{who}: {outcome.error or FAILURES.get(outcome.status, outcome.status)}")
    rows = np.array(records).reshape(-1, 2 + len(schedule.columns))
    columns = next(sink.columns for sink in schedule.sinks if sink.block is recorder)
    values = rows[:, [2 + column.index for column in columns]]
    return Readings(rows[:, 0] / schedule.rate, values[:, 0:3], values[:, 3:6], values[:, 6:9])
