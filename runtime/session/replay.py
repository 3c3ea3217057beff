"""`python -m runtime replay`: run a recording again from its received frames, on the recorded clock.

    Trial ──> ReplayClock, ReplayBus ──> Executor ──> a new recording ──> compare

An unchanged diagram reproduces every recorded signal and every sent frame bit for bit. A missing input is reported as
a divergence and never replaced by an estimate.
"""

import hashlib
import json
import math
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from blocks.recorders import CsvRecorder
from cext.bus.replay_bus import ReplayBus, ReplayClock
from cext.clock.stopwatch import names
from cext.safety.shared_state import RECORD_EVENT, SharedState
from cext.schedule.executor import Executor
from cext.schedule.outcome import Outcome
from cext.schedule.program import Program
from graph import DiagramError, Sink
from graph.store import from_json, to_json
from runtime.analysis.compare import Comparison, compare, sent_frames
from runtime.analysis.trial import Trial
from runtime.base.ending import uninterrupted
from runtime.base.errors import BadInput
from runtime.console.progress import Progress
from runtime.console.terminal import one_line
from runtime.diagrams.file import compiled, load
from runtime.live.table import describe
from runtime.recorder import RecorderError, RecorderProcess
from runtime.recording.format import FRAME
from runtime.rig.file import parse

RING_SIZE = 1 << 22  # bytes
READ_SIZE = 1 << 20  # bytes
SINKS = (
    "blocks.recorders:CsvRecorder",
    "blocks.recorders:StrideReport",
    "blocks.sinks:PlotJuggler",
    "blocks.sinks:Rerun",
)
# how a run ended whose cause is not in the recording
EXTERNAL_ENDS = ("bus error", "fenced", "foreign command", "hung", "overrun", "unguarded")


@dataclass(frozen=True)
class Source:
    """Source of the diagram to run.

    file : Path of a Python file; None for the diagram in the recording, which runs code of installed libraries only
    sha256 : hex digest that the content of `file` must have; None for any content, if the operator has named the file
    instead : reason why the diagram in the recording is used instead of the recorded file
    """

    file: Path | None
    sha256: str | None = None
    instead: str = ""


@dataclass
class Replayed:
    """A recording, its replay and their comparison.

    there : Trial of the recording
    here : Trial of the replay
    source : Source of the diagram
    unchanged : whether the diagram computes the same as the recorded one
    outcome : cext.schedule.outcome.Outcome
    comparison : Comparison of `there` with `here`
    frame : index of the first sent frame that differs; None if all are equal
    frames : number of sent frames in the recording
    files : paths of the new recording, if it was kept
    fault : tick of the first fault after which the run waited to be armed again; None without one
    """

    there: Trial
    here: Trial
    source: Source
    unchanged: bool
    outcome: Outcome
    comparison: Comparison
    frame: int | None
    frames: int
    files: list
    fault: int | None = None

    @property
    def same(self):
        return self.comparison.identical and self.frame is None and self.ended_alike

    @property
    def end(self):
        """The end of the recorded run with `status` and `culprit`; {} if it is not recorded."""
        return (self.there.end or {}).get("end") or {}

    @property
    def ended_alike(self):
        if self.end.get("status") in EXTERNAL_ENDS:
            return self.outcome.status == "ok"
        return not self.end or (self.end["status"], self.end["culprit"]) == (self.outcome.status, self.outcome.culprit)


def opened(path):
    """Return the Trial of a recording. path : of the .mcap file. Raises BadInput if it cannot be replayed."""
    with Progress(f"reading {Path(path).name}") as progress:
        trial = Trial(path)
        trial.check(progress)
    check(trial)
    return trial


def source_of(trial, file=None):
    """Return the Source of the diagram to run.

    Loading a diagram file runs its code, and a recording can come from an untrusted source. A file named by the
    recording alone is therefore loaded only if its content has the recorded hash.

    file : a diagram file that the operator has named
    """
    if file is not None:
        return Source(Path(file))
    metadata = trial.about["metadata"]
    recorded, sha256 = str(metadata.get("diagram_file") or ""), metadata.get("source_sha256")
    if not os.path.isfile(recorded):
        return Source(None, instead=f"{recorded or 'its diagram file'} does not exist")
    if not sha256:
        return Source(None, instead=f"the recording has no hash of {recorded}")
    if sha256_of(recorded) != sha256:
        return Source(None, instead=f"{recorded} has changed since the recording")
    return Source(Path(recorded), sha256)


def sha256_of(path):
    """Return the hex digest of a file's content; "" if it cannot be read."""
    try:
        with open(path, "rb") as stream:
            digest = hashlib.sha256()
            while data := stream.read(READ_SIZE):
                digest.update(data)
    except OSError:
        return ""
    return digest.hexdigest()


def replay(trial, source, folder=None):
    """Run a recording again.

    trial : as `opened` returns it
    source : as `source_of` returns it
    folder : for the new recording; None deletes it after the comparison

    Raises BadInput if the recording cannot be replayed.
    """
    fault = up_to_the_first_fault(trial)
    diagram, where, origin = diagram_of(trial, source)
    add_recorder(trial, diagram)
    schedule = compiled(where, diagram)
    ends = buses(trial, schedule)
    changes = live_changes(trial, schedule)
    with tempfile.TemporaryDirectory() as scratch:
        target = str(folder or scratch)
        outcome, report = run(trial, diagram, schedule, ends, changes, target, origin)
        if report["problems"]:
            raise BadInput(report["problems"][0])
        files = [entry["path"] for entry in report["files"]]
        with Progress("comparing") as progress:
            here = Trial(next(name for name in files if name.endswith(".mcap")))
            here.check(progress.part(0.0, 0.9))
        mine, theirs = sent_frames(trial), sent_frames(here)
        frame = next(
            (index for index, (a, b) in enumerate(zip(mine, theirs)) if a != b),
            None if len(mine) == len(theirs) else min(len(mine), len(theirs)),
        )
        unchanged = computation(trial.diagram or {}) == computation(json.loads(to_json(diagram)))
        return Replayed(
            trial,
            here,
            source,
            unchanged,
            outcome,
            compare(trial, here, order(schedule)),
            frame,
            len(mine),
            files if folder else [],
            fault,
        )


def check(trial):
    """Raise BadInput if inputs of the run are missing from the recording."""
    if trial.about.get("part", 1) > 1:
        raise BadInput(
            f"{trial.path} is part {trial.about['part']} of a recording, which begins in part 1: replay part 1"
        )
    dropped = (trial.end or {}).get("statistics", {}).get("dropped", 0)
    if dropped:
        raise BadInput(f"{trial.path}: {dropped} records were dropped during the run, so it cannot be replayed")
    if not len(trial):
        raise BadInput(f"{trial.path} contains no ticks")


def diagram_of(trial, source):
    """Return (Diagram, path of its source, metadata of the source for the new recording). Raises BadInput."""
    metadata = trial.about["metadata"]
    if source.file is None:
        diagram, where, origin = stored(trial, source), trial.path, {}
    else:
        rig, settings = metadata.get("rig"), list(metadata.get("settings", {}).items())
        file, diagram = load(source.file, settings, rig and parse(Path(rig["file"]), rig["text"]), source.sha256)
        where, origin = source.file, {"diagram_file": str(source.file), "source_sha256": file.sha256}
    diagram.rate = trial.about["rate"]
    return diagram, where, origin


def stored(trial, source):
    """Return the diagram that is stored in a recording. Raises BadInput."""
    remedy = "run a diagram file with --diagram FILE"
    if trial.diagram is None:
        raise BadInput(f"{trial.path}: {source.instead}, and the recording contains no diagram: {remedy}")
    try:
        return from_json(json.dumps(trial.diagram))
    except DiagramError as error:
        raise BadInput(
            f"{trial.path}: {source.instead}, and the diagram in the recording cannot be used: {error}\n{remedy}"
        ) from None
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise BadInput(f"{trial.path} is damaged: its diagram.json is not a diagram ({error!r}); {remedy}") from None


def add_recorder(trial, diagram):
    """Add a recorder if `--record` had added one, or if the diagram has no sink."""
    recorded = any(block["type"].endswith(":CsvRecorder") for block in (trial.diagram or {}).get("blocks", []))
    if not any(isinstance(block, CsvRecorder) if recorded else isinstance(block, Sink) for block in diagram):
        with diagram:
            CsvRecorder()


def computation(description):
    """Return the description of a diagram without its sinks, which options of a run can add."""
    sinks = {block["path"] for block in description.get("blocks", []) if block["type"] in SINKS}
    return {key: value for key, value in description.items() if key not in ("hash", "blocks", "wires", "libraries")} | {
        "blocks": [block for block in description.get("blocks", []) if block["path"] not in sinks],
        "wires": [wire for wire in description.get("wires", []) if wire["to"] not in sinks],
    }


def buses(trial, schedule):
    """Return the robot's end of each bus. Raises BadInput for a bus that is not in the recording."""
    ends = []
    for name in schedule.buses:
        if name not in trial.about["buses"]:
            known = ", ".join(trial.about["buses"]) or "none"
            raise BadInput(f"bus {name!r} of the diagram is not in the recording, whose buses are {known}")
        received = [frame for frame in trial.frames if frame.bus == name and not frame.sent and frame.drain > 0]
        frames = np.frombuffer(b"".join(frame.payload for frame in received), np.uint8).reshape(-1, FRAME.size)
        bus = ReplayBus()
        try:
            bus.give(frames, [frame.drain for frame in received])
        except ValueError as error:
            raise BadInput(f"{trial.path} is damaged: bus {name!r}: {error}") from None
        ends.append(bus.host)
    return ends


def tape(trial):
    """Return the ReplayClock of the recorded ticks, with the tick of a fault whose cause was recorded."""
    ticks, late = trial.tick, np.rint(trial.lateness * 1e9).astype(np.int64)
    end = (trial.end or {}).get("end")
    if end is not None and end["status"] not in ("ok", *EXTERNAL_ENDS) and end["tick"] > ticks[-1]:
        ticks, late = np.append(ticks, end["tick"]), np.append(late, round(end.get("late", 0.0) * 1e9))
    clock = ReplayClock(lambda: False, trial.about["simulated"], drained_before(trial))
    clock.give(ticks, late)
    return clock


def drained_before(trial):
    """Return the times of the bus drains before tick 0, in ns from the start of the run."""
    times = {frame.drain: frame.drained for frame in trial.frames if frame.row == 0}
    # drain of tick 0; from there one per row
    first = next((frame.drain - frame.row for frame in trial.frames if frame.row > 0), max(times, default=0))
    before = []
    for drain in range(1, first):  # a drain without received or sent frames is not in the recording
        before.append(times.get(drain, before[-1] + round(1e9 / trial.about["rate"]) if before else 0))
    return before


def up_to_the_first_fault(trial):
    """Cut a Trial before the first fault after which the run could be armed again.

    Returns the tick of that fault, or None without one.
    """
    fault = next((event for event in trial.events if event["event"] == "fault"), None)
    if fault is None:
        return None
    kept = trial.tick < fault["tick"]
    trial.tick, trial.time, trial.lateness, trial.rows = (
        trial.tick[kept],
        trial.time[kept],
        trial.lateness[kept],
        trial.rows[kept],
    )
    trial.end = {**(trial.end or {}), "end": {key: fault[key] for key in ("status", "culprit", "tick", "late")}}
    return fault["tick"]


def order(schedule):
    """Return the paths of the recorded signals in order of computation, devices last.

    The received values of a device are equal by construction, and its sent values are effects of other signals.
    """
    devices = {device.name for device in schedule.devices}
    place = {
        column.path: (column.path.rpartition(".")[0] in devices, int(slot))
        for slot, column in zip(schedule.columns, schedule.recorded)
    }
    return sorted(place, key=place.__getitem__)


def live_changes(trial, schedule):
    """Return the live changes of a run: (tick, index of the live parameter, value, slew).

    Raises BadInput for a change that the diagram does not allow.
    """
    index = {live.path: number for number, live in enumerate(schedule.live)}
    changes = []
    for event in trial.events:
        if event["event"] != "set":
            continue
        path, value = event["path"], event["value"]
        change = one_line(f"{trial.path}: {path} was set to {value} at tick {event['tick']}")
        if path not in index:
            raise BadInput(f"{change}, but the diagram has no such live parameter")
        live = schedule.live[index[path]]
        if not live.low <= value <= live.high:
            raise BadInput(f"{change}, but its live range in the diagram is {live.low:g} to {live.high:g}")
        changes.append((event["tick"], index[path], float(value), event.get("slew", math.inf)))
    return changes


def run(trial, diagram, schedule, ends, changes, folder, origin):
    """Run the schedule on the recorded clock. Returns (Outcome, report of the recorder)."""
    page = SharedState(RING_SIZE, live=describe(schedule))
    recorder = RecorderProcess(page)
    try:
        recorder.configure(plan(trial, diagram, schedule, folder, origin))
        program = Program(schedule, ends)
        program.live.follow(changes)
        executor = Executor(program, schedule.rate, page=page, virtual=True, reader=recorder.lifeline, tape=tape(trial))
        outcome = uninterrupted(executor.run())
        end = {
            "event": "end",
            "status": outcome.status,
            "culprit": outcome.culprit,
            "tick": outcome.tick,
            "signal": outcome.signal,
        }
        while not page.push(RECORD_EVENT, json.dumps(end).encode()) and recorder.alive:
            pass
        page.close()
    except RecorderError as error:
        raise BadInput(str(error)) from None
    except BaseException:
        recorder.abandon()
        raise
    return outcome, recorder.finish()


def plan(trial, diagram, schedule, folder, origin):
    """Return the configuration of the recorder."""
    return {
        "name": schedule.name,
        "folder": folder,
        "stem": f"{trial.path.stem}_replay",
        "rate": schedule.rate,
        "virtual": True,
        "duration": float(trial.time[-1]) + 1.0 / schedule.rate,
        "keys": False,
        "simulated": trial.about["simulated"],
        "signals": [vars(column) for column in schedule.recorded],
        "buses": schedule.buses,
        "media": schedule.media,
        "bitrates": {load.bus: load.bitrate for load in schedule.loads},
        "items": names(schedule),
        "sinks": [],
        "status_line": True,
        "diagram_json": to_json(diagram),
        "metadata": {**trial.about["metadata"], **origin, "replay_of": trial.path.name},
    }


def report_lines(result):
    """Return the lines of a Replayed for standard output."""
    there, comparison = result.there, result.comparison
    diagram = "the recorded diagram" if result.unchanged else "a changed diagram"
    lines = [f"{there.about['name']}: {comparison.ticks} ticks of {there.path.name} replayed with {diagram}"]
    if result.source.file is None:
        lines.append(
            f"  the diagram in the recording was used: {result.source.instead}. Pass --diagram FILE to use a file"
        )
    if result.fault is not None:
        lines.append(f"  replayed up to the fault at tick {result.fault}, after which the run waited to be armed again")
    if not there.complete:
        lines.append("  the recording is incomplete; replayed up to its last complete tick")
    signals = len(comparison.same) + len(comparison.differences)
    if result.same:
        lines.append(f"  all {signals} signals and {result.frames} sent frames are the same, bit for bit")
    if result.end.get("status") in EXTERNAL_ENDS:
        lines.append(
            f"  the recorded run ended by an external cause, which a replay does not repeat: {result.end['status']}"
        )
    if comparison.differences:
        first = comparison.differences[0]
        lines.append(
            f"  first difference: {first.path} at tick {first.first}: recorded {first.here!r}, "
            f"replayed {first.there!r} {first.unit}"
        )
        lines.append(
            f"  {len(comparison.differences)} of {signals} signals differ, {len(comparison.same)} are the same"
        )
    if result.frame is not None:
        lines.append(f"  the sent frames differ from index {result.frame} of {result.frames}")
    for label, paths in (
        ("only in the recording", comparison.only_here),
        ("only in the replay", comparison.only_there),
    ):
        if paths:
            lines.append(f"  {label}: {', '.join(paths[:5])}{f' and {len(paths) - 5} more' if len(paths) > 5 else ''}")
    if any(comparison.missing):
        lines.append(
            f"  {comparison.missing[0]} ticks are only in the recording, {comparison.missing[1]} only in the replay"
        )
    if not result.ended_alike:
        lines.append(
            f"  different end: recorded {result.end['status']} at {result.end['culprit']}, "
            f"replayed {result.outcome.status} at {result.outcome.culprit}"
        )
    return lines + [f"  {path}" for path in result.files]
