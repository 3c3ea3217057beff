"""CAN bus controlled by a tool instead of a run: locked as in a run, with a record of every frame sent."""

from __future__ import annotations

import select
import socket
import struct
import time
from typing import TYPE_CHECKING, Any

from graph import dialogue
from graph.budget import CLASSIC_BYTES
from runtime.host.console.confirm import confirm
from runtime.host.console.terminal import print_lines
from runtime.host.errors import BadInput
from runtime.host.machine.probe import Machine
from runtime.robot.guardian.lock import BusLock, BusTaken
from runtime.robot.guardian.wires import ERROR, EXTENDED, REMOTE, CannotOpen, PythonCanWire, SocketCanWire
from runtime.robot.rig.buses import ONE_PROCESS, SEE_PYTHON_CAN
from runtime.robot.rig.errors import Refused, RigProblem
from runtime.robot.rig.file import CHIP_BUSES, SOCKETCAN, UDP
from runtime.robot.rig.interface_checks import look
from runtime.robot.rig.serial_port import look_at_port

if TYPE_CHECKING:
    from collections.abc import Callable

    from graph.dialogue import Dialogue, Reader
    from runtime.robot.rig.file import RigBus

ERROR_FILTER, EVERY_ERROR = 2, 0x1FFFFFFF
TX_QUEUE_TIMEOUT = 0.05  # s until a full transmit queue accepts a frame
QUERY_INTERVAL = 0.001  # s between two queries; a drive replies within a quarter of it


class ToolBus:
    """Exclusive controller of a CAN bus until it is closed. Raises Refused if the bus cannot be opened.

    bus : RigBus
    sent : (identifier, is extended, data, reason) of every frame sent
    refused, errors : numbers of frames that the interface rejected and of error frames received
    """

    def __init__(self, bus: RigBus, machine: Machine | None = None) -> None:
        self.bus, self.sent = bus, []
        self.refused, self.errors = 0, 0
        self.remarks = []
        if bus.interface in (*ONE_PROCESS, UDP, *CHIP_BUSES):
            raise Refused(
                RigProblem(
                    "TW105",
                    f"[bus.{bus.name}] interface = {bus.interface!r} has no drives",
                    "select a CAN bus: socketcan, slcan or udp_multicast",
                )
            )
        try:
            self.lock = BusLock(bus.interface, bus.channel)
        except BusTaken as taken:
            raise Refused(
                RigProblem("TW106", f"[bus.{bus.name}] {bus.channel} is controlled by {taken.owner}", taken.remedy)
            ) from None
        try:
            self.wire = self.open(bus, machine or Machine())
        except CannotOpen as error:
            self.lock.close()
            raise Refused(
                RigProblem("TW119", f"[bus.{bus.name}] {bus.interface} {bus.channel}: {error}", SEE_PYTHON_CAN)
            ) from None
        except BaseException:
            self.lock.close()
            raise

    def open(self, bus: RigBus, machine: Machine) -> SocketCanWire | PythonCanWire:
        """Return the open interface of a bus. Raises Refused or CannotOpen."""
        if bus.interface != SOCKETCAN:
            look_at_port(bus)
            return PythonCanWire(bus.interface, bus.channel, bus.bitrate, bus.fd, bus.options, bus.data_bitrate)
        fitness = look(bus, machine)
        self.remarks = fitness.remarks
        wire = SocketCanWire(bus.channel, bus.fd, fitness.virtual, bus.data_bitrate)
        wire.listen([(0, 0, "")])
        wire.socket.setsockopt(socket.SOL_CAN_RAW, ERROR_FILTER, struct.pack("=I", EVERY_ERROR))
        return wire

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self.wire.close()
        self.lock.close()

    def send(self, frame: tuple[int, bool, bytes], why: str) -> bool:
        """Send a frame. Returns whether the interface accepted it. frame : (identifier, is extended, data)

        A frame of CAN FD is not sent on a bus of classic CAN, where no drive understands it.
        """
        identifier, extended, data = frame
        if len(data) > CLASSIC_BYTES and not self.bus.fd:
            return False
        deadline = time.monotonic() + TX_QUEUE_TIMEOUT
        while not self.wire.send(identifier | EXTENDED * extended, bytes(data)):
            if self.wire.trouble or time.monotonic() > deadline:
                self.refused += 1
                return False
            time.sleep(QUERY_INTERVAL)
        self.sent.append((identifier, extended, bytes(data), why))
        return True

    def listen(self, seconds: float, until: Callable[..., Any] = lambda frames: False) -> list[tuple[int, bool, bytes]]:
        """Return the frames (identifier, is extended, data) received within `seconds`, or until `until(frames)`."""
        frames, deadline = [], time.monotonic() + seconds
        while True:
            frames += self.take()
            left = deadline - time.monotonic()
            if left <= 0.0 or self.wire.trouble or until(frames):
                return frames
            descriptor = self.wire.fileno()
            if descriptor is None:
                time.sleep(min(left, QUERY_INTERVAL))
            else:
                select.select([descriptor], [], [], left)

    def take(self) -> list[tuple[int, bool, bytes]]:
        """Return the frames (identifier, is extended, data) that have arrived, without waiting. Counts error frames."""
        return [frame for frame, _ in self.arrivals()]

    def arrivals(self) -> list[tuple[tuple[int, bool, bytes], float]]:
        """Return `take` with the arrival of each frame in s of CLOCK_MONOTONIC."""
        frames = []
        for identifier, data, arrival, _ in self.wire.receive():
            if identifier & ERROR:
                self.errors += 1
            elif not identifier & REMOTE:
                frames.append(((identifier & 0x1FFFFFFF, bool(identifier & EXTENDED), bytes(data)), arrival * 1e-9))
        return frames

    def ask(
        self, frame: tuple[int, bool, bytes], why: str, read: Reader, timeout: float = 0.1, attempts: int = 2
    ) -> Any:
        """Carry out graph.dialogue.ask.

        frame : query, (identifier, is extended, data)
        why : reason, for the list of sent frames
        read : function of a frame that returns the answer in it, or None
        timeout : s per attempt

        Returns the answer, or None without one.
        """
        return self.converse(dialogue.ask(frame, why, read, timeout, attempts))

    def converse(self, talk: Dialogue, yes: bool = False) -> Any:
        """Carry out a dialogue of a device family (graph.dialogue). Returns its result.

        yes : whether to skip the questions to the operator and assume yes

        Raises BadInput if the dialogue is rejected.
        """
        reply = None
        while True:
            try:
                step = talk.send(reply)
            except StopIteration as end:
                return end.value
            except dialogue.Rejected as rejected:
                raise BadInput("; ".join(filter(None, (str(rejected), rejected.hint)))) from None
            if isinstance(step, dialogue.Send):
                reply = self.send(step.frame, step.why)
            elif isinstance(step, dialogue.Listen):
                reply = self.listen(step.seconds, step.until or (lambda frames: False))
            elif isinstance(step, dialogue.Show):
                reply = print_lines(step.lines)
            elif isinstance(step, dialogue.Confirm):
                reply = confirm(step.what, yes)
                if not reply:
                    print_lines(["nothing was changed"])
            else:
                raise TypeError(f"a dialogue on a CAN bus yields Send, Listen, Show or Confirm, got {step!r}")
