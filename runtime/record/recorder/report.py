"""The report of a recording: for the sidecar file, the flight log and the control process."""

from __future__ import annotations

from datetime import datetime, timezone
from signal import Signals
from typing import Any

from cext.user_text import name_and_text
from runtime.host.errors import BadInput
from runtime.host.replaced_file import replacement
from runtime.record.storage.changes import stopped_by
from runtime.record.storage.files import private
from runtime.record.storage.provenance import optional

STILL_RECORDING = "still recording; if no recorder process runs, the recorder was killed and the files end there"


def outcome(recording: Any, orphaned: bool) -> dict[str, Any]:
    """Return the end of a run for the flight log; in virtual time only values that every equal run reproduces."""
    facts = {
        "ended": ending(recording.end, orphaned),
        "end": recording.end,
        "ticks": recording.ticks,
        "first_tick": recording.first_tick,
        "last_tick": recording.last_tick,
        "events": recording.events,
        "problems": recording.problems,
    }
    if recording.plan["virtual"]:
        return facts
    shared = recording.shared
    monotonic = shared.began + shared.first_tick  # of tick 0
    return {**facts, "statistics": shared.statistics(), "wall": shared.wall, "monotonic": monotonic}


def describe(recording: Any, orphaned: bool) -> dict[str, Any]:
    """Return the report without the results of the services."""
    plan, statistics = recording.plan, recording.shared.statistics()
    wall = recording.shared.wall
    return {
        "name": plan["name"],
        "stem": plan["stem"],
        "rate": plan["rate"],
        "duration": plan["duration"],
        "virtual": plan["virtual"],
        "simulated": plan["simulated"],
        "began": optional(local_time, wall) if wall else None,
        "ended": ending(recording.end, orphaned),
        "end": recording.end,
        "ticks": recording.ticks,
        "first_tick": recording.first_tick,
        "last_tick": recording.last_tick,
        "missed": statistics["missed"],
        "dropped": statistics["dropped"],
        "statistics": statistics,
        "events": recording.events,
        "events_left_out": recording.events_left_out,
        "sinks": recording.sinks,
        "files": recording.list_files(),
        "problems": recording.problems,
        **recording.about,
        "control_pid": plan.get("control_pid"),
    }


def local_time(wall: int) -> str:
    """Return a time as text, with the local offset. wall : ns since 1970. Raises ValueError for an unusable TZ"""
    return datetime.fromtimestamp(wall * 1e-9, timezone.utc).astimezone().isoformat()


def ending(end: dict[str, Any] | None, orphaned: bool) -> str:
    """Return how the run ended, as text."""
    if end is None:
        return "the control process died" if orphaned else "without an end event"
    if end["status"] != "ok":
        where = f" at {end['culprit']}" if end.get("culprit") else ""
        return f"fault: {end['status']}{where}, tick {end.get('tick')}"
    if end.get("stopped"):
        return stopped_by(end["stopped"])
    return f"stopped by {Signals(end['signal']).name}" if end.get("signal") else "ok"


def reason(error: BaseException) -> str:
    """Return the text of an exception, for an OSError without number and repeated path."""
    if isinstance(error, FileExistsError):
        return f"{error.filename} is not a folder"
    if isinstance(error, BadInput):
        return str(error)
    if isinstance(error, OSError) and error.strerror:
        return f"{error.strerror}: {error.filename}" if error.filename else error.strerror
    return name_and_text(error)


PARTIAL = ".part"  # suffix of an incomplete file


def write_json(path: str, content: Any, durable: bool = True) -> None:
    """Replace a JSON file atomically. NaN and infinities become null.

    durable : whether to wait for the disk
    """
    import msgspec.json

    with replacement(path, private, durable, path + PARTIAL) as file:
        file.write(msgspec.json.format(msgspec.json.encode(content), indent=2) + b"\n")
