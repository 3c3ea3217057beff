"""Interfaces of the buses of a plan: their wires, and the descriptors at which their frames are awaited."""

from __future__ import annotations

import select
import time
from contextlib import suppress
from typing import TYPE_CHECKING

from cext.safety.thresholds import STOP_ROUND_MAXIMUM
from runtime.robot.guardian.stop import replies_of
from runtime.robot.guardian.wires import FRAMES_AT_ONCE, CannotOpen, Wire, open_wire

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cext.ring.rings import Lines
    from runtime.robot.guardian.plan_types import PlanBus, StopDevice
    from runtime.robot.guardian.stop import SafeStop
    from runtime.robot.guardian.torque import TorqueCaps


class Interfaces:
    """Interfaces of the buses of a plan.

    buses : buses of the plan
    devices : devices whose replies are received on a bus that the loop drives
    poll : select.poll that waits for frames, and for others
    lines : rings to the loop, which gets the frames of buses that have a line; None if it drives every bus itself
    caps : TorqueCaps, which judge every received frame, or None

    wires : {index of a bus: Wire}
    polled : indexes of buses that have no descriptor to wait for
    unread : indexes of buses of which more frames may be at hand
    """

    def __init__(
        self,
        buses: Sequence[PlanBus],
        devices: Sequence[StopDevice],
        poll: select.poll,
        lines: Lines | None = None,
        caps: TorqueCaps | None = None,
    ) -> None:
        self.caps = caps
        self.buses, self.devices, self.poll, self.lines = buses, devices, poll, lines
        self.wires: dict[int, Wire] = {}
        self.polled: set[int] = set()
        self.unread: set[int] = set()
        self._places: dict[int, int] = {}  # index of a bus, by the descriptor
        self._drained: dict[int, int] = {}  # ns, by the index: everything older has been read
        self._open_again = 0  # ns at which to open lost interfaces again

    def add(self, index: int, wire: Wire) -> None:
        """Let a wire be the interface of a bus, and receive from it. index : index of the bus in the plan"""
        self.wires[index] = wire
        self.listen(index)

    def listen(self, index: int) -> None:
        """Receive from the interface of a bus from here on; the replies to a safe stop if the loop drives the bus."""
        wire = self.wires[index]
        if self.buses[index]["line"] is None:
            wire.listen(replies_of(self.devices, index) + (self.caps.replies_on(index) if self.caps else []))
        descriptor = wire.fileno()
        if descriptor is not None:
            self._places[descriptor] = index
            self.poll.register(descriptor, select.POLLIN)
        elif wire.polled:
            self.polled.add(index)

    def wait(self, milliseconds: int | None, stop: SafeStop | None) -> list[int]:
        """Wait for an event, and receive. Returns the other descriptors with an event.

        stop : safe stop in progress, or None
        """
        for index in self.polled | self.unread:
            self.receive(index, stop)
        if self.polled or self.unread:
            milliseconds = 0 if self.unread else 1
        others = []
        for descriptor, event in self.poll.poll(milliseconds):
            index = self._places.get(descriptor)
            if index is None:
                others.append(descriptor)
                continue
            self.receive(index, stop)
            carried = self.buses[index]["line"] is not None  # a SocketCAN interface that is down is readable later
            if event & (select.POLLHUP | select.POLLNVAL) or carried and not event & select.POLLIN:
                self._unregister(index)
                self.wires[index].fail(0, "the interface has hung up")
        return others

    def receive(self, index: int, stop: SafeStop | None) -> None:
        """Pass received frames to a safe stop, and to the loop on a bus with a line.

        Frames that arrived before the stop began do not belong to it.
        """
        before, line = time.monotonic_ns(), self.buses[index]["line"]
        frames = self.wires[index].receive()
        now = time.monotonic_ns()
        for identifier, data, arrival, flags in frames:
            if self.lines is not None and line is not None:
                self.lines.give(line, identifier, data, arrival, flags)
            if self.caps is not None:
                self.caps.measure(index, identifier, data, arrival)
            if stop is not None and arrival >= stop.began:
                stop.receive(index, identifier, data, now, max(stop.began, self._drained.get(index, 0)))
        if len(frames) < FRAMES_AT_ONCE:
            self._drained[index] = before
            self.unread.discard(index)
        else:
            self.unread.add(index)

    def open_lost(self, stop: SafeStop, now: int) -> None:
        """Open the interfaces again over which a safe stop cannot send, as their adapter may have returned.

        now : ns of CLOCK_MONOTONIC
        """
        if now < self._open_again:
            return
        self._open_again = now + STOP_ROUND_MAXIMUM
        for index in stop.lost:
            with suppress(CannotOpen):
                again = open_wire(self.buses[index], again=True)
                self.close(index)
                self.add(index, again)

    def close(self, index: int) -> None:
        """Close the interface of a bus."""
        if index in self.wires:
            self._unregister(index)
            self.unread.discard(index)
            self.polled.discard(index)
            self.wires[index].close()
            self.wires[index] = Wire()

    def close_all(self) -> None:
        """Close all interfaces."""
        for index in list(self.wires):
            self.close(index)

    def _unregister(self, index):
        """Await no more events of a bus."""
        for descriptor in [key for key, place in self._places.items() if place == index]:
            del self._places[descriptor]
            self.poll.unregister(descriptor)
