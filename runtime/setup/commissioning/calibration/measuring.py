"""Readings of one IMU, from a simulation whose plant turns it or from the real bus, where the operator does.

No other device is armed.
"""

from __future__ import annotations

import math
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

import numpy as np

from blocks.recorders import CsvRecorder
from cext.memory.shared_state import RECORD_ROW, SharedState
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Device, Diagram, subsystem
from runtime.host.ending import raise_if_ended_by_signal
from runtime.host.errors import BadInput
from runtime.record.storage.format import row_struct
from runtime.robot.loading.file import compile_diagram
from runtime.robot.loading.simulation import Simulation
from runtime.robot.rig.buses import RigBuses

if TYPE_CHECKING:
    from graph import Schedule
    from graph.block import Sink
    from runtime.robot.loading.diagram_file import DiagramFile
    from runtime.robot.rig.file import RigFile

PORTS = ("accel", "gyro", "mag")
DURATION_LIMIT = 1200.0  # s
READING_GAP = 0.05  # s between two readings, approximately: each arms the sensor again
FRAME_BYTES = 96  # bytes of a frame with its overhead in the shared ring

FAILURES = {"no answer": "no response from the sensor", "silent": "the sensor stopped responding"}


class Readings:
    """Samples of an IMU.

    time : (n,) s
    accel, gyro : (n, 3) m/s² and rad/s
    mag : (m, 3) µT, each measurement of the magnetometer once
    """

    def __init__(self, time: np.ndarray, accel: np.ndarray, gyro: np.ndarray, mag: np.ndarray) -> None:
        self.time, self.accel, self.gyro = time, accel, gyro
        fresh = (
            np.any(np.diff(mag, axis=0, prepend=np.nan) != 0.0, axis=1) & np.any(mag != 0.0, axis=1) if len(mag) else []
        )
        self.mag = mag[fresh]

    def plus(self, later: Readings) -> Readings:
        """Return these readings followed by later ones, with READING_GAP s between them."""
        start = self.time[-1] + READING_GAP if len(self.time) else 0.0
        joined = Readings(
            np.concatenate([self.time, start + later.time]),
            np.concatenate([self.accel, later.accel]),
            np.concatenate([self.gyro, later.gyro]),
            np.zeros((0, 3)),
        )
        joined.mag = np.concatenate([self.mag, later.mag])
        return joined


NOTHING = Readings(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3)))


def sensor_of(diagram: Diagram, path: str | None = None) -> Device:
    """Return the sensor block to calibrate. Raises BadInput if there is none, or several without a path."""
    sensors = {
        block.path: block for block in diagram if isinstance(block, Device) and "calibration" in block.parameters
    }
    if path is None and len(sensors) == 1:
        return next(iter(sensors.values()))
    listed = ", ".join(sensors) or "none"
    if path is None:
        raise BadInput(
            f"{diagram.name} has several sensors that can be calibrated: {listed}. Name one"
            if sensors
            else f"{diagram.name} has no sensor that can be calibrated (a block with the parameter `calibration`)"
        )
    if path not in sensors:
        raise BadInput(f"{path} is not a sensor that can be calibrated; available: {listed}")
    return sensors[path]


def simulate_readings(file: DiagramFile, diagram: Diagram, sensor: Device, seconds: float) -> Readings:
    """Return the Readings of a simulation in virtual time, whose plant turns the sensor. file : DiagramFile"""
    recorder = record(diagram, sensor)
    schedule = compile_diagram(file.path, diagram)
    simulation = Simulation(file, diagram, schedule)
    control = Program(schedule, simulation.ends())
    return read(
        schedule, recorder, control, seconds, plant=simulation.program, substeps=simulation.substeps, virtual=True
    )


class OnRig:
    """Context manager that reads one sensor on its rig as in a run.

    rig : RigFile; its values are already applied to the sensor

    Raises RigError if the rig cannot be opened. Call `read` any number of times inside the `with` block.
    """

    def __init__(self, rig: RigFile, sensor: Any) -> None:
        parameters = {name: getattr(sensor, name) for name in sensor.parameters}
        with (
            Diagram("calibration", rate=max(sensor.rate, 1.0) if hasattr(sensor, "rate") else 200.0) as diagram,
            ExitStack() as inside,
        ):
            *subsystems, name = sensor.path.split("/")
            for each in subsystems:
                inside.enter_context(subsystem(each))
            self.sensor = type(sensor)(**parameters, name=name)
        self.recorder = record(diagram, self.sensor)
        self.schedule = compile_diagram(rig.path, diagram)
        self.buses = RigBuses(rig, diagram, self.schedule.buses)
        self.control = Program(self.schedule, self.buses.ends())

    def __enter__(self):
        self.buses.start_sensors(0)
        return self

    def __exit__(self, *exception):
        self.buses.close()

    def read(self, seconds: float) -> Readings:
        """Return the Readings of the next `seconds`. Raises BadInput if the sensor does not respond."""
        return read(self.schedule, self.recorder, self.control, seconds)


def record(diagram: Diagram, sensor: Device) -> Sink:
    """Add a recorder of the sensor's three vectors to the diagram. Returns it."""
    with diagram:
        recorder = CsvRecorder(name="calibration_of_one_sensor")
        recorder(*(getattr(sensor, name) for name in PORTS))
    return recorder


def read(schedule: Schedule, recorder: Sink, control: Program, seconds: float, **how: Any) -> Readings:
    """Return the Readings of `seconds`.

    recorder : as returned by `record`
    how : options of Executor

    Raises BadInput if the sensor does not respond or stops responding.
    """
    if not 0.0 < seconds <= DURATION_LIMIT:
        raise BadInput(f"duration {seconds:g} s is out of range: it must be above 0 and at most {DURATION_LIMIT:g} s")
    ticks = math.ceil(seconds * schedule.rate)
    row = row_struct(len(schedule.columns))
    frames = FRAME_BYTES * 8 * len(schedule.devices)
    shared = SharedState(max(1 << 20, (row.size + 16 + frames) * (ticks + 1000)))
    try:
        outcome = raise_if_ended_by_signal(Executor(control, schedule.rate, shared=shared, **how).run(ticks))
        records = [row.unpack(payload) for kind, payload in shared.drain(1 << 30) if kind == RECORD_ROW]
    finally:
        shared.close()
    if outcome.faulted:
        source = outcome.culprit or ", ".join(outcome.unanswered) or schedule.name
        raise BadInput(f"{source}: {outcome.error or FAILURES.get(outcome.status, outcome.status)}")
    rows = np.array(records).reshape(-1, 2 + len(schedule.columns))
    columns = next(sink.columns for sink in schedule.sinks if sink.block is recorder)
    values = rows[:, [2 + column.index for column in columns]]
    return Readings(rows[:, 0] / schedule.rate, values[:, 0:3], values[:, 3:6], values[:, 6:9])
