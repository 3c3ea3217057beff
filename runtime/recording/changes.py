"""What the mailbox has brought, out of the ring, as the events that the sidecar file keeps.

    {"event": "set", "path": "left/impedance.stiffness", "value": 45.0, "from": 30.0, "tick": 812, "by": "keys"}
    {"event": "mark", "number": 1, "tick": 1004, "by": "keys"}
    {"event": "stop", "tick": 1200, "by": "keys"}

and "confirm" and "rearm", which have armed the robot, likewise.

`tick` is the one at whose start it took effect, -1 while arming; `by` is "keys", "replay", or "set" and the number of
the process. A change that was a ramp has its `slew`, in unit per second: from `from` on, each tick went by slew · dt at
most, dt being the time since the tick before.
"""

import math

from runtime.recording.format import CHANGE

SET, MARK, STOP, CONFIRM, REARM = range(5)
ASKED = {STOP: "stop", CONFIRM: "confirm", REARM: "rearm"}
ORIGINS = {1: "keys", 2: "replay"}


class Changes:
    """parameters : the page's live ones, in their order"""

    def __init__(self, parameters):
        self.parameters = parameters

    def events(self, payload):
        """The events of one record of the ring."""
        for tick, kind, origin, writer, index, value, before, slew in CHANGE.iter_unpack(payload):
            when = {"tick": tick, "by": ORIGINS.get(origin) or f"set {writer}"}
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
