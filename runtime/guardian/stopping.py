"""The safe stop over wires: zero torque, then disable, again and again until every actuator has confirmed or time is up.

An actuator that is to be damped first, so that no joint drops its wearer, is damped for its time before that.

Answers look alike. Those in the first round may be to what was commanded before, so that they confirm nothing.
"""

import re

from cext.thresholds import STOP_LIMIT, STOP_ROUND


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
        self.damping = {name: round(device["damp_time"] * 1e9) * moving for name, device in self.waiting.items()}
        self.limit = STOP_LIMIT + max(self.damping.values(), default=0)
        self.asked = set()
        self.confirmed, self.heard, self.sent = set(), {}, 0
        self.order = list(self.waiting)

    @property
    def over(self):
        return self.ended is not None

    def step(self, now):
        """Send the next round to those that have not confirmed; see whether all is done."""
        if self.over:
            return
        if not self.waiting or now - self.began >= self.limit:
            self.ended = now
            return
        if now < self.due:
            return
        self.due = now + STOP_ROUND
        damped = {name for name in self.waiting if now - self.began < self.damping[name]}
        for relay in self.relays if damped else ():
            relay.change(now)
        self.heard = dict.fromkeys(self.asked & self.waiting.keys(), 0)
        self.asked |= self.waiting.keys() - damped
        for name, device in self.waiting.items():
            wire = self.wires.get(device["bus"])
            for identifier, data in device["damp"] if name in damped else device["zero"] + device["disable"]:
                if wire is not None and wire.send(identifier, data):
                    self.sent += 1

    def hear(self, bus, identifier, data, now):
        """A frame that is no echo."""
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
            "confirmed": [name for name in self.order if name in self.confirmed], "unconfirmed": list(self.waiting), "sent": self.sent,
            "took": ((self.ended or self.began) - self.began) * 1e-9}


def is_reply(device, identifier, data):
    return any(identifier & mask == wanted & mask and re.match(begin, data.hex()) for wanted, mask, begin in device["replies"])
