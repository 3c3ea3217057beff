"""Torque of the actuators that a subject file caps, as the guardian reads it from the frames on the wires.

It does not use what the loop computes: a block of a diagram may compute anything. A command above the cap is not sent
where the guardian carries the bus, and the run ends at once. On every bus a measured torque above the cap and the
accuracy of the drive ends it after twice the time that the loop takes for that, so that the loop, which explains more,
comes first.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cext.safety.thresholds import EXCESS_TORQUE, EXCESS_TORQUE_REPLIES

if TYPE_CHECKING:
    from collections.abc import Iterable
    from typing import Any

    from runtime.robot.guardian.plan_types import EncodedReply, PlanCap, PlanField, StopDevice

PATIENCE = 2  # times EXCESS_TORQUE
REQUEST = b"\xff" * 6  # with which the frames of MIT mode begin that command nothing, such as those that enable


class TorqueCaps:
    """Caps of the devices of a plan.

    excess : the first torque above its cap, as plain data for the verdict of the guardian; None without one
    """

    def __init__(self, devices: Iterable[StopDevice]) -> None:
        self.excess: dict[str, Any] | None = None
        self._caps: dict[int, list[tuple[str, PlanCap]]] = {}  # by bus
        self._since: dict[str, int] = {}  # ns of the first of consecutive replies above the cap
        self._replies: dict[str, int] = {}
        for device in devices:
            if device["cap"] is not None:
                self._caps.setdefault(device["bus"], []).append((device["name"], device["cap"]))

    def buses(self) -> list[int]:
        """Return the buses with capped devices."""
        return list(self._caps)

    def replies_on(self, bus: int) -> list[EncodedReply]:
        """Return the frames of a bus with a measured torque."""
        return [each for _, cap in self._caps.get(bus, ()) if cap["measured"] for each in cap["measured"]["frames"]]

    def permits(self, bus: int, identifier: int, data: bytes) -> bool:
        """Return whether a frame to a device commands no torque above its cap. identifier : with flag bits"""
        for name, cap in self._caps.get(bus, ()):
            field = cap["commanded"]
            if field is not None and matches(field, identifier, data) and not data.startswith(REQUEST):
                torque = value_of(field, identifier, data)
                if abs(torque) > cap["torque"] + code_of(field):
                    self.excess = self.excess or {"device": name, "was": "commanded", "torque": torque} | words(cap)
                    return False
        return True

    def measure(self, bus: int, identifier: int, data: bytes, arrival: int) -> None:
        """Judge a received frame. arrival : ns of CLOCK_MONOTONIC"""
        for name, cap in self._caps.get(bus, ()):
            field = cap["measured"]
            if field is None or not matches(field, identifier, data):
                continue
            torque = value_of(field, identifier, data)
            if abs(torque) <= cap["torque"] + cap["accuracy"]:
                self._since.pop(name, None)
                self._replies[name] = 0
                continue
            self._replies[name] = self._replies.get(name, 0) + 1
            lasted = arrival - self._since.setdefault(name, arrival)
            if lasted >= PATIENCE * EXCESS_TORQUE and self._replies[name] >= EXCESS_TORQUE_REPLIES:
                self.excess = self.excess or {"device": name, "was": "measured", "torque": torque} | words(cap)


def words(cap: PlanCap) -> dict[str, Any]:
    """Return what a verdict contains of a cap."""
    return {"cap": cap["torque"], "source": cap["source"]}


def in_words(excess: dict[str, Any]) -> str:
    """Return the `excess` of a verdict as text."""
    return (
        f"{excess['was']} torque of {excess['device']}, {excess['torque']:.3g} N·m, above the {excess['cap']:.3g} N·m "
        f"of {excess['source']}"
    )


def matches(field: PlanField, identifier: int, data: bytes) -> bool:
    """Return whether a frame contains a field."""
    return len(data) * 8 >= field["first"] + field["bits"] and any(
        (identifier ^ wanted) & mask == 0 and data.startswith(bytes.fromhex(first))
        for wanted, mask, first in field["frames"]
    )


def value_of(field: PlanField, identifier: int, data: bytes) -> float:
    """Return the value of a field, whose bits count from the first of the data, or below 0 in the identifier."""
    first, bits = field["first"] + 32, field["bits"]
    code = int.from_bytes(identifier.to_bytes(4, "big") + data, "big") >> 32 + 8 * len(data) - first - bits
    code &= (1 << bits) - 1
    if field["signed"]:
        code ^= 1 << bits - 1
    return field["low"] + code * code_of(field)


def code_of(field: PlanField) -> float:
    """Return the value of one code of a field."""
    return (field["high"] - field["low"]) / ((1 << field["bits"]) - 1)
