"""Safe stop over wires: zero torque, then disable, repeated until every actuator has confirmed or time is up.

An actuator with `damp` is damped first, so that the joint does not give way under the wearer, with frames for the speed
in its replies.

Replies in the first round may belong to earlier commands and confirm nothing, since replies look alike.
"""

from __future__ import annotations

import math
import re
from types import SimpleNamespace
from typing import TYPE_CHECKING

from cext.safety.speed_bands import SpeedBands
from cext.safety.thresholds import STOP_LIMIT, STOP_ROUND

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from runtime.guardian.plan_types import Frame, PlanDevice, StopDamp, StopDevice, StopReport
    from runtime.guardian.relay import Relay
    from runtime.guardian.wires import Wire


class SafeStop:
    """One safe stop, step by step.

    devices : of the plan (runtime.guardian)
    wires : {index of the bus: wire of runtime.guardian.wires}
    now : ns of CLOCK_MONOTONIC at which it begins
    moving : whether the actuators may be under torque, and are damped if configured
    relays : runtime.guardian.relay.Relay, which keep the drives powered while any is damped
    out : drives that were taken out of the run and are not damped: bit k for device k of the schedule

    due : ns of the next `step`
    """

    def __init__(
        self,
        devices: Iterable[StopDevice],
        wires: Mapping[int, Wire],
        now: int,
        moving: bool = True,
        relays: Iterable[Relay] = (),
        out: int = 0,
    ) -> None:
        self.relays = relays
        self.wires, self.began, self.due, self.ended = wires, now, now, None
        self.waiting = {device["name"]: device for device in devices if device["zero"] or device["disable"]}
        self.damped = {
            name: Damped(device["damp"], now)
            for name, device in self.waiting.items()
            if device["damp"] is not None and moving and not out >> device["number"] & 1
        }
        self.disabling_due = now
        self.limit = STOP_LIMIT + max((damped.end - now for damped in self.damped.values()), default=0)
        self.disabled = set()
        self.confirmed, self.reply_counts, self.sent = set(), {}, 0
        self.order = list(self.waiting)

    @property
    def over(self) -> bool:
        """Whether the stop has ended: every device has confirmed, or time is up."""
        return self.ended is not None

    def step(self, now: int) -> None:
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
                relay.change()
        for name, damped in self.damped.items():
            if now >= damped.due:
                self._send(self.waiting[name], damped.frames(now))
        if disabling:
            self._disable(now)
        self.due = min([self.disabling_due, *(damped.due for damped in self.damped.values())])

    def _disable(self, now):
        """Send zero torque and disable to the devices that are not damped any more."""
        self.disabling_due = now + STOP_ROUND
        self.reply_counts = dict.fromkeys(self.disabled & self.waiting.keys(), 0)
        self.disabled |= self.waiting.keys() - self.damped.keys()
        for name, device in self.waiting.items():
            if name not in self.damped:
                self._send(device, device["zero"] + device["disable"])

    def _send(self, device, frames):
        """Send frames to a device."""
        wire = self.wires.get(device["bus"])
        for identifier, data in frames:
            if wire is not None and wire.send(identifier, data):
                self.sent += 1

    def receive(self, bus: int, identifier: int, data: bytes, now: int, since: int | None = None) -> None:
        """Handle a received frame other than an echo.

        bus : index in the plan
        identifier : with the flag bits of struct can_frame
        now, since : ns of CLOCK_MONOTONIC, now and of its earliest arrival; `now` by default
        """
        for name, damped in self.damped.items():
            if self.waiting[name]["bus"] == bus:
                damped.bands.note_frame(identifier, data, now if since is None else since)
        for name, device in list(self.waiting.items()):
            if device["bus"] != bus or name not in self.reply_counts or not _is_reply(device, identifier, data):
                continue
            self.reply_counts[name] += 1
            if self.reply_counts[name] >= len(device["zero"]) + len(device["disable"]) - device.get("unanswered", 0):
                self.confirmed.add(name)
                del self.waiting[name]
            break
        if not self.waiting and not self.over:
            self.ended = now

    def report(self) -> StopReport:
        """Return which devices have confirmed, the number of frames sent, and the duration."""
        return {
            "confirmed": [name for name in self.order if name in self.confirmed],
            "unconfirmed": list(self.waiting),
            "sent": self.sent,
            "took": ((self.ended or self.began) - self.began) * 1e-9,
        }


class Damped:
    """Damping of one device. end, due : ns of CLOCK_MONOTONIC at which it ends, and of the next frames"""

    def __init__(self, damp: StopDamp, now: int) -> None:
        velocity = damp["velocity"]
        field = (
            None
            if velocity is None
            else SimpleNamespace(
                **velocity
                | {"frames": [(reply, mask, False, bytes.fromhex(first)) for reply, mask, first in velocity["frames"]]}
            )
        )
        bands = [(speed, [(identifier, False, data) for identifier, data in frames]) for speed, frames in damp["bands"]]
        self.bands = SpeedBands(bands, round(damp["round"] * 1e9), damp["acceleration"], field)
        self.end, self.due = now + round(damp["duration"] * 1e9), now

    def frames(self, now: int) -> list[tuple[int, bytes]]:
        """Return the frames for the present speed, and schedule the next. now : ns of CLOCK_MONOTONIC"""
        self.due = now + self.bands.round
        return self.bands.frames(now)


def decoded(device: PlanDevice) -> StopDevice:
    """Convert a device of the plan: bytes for hex digits, and `speeds`, the replies with its velocity."""
    damp: StopDamp | None = None
    if device["damp"] is not None:
        bands = device["damp"]["bands"]
        damp = {
            **device["damp"],
            "bands": [(math.inf if speed is None else speed, _in_bytes(frames)) for speed, frames in bands],
        }
    speeds = damp["velocity"]["frames"] if damp is not None and damp["velocity"] is not None else []
    return {
        **device,
        "zero": _in_bytes(device["zero"]),
        "disable": _in_bytes(device["disable"]),
        "damp": damp,
        "speeds": speeds,
    }


def _in_bytes(frames):
    """Convert frames of the plan to (identifier, data)."""
    return [(identifier, bytes.fromhex(data)) for identifier, data in frames]


def frames_of_stop(device: StopDevice) -> list[Frame]:
    """Return every frame that a safe stop may send to a device, which are the only ones that pass the fence."""
    damping = [frame for _, frames in device["damp"]["bands"] for frame in frames] if device["damp"] is not None else []
    return device["zero"] + device["disable"] + damping


def _is_reply(device, identifier, data):
    """Return whether a frame is a reply of a device to the safe stop."""
    return any(
        identifier & mask == reply & mask and re.match(begin, data.hex()) for reply, mask, begin in device["replies"]
    )
