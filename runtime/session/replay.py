"""`python -m runtime replay`: run a recording again from its received frames, on the recorded clock.

    Trial ──> Feed (clock, buses) ──> Session ──> ReplayComparison
        └──────────────────────────────────────────────┘

A replay is a Session with another clock and other buses. It reads the recording, runs and compares block by block, in
constant memory. An unchanged diagram reproduces every recorded signal and every sent frame bit for bit. A missing input
is reported as a divergence and never replaced by an estimate.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from msgspec.structs import asdict
from msgspec.structs import replace as changed

from cext.schedule.outcome import Outcome
from graph.store import to_json
from runtime.host.console.progress import Progress
from runtime.host.console.terminal import one_line
from runtime.host.ending import raise_if_ended_by_signal
from runtime.host.errors import BadInput
from runtime.record.analysis.compare import Comparison
from runtime.record.analysis.trial import Trial
from runtime.record.recorder import RecorderError
from runtime.record.recorder.local import LocalRecorder
from runtime.record.report.fault_context import inputs_and_outputs
from runtime.robot.loading.file import compile_diagram
from runtime.robot.loading.recorded_signals import everything
from runtime.session.prepare import Prepared
from runtime.session.replay_comparison import ReplayComparison
from runtime.session.replay_feed import Feed, payloads
from runtime.session.replay_source import Source, add_recorder, computation, diagram_of, subject_of
from runtime.session.request import Request
from runtime.session.session import Session

if TYPE_CHECKING:
    import numpy as np

    from cext.schedule.program import Program
    from graph import Schedule
    from runtime.host.machine.realtime import Realtime

# how a run ended whose cause is not in the recording
EXTERNAL_ENDS = (
    "bus error",
    "fenced",
    "foreign command",
    "hung",
    "overrun",
    "page lost",
    "program silent",
    "unguarded",
)


@dataclass
class Replayed:
    """A recording, its replay and their comparison.

    there : Trial of the recording
    source : Source of the diagram
    unchanged : whether the diagram computes the same as the recorded one
    outcome : cext.schedule.outcome.Outcome
    comparison : Comparison of the recording with the replay
    frame : index of the first sent frame that differs; None if all are equal
    frames : number of sent frames in the recording
    files : paths of the new recording, if it was kept
    fault : tick of the first fault after which the run waited to be armed again, where the replay ends; None without
        one
    end : the end of the recorded run up to there, with `status` and `culprit`; {} if it is not recorded
    context : lines on the newest ticks of the block that caused the end, if they were asked for
    """

    there: Trial
    source: Source
    unchanged: bool
    outcome: Outcome
    comparison: Comparison
    frame: int | None
    frames: int
    files: list[str]
    fault: int | None
    end: dict[str, Any]
    context: tuple[str, ...] = ()

    @property
    def faulted(self) -> bool:
        """Whether the recorded run ended in a fault, or waited after one."""
        return self.end.get("status", "ok") not in ("ok", "stopped")

    @property
    def same(self) -> bool:
        """Whether the replay equals the recording in every signal, sent frame and in its end."""
        return self.comparison.identical and self.frame is None and self.ended_alike

    @property
    def ended_externally(self) -> bool:
        """Whether the recorded run ended by a cause that is not in the recording."""
        return self.end.get("status") in EXTERNAL_ENDS

    @property
    def ended_alike(self) -> bool:
        """Whether the replay ended as the recorded run did, or completed one that an external cause ended."""
        if self.ended_externally:
            return self.outcome.status == "ok"
        return not self.end or (self.end["status"], self.end["culprit"]) == (self.outcome.status, self.outcome.culprit)


class ReplaySession(Session):
    """A run on the recorded clock.

    prepared : Prepared, with a Feed
    trial : Trial of the recording
    comparison : ReplayComparison
    metadata : metadata of the new recording
    """

    def __init__(
        self, prepared: Prepared, trial: Trial, comparison: ReplayComparison, metadata: dict[str, Any]
    ) -> None:
        # without a recording the comparison is made in this process
        local = partial(LocalRecorder, receive=self.receive) if prepared.request.no_record else None
        super().__init__(prepared, recorder=local)
        self.trial, self.comparison, self.metadata = trial, comparison, metadata

    def receive(self, rows: np.ndarray, sent: np.ndarray, before: np.ndarray) -> None:
        """Compare a block of the replay.

        rows : array (ticks, 2 + signals): tick, lateness in s, and every signal
        sent : uint8 array (frames, bytes of a struct Frame)
        before : number of rows of this block before each of the frames
        """
        self.comparison.add_replayed(rows, sent, before + self.comparison.replayed.row_count)

    def plan(self, realtime: Realtime) -> dict[str, Any]:
        """Return the plan of the recorder."""
        return {
            **super().plan(realtime),
            "stem": f"{self.trial.path.stem}_replay",
            "simulated": self.trial.about["simulated"],
            "keys": False,
            "sinks": [],
            "diagram_json": to_json(self.prepared.diagram),
            "metadata": self.metadata,
        }

    def program(self) -> Program:
        """Return the program of the robot, with the recorded changes of live parameters."""
        control = super().program()
        try:
            control.live.follow(live_changes(self.trial, self.prepared.schedule))
        except ValueError as error:
            raise BadInput(f"{self.trial.path}: a recorded change breaks a rule of the diagram: {error}") from None
        return control


def open_recording(path: str | Path) -> Trial:
    """Return the Trial of a recording. Raises BadInput if it cannot be replayed.

    path : path of the .mcap file
    """
    with Progress(f"reading {Path(path).name}") as progress:
        trial = Trial(path)
        trial.check(progress)
    check(trial)
    return trial


def replay(trial: Trial, source: Source, folder: str | Path | None = None, width: int | None = None) -> Replayed:
    """Run a recording again.

    trial : as `open_recording` returns it
    source : as `source_of` returns it
    folder : folder for a recording of the replay, or None
    width : characters of a line of `context`; None without it

    Raises BadInput if the recording cannot be replayed.
    """
    diagram, where, origin = diagram_of(trial, source)
    add_recorder(trial, diagram)
    schedule = compile_diagram(where, diagram)
    if width is not None:
        schedule = changed(schedule, **everything(schedule))
    live_changes(trial, schedule)  # refuses before anything starts
    comparison = ReplayComparison(trial.signals, {column.path: asdict(column) for column in schedule.recorded})
    feed = Feed(trial, schedule.buses, EXTERNAL_ENDS, comparison.add_recorded)
    last_tick = (trial.end or {}).get("last_tick")
    request = Request(
        Path(where),
        fast=True,
        duration=None if last_tick is None else (last_tick + 1) / trial.about["rate"],  # for the status line
        record=None if folder is None else Path(folder),
        no_record=folder is None,
    )
    prepared = Prepared(request, diagram, schedule, None, None, -1, feed=feed, subject=subject_of(trial))
    metadata = {**trial.about["metadata"], **origin, "replay_of": trial.path.name}
    try:
        result = ReplaySession(prepared, trial, comparison, metadata).carry_out()
    except RecorderError as error:
        raise BadInput(str(error)) from None
    outcome = raise_if_ended_by_signal(result.outcome)
    if result.recording["problems"]:
        raise BadInput(result.recording["problems"][0])
    files = [entry["path"] for entry in result.recording["files"]]
    feed.skip_rest()
    if folder is not None:
        add_recording(comparison, next(name for name in files if name.endswith(".mcap")))
    recorded: Any = trial.diagram or {}
    unchanged = computation(recorded) == computation(json.loads(to_json(diagram)))
    compared = comparison.result(order(schedule))
    frames = comparison.recorded.frame_count
    replayed = Replayed(
        trial, source, unchanged, outcome, compared, comparison.frame, frames, files, feed.fault, feed.end
    )
    if width is not None:
        culprit = diagram.blocks.get(feed.end.get("culprit") or outcome.culprit or "")
        replayed.context = tuple(inputs_and_outputs(result, culprit, width))
    return replayed


def add_recording(comparison: ReplayComparison, path: str | Path) -> None:
    """Compare the recording of the replay. path : path of its .mcap file"""
    with Progress("comparing") as progress:
        recording = Trial(path)
        progress(0.1)
        for batch in recording.batches():
            sent = batch.frames[batch.frames["sent"] != 0]
            comparison.add_replayed(batch.rows, payloads(sent), sent["row"])


def check(trial: Trial) -> None:
    """Raise BadInput if inputs of the run are missing from the recording."""
    if trial.about.get("part", 1) > 1:
        raise BadInput(
            f"{trial.path} is part {trial.about['part']} of a recording, which begins in part 1: replay part 1"
        )
    if trial.gaps:
        raise BadInput(f"{trial.trouble}, so it cannot be replayed: the inputs of these ticks are missing")
    dropped = (trial.end or {}).get("statistics", {}).get("dropped", 0)
    if dropped:
        raise BadInput(f"{trial.path}: {dropped} records were dropped during the run, so it cannot be replayed")
    if not len(trial):
        raise BadInput(f"{trial.path} contains no ticks")


def order(schedule: Schedule) -> list[str]:
    """Return the paths of the recorded signals in order of computation, devices last.

    The received values of a device are equal by construction, and its sent values are effects of other signals.
    """
    devices = {device.name for device in schedule.devices}
    place = {
        column.path: (column.path.rpartition(".")[0] in devices, int(slot))
        for slot, column in zip(schedule.columns, schedule.recorded)
    }
    return sorted(place, key=place.__getitem__)


def live_changes(trial: Trial, schedule: Schedule) -> list[tuple[int, int, float, float]]:
    """Return the live changes of a run: (tick, index of the live parameter, value, slew per second).

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
