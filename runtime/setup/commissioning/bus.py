"""CAN bus controlled by a command: locked as in a run, with a record of every frame sent."""

from __future__ import annotations

import json
import select
import socket
import struct
import time
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from graph import dialogue
from runtime.host.console.confirm import confirm
from runtime.host.console.terminal import print_lines
from runtime.host.errors import BadInput
from runtime.host.machine.can import ARPHRD_CAN
from runtime.host.machine.probe import Machine
from runtime.host.suggestions import suggestion
from runtime.robot.guardian.lock import BusLock, BusTaken
from runtime.robot.guardian.wires import ERROR, EXTENDED, REMOTE, CannotOpen, PythonCanWire, SocketCanWire
from runtime.robot.rig.buses import ONE_PROCESS, SEE_PYTHON_CAN
from runtime.robot.rig.errors import Refused, RigProblem
from runtime.robot.rig.file import I2C, SOCKETCAN, UDP, parse, read
from runtime.robot.rig.interface_checks import link, look
from runtime.robot.rig.serial_port import look_at_port

if TYPE_CHECKING:
    from argparse import Namespace

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
        if bus.interface in (*ONE_PROCESS, UDP, I2C):
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
            return PythonCanWire(bus.interface, bus.channel, bus.bitrate, bus.fd, bus.options)
        fitness = look(bus, machine)
        self.remarks = fitness.remarks
        wire = SocketCanWire(bus.channel, bus.fd, fitness.virtual)
        wire.listen([(0, 0, "")])
        wire.socket.setsockopt(socket.SOL_CAN_RAW, ERROR_FILTER, struct.pack("=I", EVERY_ERROR))
        return wire

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self.wire.close()
        self.lock.close()

    def send(self, frame: tuple[int, bool, bytes], why: str) -> bool:
        """Send a frame. Returns whether the interface accepted it. frame : (identifier, is extended, data)"""
        identifier, extended, data = frame
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
        for identifier, data, arrival in self.wire.receive():
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


def named_buses(options: Namespace, machine: Machine | None = None) -> list[RigBus]:
    """Return the RigBuses selected by the options of `add_bus`, or all CAN interfaces of this machine.

    Raises BadInput if the options conflict or match no bus.
    """
    machine = machine or Machine()
    if options.rig is not None:
        if options.interface or options.channel or options.bitrate:
            raise BadInput("--rig and --interface, --channel, --bitrate exclude each other: the rig contains all three")
        buses = read(options.rig).buses
        if options.bus is not None and options.bus not in buses:
            hint = suggestion(options.bus, buses) or f"its buses: {', '.join(buses) or 'none'}"
            raise BadInput(f"--bus {options.bus}: {options.rig} has no such bus; {hint}")
        if not buses:
            raise BadInput(f"{options.rig} has no bus: write [bus.legs] with interface and channel")
        return [bus for bus in buses.values() if bus.interface != UDP and options.bus in (None, bus.name)]
    if options.bus is not None:
        raise BadInput("--bus selects a bus of a rig file: add --rig RIG")
    if options.channel or (options.interface and options.interface != SOCKETCAN):
        if not options.channel:
            example = "/dev/ttyACM0" if options.interface != I2C else "/dev/i2c-1"
            raise BadInput(f"--interface {options.interface} needs a channel: add, for example, --channel {example}")
        return [one_bus(options.interface or SOCKETCAN, options.channel, options.bitrate, machine)]
    names = [path.split("/")[-2] for path in machine.glob("sys/class/net/*/type") if machine.read(path) == ARPHRD_CAN]
    if not names:
        raise BadInput(
            "this machine has no CAN interface: check that the adapter is plugged in and its driver is loaded, or run "
            "the command `doctor`. For an adapter that is not a network interface, name it: --interface slcan "
            "--channel /dev/ttyACM0"
        )
    return [one_bus(SOCKETCAN, name, options.bitrate, machine) for name in names]


def one_bus(interface: str, channel: str, bitrate: int | None, machine: Machine) -> RigBus:
    """Return a RigBus, parsed as from a rig file so that errors have the same text."""
    own = None
    if interface == SOCKETCAN and bitrate is None:
        own = ((link(channel, machine).get("info_data") or {}).get("bittiming") or {}).get("bitrate")
    text = f"[bus.can]\ninterface = {quoted(interface)}\nchannel = {quoted(channel)}\n"
    bus = parse("the command line", text + (f"bitrate = {bitrate or own}\n" if bitrate or own else "")).buses["can"]
    plain = "".join(letter if letter.isalnum() else "_" for letter in channel).strip("_")
    return (
        replace(bus, name="imus") if interface == I2C else replace(bus, name=plain) if interface == SOCKETCAN else bus
    )


def quoted(text: object) -> str:
    """Return a text as a TOML string."""
    return json.dumps(str(text), ensure_ascii=False)


def entry(bus: RigBus, name: str | None = None) -> list[str]:
    """Return the lines of a rig file for a bus."""
    lines = [f"[bus.{name or bus.name}]", f"interface = {quoted(bus.interface)}", f"channel = {quoted(bus.channel)}"]
    lines += [f"bitrate = {bus.bitrate:_}"] * (bus.interface != I2C)
    lines += ["fd = true"] * bus.fd
    if bus.options:
        lines.append("options = { " + ", ".join(f"{key} = {plain(value)}" for key, value in bus.options.items()) + " }")
    return lines


def plain(value: Any) -> str:
    """Return a value of `options` in TOML notation."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return "[" + ", ".join(map(plain, value)) + "]"
    return quoted(value) if isinstance(value, str) else repr(value)


def single_bus(options: Namespace) -> RigBus:
    """Return the one RigBus that the options select. Raises BadInput if there are several."""
    buses = named_buses(options)
    if len(buses) != 1:
        names = ", ".join(f"{bus.name} ({bus.channel})" for bus in buses)
        raise BadInput(
            f"more than one bus: {names}. Select one: add "
            + ("--bus NAME" if options.rig is not None else "--channel NAME")
        )
    return buses[0]


def i2c_bus(options: Namespace) -> RigBus:
    """Return the one I2C RigBus that the options select or this machine has. Raises BadInput otherwise."""
    from runtime.robot.rig.i2c import hint_of_buses, paths

    if options.rig is None:
        options.interface = options.interface or I2C
        channels = paths()
        if options.channel is None and len(channels) == 1:
            options.channel = channels[0]
        if options.channel is None:
            raise BadInput(f"no I2C bus selected: add, for example, --channel /dev/i2c-1; {hint_of_buses()}")
    buses = [bus for bus in named_buses(options) if bus.interface == I2C]
    if len(buses) != 1:
        raise BadInput(
            f"more than one I2C bus: select one of {', '.join(f'--bus {bus.name}' for bus in buses)}"
            if buses
            else "the selected buses include no I2C bus"
        )
    return buses[0]


def open_bus(bus: RigBus) -> ToolBus:
    """Open a ToolBus. Raises BadInput with the cause and the remedy."""
    try:
        return ToolBus(bus)
    except Refused as refused:
        raise BadInput(str(refused.problem)) from None


def in_candump(identifier: int, extended: bool, data: bytes) -> str:
    """Return a frame in the notation of candump's log."""
    return f"{identifier:08X}#{data.hex().upper()}" if extended else f"{identifier:03X}#{data.hex().upper()}"
