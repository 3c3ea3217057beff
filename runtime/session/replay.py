"""`python -m runtime replay`: a recorded run once more, from what its buses received, tick by tick on the recorded
clock.

    Trial ──> ReplayClock, ReplayBus ──> Executor ──> a new recording ──> compare

An unchanged diagram must give every recorded signal and every frame again, bit for bit. What the recording lacks is a
divergence, never a guess.
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
from cext.safety.shared_state import RECORD_EVENT, SharedState
from cext.schedule.executor import Executor
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
from runtime.rig.file import parse

RING = 1 << 22  # bytes
PIECE = 1 << 20  # bytes of a file that are read at once
SINKS = ("blocks.recorders:CsvRecorder", "blocks.sinks:PlotJuggler", "blocks.sinks:Rerun")
# ends whose cause is not among what was recorded
FROM_OUTSIDE = ("bus error", "fenced", "foreign command", "hung", "overrun", "unguarded")


@dataclass(frozen=True)
class Source:
    """Where the diagram to run comes from.

    file : Path of Python that is run; None for the diagram that is stored in the recording, which runs no code but that
        of installed libraries
    sha256 : hex digest of the only content of `file` that may be run; None for any, where the operator has named it
    instead : why the stored diagram is used, not the recorded file
    """

    file: Path | None
    sha256: str | None = None
    instead: str = ""


@dataclass
class Replayed:
    """
    there : Trial, the recording; here : Trial, what came of it now
    source : Source of the diagram
    unchanged : whether the diagram has the recorded content
    outcome : cext.schedule.executor.Outcome
    comparison : Comparison of `there` with `here`
    frame : number of the first sent frame that differs, None where all are the same
    frames : how many there were
    files : paths of the new recording, if it was kept
    fault : tick of the first fault, where the run waited to be armed again after it; None where it did not
    """

    there: Trial
    here: Trial
    source: Source
    unchanged: bool
    outcome: object
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
        """How the recorded run ended, as `status` and `culprit`; {} where the recording does not say."""
        return (self.there.end or {}).get("end") or {}

    @property
    def ended_alike(self):
        if self.end.get("status") in FROM_OUTSIDE:
            return self.outcome.status == "ok"
        return not self.end or (self.end["status"], self.end["culprit"]) == (self.outcome.status, self.outcome.culprit)


def opened(path):
    """The Trial of a recording that can be run again. path : of the .mcap file. BadInput"""
    with Progress(f"reading {Path(path).name}") as progress:
        trial = Trial(path, progress)
    check(trial)
    return trial


def source_of(trial, file=None):
    """The Source of the diagram to run.

    A recording may come from anywhere, and to load a diagram file is to run it. So a file that only the recording names
    is run if its content is the recorded one, and not looked at by Python otherwise.

    file : a diagram file that the operator has named
    """
    if file is not None:
        return Source(Path(file))
    metadata = trial.about["metadata"]
    recorded, sha256 = str(metadata.get("diagram_file") or ""), metadata.get("source_sha256")
    if not os.path.isfile(recorded):
        return Source(None, instead=f"{recorded or 'its diagram file'} is not there")
    if not sha256:
        return Source(None, instead=f"the recording has no hash to compare {recorded} with")
    if sha256_of(recorded) != sha256:
        return Source(None, instead=f"{recorded} has changed since the recording")
    return Source(Path(recorded), sha256)


def sha256_of(path):
    """Hex digest of a file's content; "" where it cannot be read."""
    try:
        with open(path, "rb") as stream:
            found = hashlib.sha256()
            while piece := stream.read(PIECE):
                found.update(piece)
    except OSError:
        return ""
    return found.hexdigest()


def replay(trial, source, folder=None):
    """Run a recording again.

    trial : as `opened` returns it
    source : as `source_of` returns it
    folder : keeps the new recording; by default it goes away

    BadInput where the recording cannot be run again.
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
            here = Trial(next(name for name in files if name.endswith(".mcap")), progress.part(0.0, 0.9))
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
    """BadInput where something that went in is not in the recording."""
    if trial.about.get("part", 1) > 1:
        raise BadInput(f"{trial.path} is part {trial.about['part']} of a recording, and a run begins in part 1")
    dropped = (trial.end or {}).get("statistics", {}).get("dropped", 0)
    if dropped:
        raise BadInput(
            f"{trial.path}: {dropped} records were dropped while it was made, so that it cannot be run again"
        )
    if not len(trial):
        raise BadInput(f"{trial.path} holds no tick")


def diagram_of(trial, source):
    """(the diagram to run, where it is from, what a new recording says of that). BadInput"""
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
    """The diagram that is stored in a recording. BadInput, with the reason why it is asked for"""
    cure = "name the diagram file with --diagram FILE, which runs it"
    if trial.diagram is None:
        raise BadInput(f"{trial.path}: {source.instead}, and the recording holds no diagram: {cure}")
    try:
        return from_json(json.dumps(trial.diagram))
    except DiagramError as error:
        raise BadInput(
            f"{trial.path}: {source.instead}, and the diagram in the recording cannot be used: {error}\n{cure}"
        ) from None
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise BadInput(f"{trial.path} is damaged: its diagram.json describes no diagram ({error!r}); {cure}") from None


def add_recorder(trial, diagram):
    """As `--record` added one then; and to a diagram that has nothing that records."""
    recorded = any(block["type"].endswith(":CsvRecorder") for block in (trial.diagram or {}).get("blocks", []))
    if not any(isinstance(block, CsvRecorder) if recorded else isinstance(block, Sink) for block in diagram):
        with diagram:
            CsvRecorder()


def computation(description):
    """What a described diagram computes: without what takes alone, as the options of a run add it."""
    taking = {block["path"] for block in description.get("blocks", []) if block["type"] in SINKS}
    return {key: value for key, value in description.items() if key not in ("hash", "blocks", "wires", "libraries")} | {
        "blocks": [block for block in description.get("blocks", []) if block["path"] not in taking],
        "wires": [wire for wire in description.get("wires", []) if wire["to"] not in taking],
    }


def buses(trial, schedule):
    """The robot's end of each bus. BadInput for one that was not recorded."""
    drains = max((frame.drain for frame in trial.frames), default=0)
    ends = []
    for name in schedule.buses:
        if name not in trial.about["buses"]:
            known = ", ".join(trial.about["buses"]) or "none"
            raise BadInput(
                f"the diagram is on bus {name!r}, of which the recording has no frames; its buses are {known}"
            )
        reel = [[] for _ in range(drains)]
        for frame in trial.frames:
            if frame.bus == name and not frame.sent and frame.drain > 0:
                reel[frame.drain - 1].append(frame.payload)
        try:
            ends.append(ReplayBus(reel).host)
        except ValueError as error:
            raise BadInput(f"{trial.path} is damaged: of bus {name!r}, {error}") from None
    return ends


def tape(trial):
    """The ticks that ran: those with a row, and the one that a fault ended whose cause was recorded."""
    ticks, late = trial.tick, np.rint(trial.lateness * 1e9).astype(np.int64)
    end = (trial.end or {}).get("end")
    if end is not None and end["status"] not in ("ok", *FROM_OUTSIDE) and end["tick"] > ticks[-1]:
        ticks, late = np.append(ticks, end["tick"]), np.append(late, round(end.get("late", 0.0) * 1e9))
    return ReplayClock(ticks, late, trial.about["simulated"], drained_before(trial))


def drained_before(trial):
    """ns from the run's begin of each time that the buses were drained before tick 0."""
    times = {frame.drain: frame.drained for frame in trial.frames if frame.row == 0}
    # of tick 0: one drain a row
    first = next((frame.drain - frame.row for frame in trial.frames if frame.row > 0), max(times, default=0))
    before = []
    for drain in range(1, first):  # one that found nothing, and was followed by nothing sent, left no trace
        before.append(times.get(drain, before[-1] + round(1e9 / trial.about["rate"]) if before else 0))
    return before


def up_to_the_first_fault(trial):
    """A run that was armed again is run again up to there: cut it, and return the tick. None where there was no such
    fault.
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
    """Paths of what is recorded, in the order in which a tick computes it; devices last, as what they heard is the same
    and what they sent an effect.
    """
    devices = {device.name for device in schedule.devices}
    place = {
        column.path: (column.path.rpartition(".")[0] in devices, int(slot))
        for slot, column in zip(schedule.columns, schedule.recorded)
    }
    return sorted(place, key=place.get)


def live_changes(trial, schedule):
    """What was changed while it ran: (tick, index among the live parameters, value, slew). BadInput for what the
    diagram does not allow.
    """
    index = {live.path: number for number, live in enumerate(schedule.live)}
    changes = []
    for event in trial.events:
        if event["event"] != "set":
            continue
        path, value = event["path"], event["value"]
        what = one_line(f"{trial.path}: {path} was set to {value} at tick {event['tick']}")
        if path not in index:
            raise BadInput(f"{what}, and the diagram has no live parameter of that name")
        live = schedule.live[index[path]]
        if not live.low <= value <= live.high:
            raise BadInput(f"{what}, and the diagram has it live from {live.low:g} to {live.high:g}")
        changes.append((event["tick"], index[path], float(value), event.get("slew", math.inf)))
    return changes


def run(trial, diagram, schedule, ends, changes, folder, origin):
    """(Outcome, the recorder's report)"""
    page = SharedState(RING, live=describe(schedule))
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
        "sinks": [],
        "status_line": True,
        "diagram_json": to_json(diagram),
        "metadata": {**trial.about["metadata"], **origin, "replay_of": trial.path.name},
    }


def told(result):
    """Lines for standard output."""
    there, comparison = result.there, result.comparison
    what = "the diagram as it was recorded" if result.unchanged else "a changed diagram"
    lines = [f"{there.about['name']}: {comparison.ticks} ticks of {there.path.name} run again, {what}"]
    if result.source.file is None:
        lines.append(
            f"  the diagram in the recording was run: {result.source.instead}. Pass --diagram FILE to run a file"
        )
    if result.fault is not None:
        lines.append(
            f"  after the fault at tick {result.fault} it waited to be armed again: it was run again up to there"
        )
    if not there.complete:
        lines.append("  the recording was cut off; it was run again up to its last complete tick")
    signals = len(comparison.same) + len(comparison.differences)
    if result.same:
        lines.append(f"  all {signals} signals and {result.frames} sent frames are the same, bit for bit")
    if result.end.get("status") in FROM_OUTSIDE:
        lines.append(f"  then it ended from outside, which a replay does not repeat: {result.end['status']}")
    if comparison.differences:
        first = comparison.differences[0]
        lines.append(
            f"  differs first: {first.path} at tick {first.first}: {first.here!r} was recorded, and now it "
            f"is {first.there!r} {first.unit}"
        )
        lines.append(
            f"  {len(comparison.differences)} of {signals} signals differ, {len(comparison.same)} are the same"
        )
    if result.frame is not None:
        lines.append(f"  the frames sent differ from number {result.frame} of {result.frames} on")
    for label, paths in (("only in the recording", comparison.only_here), ("only now", comparison.only_there)):
        if paths:
            lines.append(f"  {label}: {', '.join(paths[:5])}{f' and {len(paths) - 5} more' if len(paths) > 5 else ''}")
    if any(comparison.missing):
        lines.append(
            f"  {comparison.missing[0]} ticks of the recording did not run now, {comparison.missing[1]} ran now only"
        )
    if not result.ended_alike:
        lines.append(
            f"  it ended otherwise: {result.end['status']} at {result.end['culprit']} then, "
            f"{result.outcome.status} at {result.outcome.culprit} now"
        )
    return lines + [f"  {path}" for path in result.files]
