"""Safe stop over wires: zero torque, then disable, repeated until every actuator has confirmed or time is up.

An actuator with `damp` is damped first, so that the joint does not give way under the wearer, with frames for the speed
in its replies. After STOP_LIMIT the stop is reported, and continues at a falling rate for actuators whose bus returns.
"""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import TYPE_CHECKING

from cext.safety.speed_bands import SpeedBands
from cext.safety.stop_confirmation import StopConfirmation
from cext.safety.thresholds import STOP_LIMIT, STOP_ROUND, STOP_ROUND_MAXIMUM

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from runtime.robot.guardian.plan_types import (
        EncodedReply,
        Frame,
        PlanDevice,
        PlanField,
        PlanReply,
        StopDamp,
        StopDevice,
        StopReport,
    )
    from runtime.robot.guardian.relay import Relay
    from runtime.robot.guardian.wires import Wire


class SafeStop:
    """One safe stop, step by step.

    devices : devices in the plan (runtime.robot.guardian)
    wires : {index of the bus: wire of runtime.robot.guardian.wires}
    now : ns of CLOCK_MONOTONIC at which it begins
    moving : whether the actuators may be under torque, and are damped if configured
    relays : runtime.robot.guardian.relay.Relay, which keep the drives powered while any is damped
    out : drives that were taken out of the run and are not damped: bit k for device k of the schedule
    lasts : ns after STOP_LIMIT for which it continues

    due : ns of the next `step`
    failing : buses over which the newest frame could not be sent
    lent, given : buses that another run takes over, and those whose drives it asks
    """

    def __init__(
        self,
        devices: Iterable[StopDevice],
        wires: Mapping[int, Wire],
        now: int,
        moving: bool = True,
        relays: Iterable[Relay] = (),
        out: int = 0,
        lasts: int = 0,
    ) -> None:
        self.relays = relays
        self.wires, self.began, self.due, self.ended = wires, now, now, None
        self.stopped = {device["name"]: device for device in devices if device["zero"] or device["disable"]}
        self.confirmations = {name: _confirmation(device, now) for name, device in self.stopped.items()}
        self.damped = {
            name: Damped(device["damp"], now)
            for name, device in self.stopped.items()
            if device["damp"] is not None and moving and not out >> device["number"] & 1
        }
        self.disabling_due, self.round = now, STOP_ROUND
        self.limit = STOP_LIMIT + max((damped.end - now for damped in self.damped.values()), default=0)
        self.lasts = lasts
        self.sent, self.confirmed_at, self.newest = 0, {}, now
        self.failing: set[int] = set()
        self.lent: set[int] = set()
        self.given: set[int] = set()

    @property
    def over(self) -> bool:
        """Whether the stop has ended: every device has confirmed, or time is up."""
        return self.ended is not None

    def is_due(self, now: int) -> bool:
        """Return whether it is to be reported: it is over, or the time of every device to confirm is."""
        return self.over or now - self.began >= self.limit

    def milliseconds(self, now: int, limit: int) -> int:
        """Return the time to the next `step`, rounded up. now : ns of CLOCK_MONOTONIC; limit : largest, in ns"""
        due = min(self.due, self.began + self.limit + self.lasts)
        return max(0, -(-min(due - now, limit) // 1_000_000))

    @property
    def waiting(self) -> list[str]:
        """Names of the devices that have not confirmed."""
        return [name for name, confirmation in self.confirmations.items() if not confirmation.confirmed]

    @property
    def lost(self) -> set[int]:
        """Buses over which the frames for devices that have not confirmed cannot be sent: their adapter may return."""
        return {self.stopped[name]["bus"] for name in self.waiting} & (self.failing - self.lent)

    def step(self, now: int) -> None:
        """Send the due frames to devices that have not confirmed, and check whether the stop is complete."""
        if self.over:
            return
        self.newest = now
        if now >= self.disabling_due:
            self._judge(now)
        elsewhere = all(self.stopped[name]["bus"] in self.given for name in self.waiting)
        if elsewhere or now - self.began >= self.limit + self.lasts:
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
                self._send(self.stopped[name], damped.frames(now))
        if disabling:
            self._disable(now)
        self.due = min([self.disabling_due, *(damped.due for damped in self.damped.values())])

    def _judge(self, now):
        """Judge the replies of every device at the end of a round."""
        for name, confirmation in self.confirmations.items():
            if name not in self.damped and confirmation.judge(now, self.round):
                self.confirmed_at.setdefault(name, now)
            else:
                self.confirmed_at.pop(name, None)

    def _disable(self, now):
        """Send zero torque and disable to the devices that are not damped any more and have not confirmed."""
        if now - self.began >= self.limit:
            self.round = min(2 * self.round, STOP_ROUND_MAXIMUM)
        self.disabling_due = now + self.round
        for name, device in self.stopped.items():
            confirmation = self.confirmations[name]
            if device["bus"] in self.lent:
                continue
            if name not in self.damped and not confirmation.confirmed and confirmation.may_send():
                self._send(device, device["zero"] + device["disable"])
                confirmation.sent(now, len(device["zero"]) + len(device["disable"]) - device["unanswered"])

    def _send(self, device, frames):
        """Send frames to a device."""
        wire = self.wires.get(device["bus"])
        for identifier, data in frames:
            sent = wire is not None and wire.send(identifier, data)
            self.sent += sent
            (self.failing.discard if sent else self.failing.add)(device["bus"])

    def receive(self, bus: int, identifier: int, data: bytes, now: int, since: int | None = None) -> None:
        """Handle a received frame other than an echo.

        bus : index in the plan
        identifier : identifier with the flag bits of struct can_frame
        now, since : ns of CLOCK_MONOTONIC, now and of its earliest arrival; `now` by default
        """
        for name, damped in self.damped.items():
            if self.stopped[name]["bus"] == bus:
                damped.bands.note_frame(identifier, data, now if since is None else since)
        for name, device in self.stopped.items():
            if device["bus"] == bus and self.confirmations[name].note_frame(identifier, data, now):
                break

    def report(self) -> StopReport:
        """Return which devices have confirmed, and when they were due; the number of frames sent, and the duration."""
        waiting = self.waiting
        return {
            "confirmed": [name for name in self.stopped if name not in waiting],
            "unconfirmed": waiting,
            "after": {name: round((at - self.began) * 1e-9, 3) for name, at in self.confirmed_at.items()},
            "due": round(self.limit * 1e-9, 3),
            "sent": self.sent,
            "took": ((self.ended or self.newest) - self.began) * 1e-9,
        }


class Damped:
    """Damping of one device. end, due : ns of CLOCK_MONOTONIC at which it ends, and of the next frames"""

    def __init__(self, damp: StopDamp, now: int) -> None:
        bands = [(speed, [(identifier, False, data) for identifier, data in frames]) for speed, frames in damp["bands"]]
        velocity = _field(damp["velocity"])
        self.bands = SpeedBands(
            bands, round(damp["round"] * 1e9), damp["acceleration"], velocity, round(damp["transit"] * 1e9)
        )
        self.end, self.due = now + round(damp["duration"] * 1e9), now

    def frames(self, now: int) -> list[tuple[int, bytes]]:
        """Return the frames for the present speed, and schedule the next. now : ns of CLOCK_MONOTONIC"""
        self.due = now + self.bands.round
        return self.bands.frames(now)


def _confirmation(device: StopDevice, now: int) -> StopConfirmation:
    """Return the StopConfirmation of a device. now : ns of CLOCK_MONOTONIC at which the stop begins"""
    reply = device["stop_reply"]
    confirmation = StopConfirmation(
        None
        if reply is None
        else SimpleNamespace(
            **reply
            | {
                "frames": _patterns(reply["frames"]),
                "unasked": _patterns(reply["unasked"]),
                "torque": _field(reply["torque"]),
                "enabled": _field(reply["enabled"]),
            }
        )
    )
    confirmation.begin(now)
    return confirmation


def _field(field: PlanField | None) -> SimpleNamespace | None:
    """Return a field of the plan with the attributes of a graph.ReplyField."""
    return None if field is None else SimpleNamespace(**field | {"frames": _patterns(field["frames"])})


def _patterns(frames: Iterable[EncodedReply]) -> list[tuple[int, int, bool, bytes]]:
    """Return replies of the plan as the frames of a graph.ReplyField; the identifiers keep their flag bits."""
    return [(identifier, mask, False, bytes.fromhex(first)) for identifier, mask, first in frames]


def decoded(device: PlanDevice) -> StopDevice:
    """Convert a device of the plan: bytes for hex digits."""
    damp: StopDamp | None = None
    if device["damp"] is not None:
        bands = device["damp"]["bands"]
        damp = {
            **device["damp"],
            "bands": [(math.inf if speed is None else speed, _in_bytes(frames)) for speed, frames in bands],
        }
    return {**device, "zero": _in_bytes(device["zero"]), "disable": _in_bytes(device["disable"]), "damp": damp}


def replies_of(devices: Iterable[StopDevice], bus: int) -> list[EncodedReply]:
    """Return the frames of the devices on a bus that a safe stop reads. bus : index in the plan"""
    replies: list[EncodedReply] = []
    for device in devices:
        if device["bus"] == bus:
            reply: PlanReply | None = device["stop_reply"]
            replies += [] if reply is None else [*reply["frames"], *reply["unasked"]]
            velocity = device["damp"]["velocity"] if device["damp"] is not None else None
            replies += [] if velocity is None else velocity["frames"]
    return replies


def _in_bytes(frames):
    """Convert frames of the plan to (identifier, data)."""
    return [(identifier, bytes.fromhex(data)) for identifier, data in frames]


def frames_of_stop(device: StopDevice) -> list[Frame]:
    """Return every frame that a safe stop may send to a device, which are the only ones that pass the fence."""
    damping = [frame for _, frames in device["damp"]["bands"] for frame in frames] if device["damp"] is not None else []
    return device["zero"] + device["disable"] + damping
