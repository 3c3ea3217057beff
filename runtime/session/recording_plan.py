"""Plan of a recording: the configuration of the recorder process, and the size of its ring."""

from __future__ import annotations

import math
import os
import re
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from msgspec.structs import asdict

from blocks.actuators.drive import Drive
from blocks.recorders import CsvRecorder
from blocks.states import StateMachine
from cext.clock.stopwatch import names
from graph import Actuator, Interval, Signal
from graph.device import actuators_of
from graph.store import to_json
from runtime.host.errors import BadInput
from runtime.record.recorder import can_ask

if TYPE_CHECKING:
    from graph import Diagram, Schedule
    from graph.schedule import SinkColumns
    from runtime.host.machine.realtime import Realtime
    from runtime.record.recorder.plan_types import Plan, PlanSink
    from runtime.robot.rig.record_checks import Compared
    from runtime.session.prepare import Prepared
    from runtime.session.request import Request

ROW_SECONDS = 2.5  # s of a run that the ring holds at least
FRAME_BYTES = 88  # of a frame in the ring
FRAMES = {"can": 4}  # per device and tick; OTHER_FRAMES for any other medium
OTHER_FRAMES = 16
LOCAL_SERVICES = ("strides",)  # of runtime.record.recorder.local, without a process
FIELD_LENGTH = 40  # characters of a trial's field in the names of files


def ring_bytes(schedule: Schedule) -> int:
    """Return the size in bytes of a ring for ROW_SECONDS of rows and frames, at least 1 MiB."""
    frames = sum(FRAMES.get(schedule.media[device.bus], OTHER_FRAMES) for device in schedule.devices)
    a_tick = 8 * (3 + len(schedule.columns)) + FRAME_BYTES * frames
    return max(1 << 20, int(ROW_SECONDS * schedule.rate * a_tick))


def records_files(prepared: Prepared) -> bool:
    """Return whether a run writes files."""
    request = prepared.request
    written = any(sink.block.writes_files for sink in prepared.schedule.sinks)
    return not request.no_record and (request.record is not None or written)


def active_sinks(prepared: Prepared) -> list[SinkColumns]:
    """Return the sinks of the schedule that receive a run."""
    request = prepared.request
    return [
        sink
        for sink in prepared.schedule.sinks
        if not (request.no_record and isinstance(sink.block, CsvRecorder)) and sink.block.is_active(request.fast)
    ]


def needs_process(prepared: Prepared) -> bool:
    """Return whether a run needs the recorder process: in real time, for files or viewers, or for keys."""
    return (
        not prepared.request.fast
        or can_ask()
        or records_files(prepared)
        or any(sink.block.service not in LOCAL_SERVICES for sink in active_sinks(prepared))
    )


def plan(prepared: Prepared, realtime: Realtime) -> Plan:
    """Return the plan of the recorder, as plain data that JSON can hold."""
    request, schedule, rig = prepared.request, prepared.schedule, prepared.rig
    records = records_files(prepared)
    labels = states(prepared.diagram)
    sinks: list[PlanSink] = [
        {
            "service": sink.block.service,
            "path": sink.block.path,
            "parameters": {name: getattr(sink.block, name) for name in sink.block.parameters},
            "columns": [{**asdict(column), "labels": labels.get(column.path, [])} for column in sink.columns],
            "every": sink.block.every,
            "wanted": request.plotjuggler is not None,
        }
        for sink in active_sinks(prepared)
    ]
    return {
        "name": schedule.name,
        "folder": str(request.record or "recordings") if records else None,
        "stem": stem(request),
        "rate": schedule.rate,
        "duration": prepared.ticks / schedule.rate if prepared.ramp else request.duration,
        "virtual": request.fast,
        "compression": request.compression,
        "can_log": request.can_log,
        "simulated": prepared.plant is not None,
        "signals": [asdict(column) for column in schedule.recorded],
        "limits": limits(prepared.diagram, schedule),
        "states": labels,
        "hot": {
            f"{block.path}.temperature": block.fault_temperature
            for block in actuators_of(prepared.diagram)
            if isinstance(block, Drive)
        },
        "drives": {
            device.name: number
            for number, device in enumerate(schedule.devices)
            if isinstance(prepared.diagram[device.name], Actuator)
        },
        "buses": schedule.buses,
        "media": schedule.media,
        "bitrates": {load.bus: request.bitrate or load.bitrate for load in schedule.loads},
        "data_bitrates": {load.bus: load.data_bitrate for load in schedule.loads if load.data_bitrate},
        "items": names(schedule),
        "sinks": sinks,
        "status_line": True,
        "keys": request.report is None and can_ask(),  # not if a program has started the run, which uses the mailbox
        "diagram_json": to_json(prepared.diagram) if records else None,
        "control_pid": os.getpid(),
        "secret": os.urandom(16).hex(),
        "phases": phases(prepared.diagram),
        "drawing": drawn(prepared.diagram) if any(sink["service"] == "panel" for sink in sinks) else None,
        "metadata": {
            "diagram_file": str(request.file),
            "source_sha256": prepared.source_sha256,
            "settings": dict(request.settings),
            "seed": request.seed,
            "trial": request.trial,
            "realtime": realtime.metadata(),
            "caveats": [asdict(caveat) for caveat in schedule.caveats],
            "accepted": list(request.accept),
            "subject": None if prepared.subject is None else prepared.subject.recorded(),
            "rig": None
            if rig is None
            else {
                "file": str(rig.rig.path),
                "text": rig.rig.text,
                "settings": rig.streams.settings,
                "records": commissioned(rig.rig.path, prepared.compared),
            },
        },
    }


def commissioned(rig: Path, compared: Compared | None) -> dict[str, Any]:
    """Return the serial numbers of the records of commissioning beside a rig file, and their SHA-256.

    compared : those of the units that respond, where they were asked
    """
    from runtime.robot.rig.records import digest, records_of  # imports OpenSSL, for its hash: 4 MB

    try:
        found = records_of(rig) if compared is None else compared.records
    except BadInput as error:
        return {"unreadable": str(error)}
    return {"sha256": digest(found), "serials": {path: record.serial for path, record in found.items()}}


def drawn(diagram: Diagram) -> str:
    """Return the drawing of a diagram as SVG, with room for the values of its signals."""
    from graph.drawing import draw, svg  # for a panel alone

    return svg(draw(diagram, values=True))


def limits(diagram: Diagram, schedule: Schedule) -> dict[str, tuple[float, float]]:
    """Return {path: (lowest, highest)} of the signals of actuators that a limit or a joint's range bounds.

    The limit of a torque is the proved range of its command, and the limit of the drive where that proves nothing.
    """
    ranges = {}
    proved = {proof.path: proof for proof in schedule.proofs if proof.port == "torque_command" and proof.holds}
    for actuator in actuators_of(diagram):
        torque = actuator.command_limits().get("torque_command")
        bound = schedule.torque_bounds.get(actuator.path)
        if torque is not None:
            if bound is not None and bound.limit is not None:
                torque &= Interval(-bound.limit, bound.limit)
            if bound is not None and bound.kind == "proved" and actuator.path in proved:
                command = proved[actuator.path].interval
                torque = torque & command if command.low < command.high else torque  # a subject may have less
            ranges |= {f"{actuator.path}.{port}": (torque.low, torque.high) for port in ("torque", "torque_sent")}
        if span := getattr(actuator, "range", ()):
            ranges[f"{actuator.path}.position"] = tuple(span)
    known = {column.path for column in schedule.recorded}
    return {path: ends for path, ends in ranges.items() if path in known and all(map(math.isfinite, ends))}


def states(diagram: Diagram) -> dict[str, list[str]]:
    """Return {path of the state of a StateMachine: names of its states}."""
    return {f"{block.path}.state": list(block.names) for block in diagram if isinstance(block, StateMachine)}


def phases(diagram: Diagram) -> dict[str, str]:
    """Return {path of a gait phase: path of what is true while it is known, or ""}, from inputs of these names."""
    wired: dict[str, dict[str, str]] = {}
    for wire in diagram.wires:
        if isinstance(wire.source, Signal):
            wired.setdefault(wire.block.path, {})[wire.port or ""] = wire.source.path
    return {
        ports["phase"]: ports.get("walking") or ports.get("enable", "") for ports in wired.values() if "phase" in ports
    }


def stem(request: Request) -> str:
    """Return the stem of a recording's file names: the diagram, the trial without its notes, the time."""
    words = [
        re.sub(r"[^\w.-]+", "-", value).strip("-")[:FIELD_LENGTH]
        for name, value in request.trial.items()
        if name != "notes"
    ]
    return "_".join([Path(request.file).stem, *filter(None, words), time.strftime("%Y-%m-%d_%H-%M-%S")])
