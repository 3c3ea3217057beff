"""What a recording says of itself: in the sidecar file, in the flight log, and to the control process."""

import os
from datetime import datetime, timezone
from signal import Signals

from runtime.base.errors import BadInput
from runtime.base.exception_text import name_and_text
from runtime.recording.files import private

STILL_RECORDING = "still recording; if no process is, the recorder was killed, and the files stop where it did"


def outcome(recording, orphaned):
    """How it went, for the flight log: in virtual time nothing that another run of the same would not say, too."""
    facts = {
        "ended": ending(recording.end, orphaned),
        "end": recording.end,
        "ticks": recording.ticks,
        "first_tick": recording.first_tick,
        "last_tick": recording.last_tick,
        "events": recording.events,
        "problems": recording.problems,
    }
    return (
        facts
        if recording.plan["virtual"]
        else {**facts, "statistics": recording.page.statistics(), "wall": recording.page.wall}
    )


def describe(recording, orphaned):
    """Everything the report says besides what the services made."""
    plan, statistics = recording.plan, recording.page.statistics()
    wall = recording.page.wall
    return {
        "name": plan["name"],
        "stem": plan["stem"],
        "rate": plan["rate"],
        "duration": plan["duration"],
        "virtual": plan["virtual"],
        "simulated": plan["simulated"],
        "began": datetime.fromtimestamp(wall * 1e-9, timezone.utc).astimezone().isoformat() if wall else None,
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


def ending(end, orphaned):
    """How the run ended, in words."""
    if end is None:
        return "the control process died" if orphaned else "without a word"
    if end["status"] != "ok":
        return f"fault: {end['status']} at {end.get('culprit')}, tick {end.get('tick')}"
    if end.get("stopped"):
        return "stopped by the space bar"
    return f"stopped by {Signals(end['signal']).name}" if end.get("signal") else "ok"


def reason(error):
    """What an exception says, without the path and number that an OSError repeats."""
    if isinstance(error, FileExistsError):
        return f"{error.filename} is not a folder"
    if isinstance(error, BadInput):
        return str(error)
    if isinstance(error, OSError) and error.strerror:
        return f"{error.strerror}: {error.filename}" if error.filename else error.strerror
    return name_and_text(error)


PARTIAL = ".part"  # ending of a file until it is whole


def write_json(path, content):
    """Replace a JSON file at once. NaN and infinities become null, as JSON wants it."""
    import msgspec.json

    part = path + PARTIAL
    try:
        with open(part, "xb", opener=private) as file:
            file.write(msgspec.json.format(msgspec.json.encode(content), indent=2) + b"\n")
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, path)
    finally:
        if os.path.exists(part):
            os.unlink(part)
