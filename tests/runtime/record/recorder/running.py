"""Recordings for tests: plans, records, diagrams that run, and a whole run in one call."""

import json
from array import array

from msgspec.structs import asdict

from blocks.actuators import CubeMars
from blocks.models import Limb
from blocks.recorders import CsvRecorder
from cext.bus.memory_bus import MemoryBus
from cext.memory.shared_state import RECORD_EVENT, RECORD_FRAME, RECORD_ROW, SharedState
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Block, Diagram, Output, compile, subsystem
from runtime.record.recorder import RecorderProcess
from runtime.record.storage.ascii_units import ascii_name
from runtime.record.storage.format import FRAME

CSV = "runtime.record.recorder.services.csv:CsvWriter"
JUGGLER = "runtime.record.recorder.services.plotjuggler:PlotJugglerSender"
STRIDES = "runtime.record.recorder.services.strides:StrideAverage"


def columns(*described):
    """Columns of a sink from texts "path unit" or "path unit dtype"; "a 1 bool" for instance."""
    fields = [text.split() for text in described]
    return [
        {"index": index, "path": path, "unit": unit, "ascii_unit": ascii_name(unit), "dtype": (*dtype, "float")[0]}
        for index, (path, unit, *dtype) in enumerate(fields)
    ]


def sink(service, path, columns, **parameters):
    return {"service": service, "path": path, "parameters": parameters, "columns": columns}


def plan(folder, *sinks, **changed):
    """A plan whose rows are as wide as its widest sink asks for."""
    known = {column["index"]: column for entry in sinks for column in entry["columns"]}
    wide = max(known, default=-1) + 1
    unknown = {"unit": "1", "ascii_unit": "1", "dtype": "float"}
    signals = [known.get(index) or {"index": index, "path": f"other.x{index}", **unknown} for index in range(wide)]
    return {
        "name": "bench",
        "folder": None if folder is None else str(folder),
        "stem": "bench_1",
        "rate": 200.0,
        "duration": None,
        "virtual": True,
        "can_log": True,
        "simulated": True,
        "items": [],
        "buses": [],
        "status_line": False,
        "metadata": {},
        "sinks": list(sinks),
        "signals": signals,
        **changed,
    }


def row(tick, *values, lateness=0.0):
    """lateness in s"""
    return RECORD_ROW, array("d", [tick, lateness, *values]).tobytes()


def frame(time, identifier, data, *, sent=0, bus=0, flags=0):
    """time in ns; identifier with the flag bits of SocketCAN."""
    return RECORD_FRAME, FRAME.pack(time, identifier, len(data), flags, bus, sent, data)


def record(plan, records, shared=None, ended_by=0):
    """The records through a real recorder process. Returns its report. ended_by : number of the signal, 0 for none"""
    shared = shared or SharedState(1 << 20)
    recorder = RecorderProcess(shared)
    recorder.configure(plan)
    for kind, payload in records:
        assert shared.push(kind, payload)
    end = {"event": "end", "status": "ok", "culprit": None, "signal": ended_by, "tick": 0}
    shared.push(RECORD_EVENT, json.dumps(end).encode())
    shared.close()
    return recorder.finish()


class Counter(Block):
    """The tick, three times: as it is, as a whole number in thirds, and whether it is odd."""

    value = Output("m")
    whole = Output("1", dtype=int)
    odd = Output("1", dtype=bool)

    def step(self, tick):
        return 0.1 * tick, int(tick) // 3, bool(int(tick) % 2)


def counting(rate=200):
    with Diagram("counting", rate=rate) as diagram:
        Counter(name="counter")
        CsvRecorder()
    return diagram


def leg():
    """A knee with a drive on a bus, and its plant."""
    with Diagram("leg", rate=200) as diagram:
        with subsystem("left"):
            knee = CubeMars("AK10-9-V2.0", bus="legs", can_id=1, range=(-12.5, 12.5), wake_shift=0.0, name="knee")
            knee(torque_command=1.0)
        CsvRecorder()
    with Diagram("wearer", rate=1000) as plant, subsystem("left"):
        drive = diagram["left/knee"].emulator()
        limb = Limb()
        limb(torque=drive.torque)
        drive(position=limb.position, velocity=limb.velocity)
    return diagram, plant


def plan_of(schedule, folder, **changed):
    sinks = [
        sink(
            entry.block.service,
            entry.block.path,
            [asdict(column) for column in entry.columns],
            **{name: getattr(entry.block, name) for name in entry.block.parameters},
        )
        for entry in schedule.sinks
    ]
    return plan(
        folder,
        *sinks,
        **{
            "name": schedule.name,
            "stem": schedule.name,
            "rate": schedule.rate,
            "signals": [asdict(column) for column in schedule.recorded],
            "buses": list(schedule.buses),
            **changed,
        },
    )


def run(diagram, folder, ticks, *, plant=None, virtual=True, shared=None, before=None, **changed):
    """Compile, record and run a diagram. Returns (outcome, report, page). before : called with the recorder when all is
    ready to run
    """
    shared = shared or SharedState(1 << 20)
    recorder = RecorderProcess(shared)
    schedule = compile(diagram)
    buses = [MemoryBus() for _ in schedule.buses]
    recorder.configure(plan_of(schedule, folder, virtual=virtual, **changed))
    executor = Executor(
        Program(schedule, [bus.host for bus in buses]),
        schedule.rate,
        shared=shared,
        virtual=virtual,
        reader=recorder.lifeline,
        plant=None if plant is None else Program(compile(plant), [bus.device for bus in buses]),
        substeps=1 if plant is None else round(plant.rate / schedule.rate),
    )
    if before is not None:
        before(recorder)
    outcome = executor.run(ticks)
    shared.push(
        RECORD_EVENT,
        json.dumps(
            {
                "event": "end",
                "status": outcome.status,
                "culprit": outcome.culprit,
                "signal": outcome.signal,
                "tick": outcome.tick,
            }
        ).encode(),
    )
    shared.close()
    return outcome, recorder.finish(), shared


def read_csv(path, delimiter=","):
    """(header, rows as lists of texts)"""
    text = path.read_text()
    assert text.endswith("\n"), "the last row is cut"
    lines = [line.split(delimiter) for line in text.splitlines()]
    return lines[0], lines[1:]
