"""Requests to a run that took effect, read from the ring, as events of the sidecar file.

    {"event": "set", "path": "left/impedance.stiffness", "value": 45.0, "from": 30.0, "tick": 812, "by": "keys"}
    {"event": "mark", "number": 1, "tick": 1004, "by": "keys"}
    {"event": "stop", "tick": 1200, "by": "keys"}

    {"event": "note", "number": 1, "tick": 1004, "by": "page 2", "text": "new shoes"}

"confirm" and "rearm", which armed the robot, have the form of "stop".

`tick` is the tick at whose start the change took effect, -1 while arming; `by` is "keys", "page" and the number of
a page of the panel, "replay", "set" and the ID of the process, or "step" of runtime.simulate. A change that was a ramp
has its `slew` in units per second: each tick changed the value by slew · dt at most, where dt is the time since the
previous tick.
"""

import math
from collections.abc import Iterator
from typing import Any

from runtime.record.storage.format import CHANGE

SET, MARK, STOP, CONFIRM, REARM = range(5)
ASKED = {STOP: "stop", CONFIRM: "confirm", REARM: "rearm"}
ORIGINS = {0: "set {}", 1: "keys", 2: "replay", 3: "page {}"}


def stopped_by(origin: str) -> str:
    """Return what has stopped a run as text. origin : as in cext.schedule.outcome.Outcome.stopped"""
    if origin.startswith("page "):
        return f"stopped by {origin} of the panel"
    return f"stopped by {'the space bar' if origin == 'keys' else 'process ' + origin.removeprefix('set ')}"


class Changes:
    """Decoder of changes. parameters : live parameters of the run, in the order of the shared state"""

    def __init__(self, parameters: Any) -> None:
        self.parameters = parameters

    def events(self, payload: bytes) -> Iterator[dict[str, Any]]:
        """Yield the events of one record of the ring. payload : bytes"""
        for tick, kind, origin, writer, index, value, before, slew in CHANGE.iter_unpack(payload):
            when = {"tick": tick, "by": ORIGINS.get(origin, ORIGINS[0]).format(writer)}
            if kind == SET:
                parameter = self.parameters[index]
                event = {
                    "event": "set",
                    "path": parameter.path,
                    "value": parameter.plain(value),
                    "from": parameter.plain(before),
                    **when,
                }
                yield event | ({"slew": slew} if math.isfinite(slew) else {})
            elif kind == MARK:
                yield {"event": "mark", "number": int(value), **when}
            else:
                yield {"event": ASKED[kind], **when}


def event_text(event: dict[str, Any]) -> str:
    """Return an event as text, "" for one that is not shown."""
    kind = event.get("event")
    if kind in ("fault", "end"):
        culprit = f" at {event['culprit']}" if event.get("culprit") else ""
        return f"{kind}: {event.get('status')}{culprit}, tick {event.get('tick')}"
    if kind == "warning":
        return f"{event['device']}: {event['what']}"
    if kind == "mark":
        return f"mark {event['number']}"
    if kind == "note":
        return f"mark {event['number']}: {event['text']}"
    return f"{event['path']} set to {event['value']:g}" if kind == "set" else ""
