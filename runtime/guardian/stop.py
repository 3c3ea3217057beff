"""Safe stop over wires: zero torque, then disable, repeated until every actuator has confirmed or time is up.

An actuator with `damp` is damped first, so that the joint does not give way under the wearer, with frames for the speed
in its replies.

Replies in the first round may belong to earlier commands and confirm nothing, since replies look alike.
"""

import math
import re
from types import SimpleNamespace

from cext.safety.speed_bands import SpeedBands
from cext.safety.thresholds import STOP_LIMIT, STOP_ROUND


class SafeStop:
    """One safe stop, step by step.

    devices : of the plan (runtime.guardian)
    wires : {index of the bus: wire of runtime.guardian.wires}
    now : ns of CLOCK_MONOTONIC at which it begins
    moving : whether the actuators may be under torque, and are damped if configured
    relays : runtime.guardian.relay.Relay, which keep the drives powered while any is damped

    due : ns of the next `step`
    """

    def __init__(self, devices, wires, now, moving=True, relays=()):
        self.relays = relays
        self.wires, self.began, self.due, self.ended = wires, now, now, None
        self.waiting = {device["name"]: device for device in devices if device["zero"] or device["disable"]}
        self.damped = {
            name: Damped(device["damp"], now)
            for name, device in self.waiting.items()
            if device["damp"] is not None and moving
        }
        self.disabling_due = now
        self.limit = STOP_LIMIT + max((damped.end - now for damped in self.damped.values()), default=0)
        self.asked = set()
        self.confirmed, self.heard, self.sent = set(), {}, 0
        self.order = list(self.waiting)

    @property
    def over(self):
        return self.ended is not None

    def step(self, now):
        """Send the due frames to devices that have not confirmed, and check whether the stop is complete."""
        if self.over:
            return
        if not self.waiting or now - self.began >= self.limit:
            self.ended = now
            return
        if now < self.due:
            return
        disabling = now >= self.disabling_due
        if disabling:
            self.damped = {name: damped for name, damped in self.damped.items() if now < damped.end}
            for relay in self.relays if self.damped else ():
                relay.change(now)
        for name, damped in self.damped.items():
            if now >= damped.due:
                self.send(self.waiting[name], damped.frames(now))
        if disabling:
            self.disable(now)
        self.due = min([self.disabling_due, *(damped.due for damped in self.damped.values())])

    def disable(self, now):
        """Send zero torque and disable to the devices that are not damped any more."""
        self.disabling_due = now + STOP_ROUND
        self.heard = dict.fromkeys(self.asked & self.waiting.keys(), 0)
        self.asked |= self.waiting.keys() - self.damped.keys()
        for name, device in self.waiting.items():
            if name not in self.damped:
                self.send(device, device["zero"] + device["disable"])

    def send(self, device, frames):
        wire = self.wires.get(device["bus"])
        for identifier, data in frames:
            if wire is not None and wire.send(identifier, data):
                self.sent += 1

    def receive(self, bus, identifier, data, now, since=None):
        """Handle a received frame other than an echo. since : ns of its earliest arrival; `now` by default"""
        for name, damped in self.damped.items():
            if self.waiting[name]["bus"] == bus:
                damped.bands.note_frame(identifier, data, now if since is None else since)
        for name, device in list(self.waiting.items()):
            if device["bus"] != bus or name not in self.heard or not is_reply(device, identifier, data):
                continue
            self.heard[name] += 1
            if self.heard[name] >= len(device["zero"]) + len(device["disable"]) - device.get("unanswered", 0):
                self.confirmed.add(name)
                del self.waiting[name]
            break
        if not self.waiting and not self.over:
            self.ended = now

    def report(self):
        """Return a dict with confirmed, unconfirmed (names), sent (frames) and took (s)."""
        return {
            "confirmed": [name for name in self.order if name in self.confirmed],
            "unconfirmed": list(self.waiting),
            "sent": self.sent,
            "took": ((self.ended or self.began) - self.began) * 1e-9,
        }


class Damped:
    """Damping of one device. end, due : ns of CLOCK_MONOTONIC at which it ends, and of the next frames"""

    def __init__(self, damp, now):
        velocity = damp["velocity"]
        field = (
            None
            if velocity is None
            else SimpleNamespace(
                **velocity
                | {
                    "frames": [
                        (wanted, mask, False, bytes.fromhex(first)) for wanted, mask, first in velocity["frames"]
                    ]
                }
            )
        )
        bands = [(speed, [(identifier, False, data) for identifier, data in frames]) for speed, frames in damp["bands"]]
        self.bands = SpeedBands(bands, round(damp["round"] * 1e9), damp["acceleration"], field)
        self.end, self.due = now + round(damp["duration"] * 1e9), now

    def frames(self, now):
        self.due = now + self.bands.round
        return self.bands.frames(now)


def decoded(device):
    """Convert a device of the plan: bytes for hex digits, and `speeds`, the replies with its velocity."""
    damp = device["damp"]
    if damp is not None:
        damp = damp | {
            "bands": [(math.inf if speed is None else speed, in_bytes(frames)) for speed, frames in damp["bands"]]
        }
    speeds = damp["velocity"]["frames"] if damp is not None and damp["velocity"] is not None else []
    return device | {
        "zero": in_bytes(device["zero"]),
        "disable": in_bytes(device["disable"]),
        "damp": damp,
        "speeds": speeds,
    }


def in_bytes(frames):
    return [(identifier, bytes.fromhex(data)) for identifier, data in frames]


def frames_of_stop(device):
    """Return every frame that a safe stop may send to a device, which are the only ones that pass the fence."""
    damping = [frame for _, frames in device["damp"]["bands"] for frame in frames] if device["damp"] is not None else []
    return device["zero"] + device["disable"] + damping


def is_reply(device, identifier, data):
    return any(
        identifier & mask == wanted & mask and re.match(begin, data.hex()) for wanted, mask, begin in device["replies"]
    )
