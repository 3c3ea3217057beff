"""The safe stop over wires: zero torque, then disable, again and again until every actuator has confirmed or time is
up.

An actuator with `damp` is damped for its time before that, so that no joint drops its wearer: by frames for the speed
that its replies report.

Answers look alike. Those in the first round may be to what was commanded before, so that they confirm nothing.
"""

import math
import re
from types import SimpleNamespace

from cext.safety.speed_bands import SpeedBands
from cext.safety.thresholds import STOP_LIMIT, STOP_ROUND


class SafeStop:
    """One safe stop, step by step.

    devices : of the plan (runtime.guardian)
    wires : {index of the bus: wire}, as runtime.guardian.wires has them
    now : ns, CLOCK_MONOTONIC at which it begins
    moving : whether they may have been under torque, and are damped where they should be
    relays : runtime.guardian.relay.Relay, which hold the power of the drives while any is damped

    due : ns at which `step` has something to do next
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
        """Send what is due to those that have not confirmed; see whether all is done."""
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
        """A round of zero torque and disable to those that are not damped any more."""
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

    def hear(self, bus, identifier, data, now, since=None):
        """A frame that is no echo, which is read now. since : ns from which on it may have arrived; `now` by default"""
        for name, damped in self.damped.items():
            if self.waiting[name]["bus"] == bus:
                damped.bands.hear(identifier, data, now if since is None else since)
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
        """confirmed, unconfirmed : names; sent : frames; took : s"""
        return {
            "confirmed": [name for name in self.order if name in self.confirmed],
            "unconfirmed": list(self.waiting),
            "sent": self.sent,
            "took": ((self.ended or self.began) - self.began) * 1e-9,
        }


class Damped:
    """The damping of one device. end, due : ns, CLOCK_MONOTONIC: when it is over, and of the next frames"""

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
    """A device of the plan with bytes in place of their hex digits, and `speeds`: the replies that carry its
    velocity.
    """
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
    """Every frame that a safe stop may send to a device: the only ones that pass the fence."""
    damping = [frame for _, frames in device["damp"]["bands"] for frame in frames] if device["damp"] is not None else []
    return device["zero"] + device["disable"] + damping


def is_reply(device, identifier, data):
    return any(
        identifier & mask == wanted & mask and re.match(begin, data.hex()) for wanted, mask, begin in device["replies"]
    )
