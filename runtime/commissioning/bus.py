"""A bus under the control of a command: locked as a run locks it, with a record of every frame that was sent."""

import json
import select
import socket
import struct
import time
from dataclasses import replace

from graph import dialogue
from graph.names import suggestion
from runtime.base.errors import BadInput
from runtime.console.confirm import confirm
from runtime.console.terminal import tell
from runtime.guardian.lock import BusLock, BusTaken
from runtime.guardian.wires import ERROR, EXTENDED, REMOTE, CannotOpen, PythonCanWire, SocketCanWire
from runtime.machine.can import ARPHRD_CAN
from runtime.machine.probe import Machine
from runtime.rig.buses import ONE_PROCESS, SEE_PYTHON_CAN
from runtime.rig.errors import Refused, Trouble
from runtime.rig.file import I2C, SOCKETCAN, UDP, parse, read
from runtime.rig.interface_checks import link, look
from runtime.rig.serial_port import look_at_port

ERROR_FILTER, EVERY_ERROR = 2, 0x1FFFFFFF
PATIENCE = 0.05  # s for a full queue to take a frame
PAUSE = 0.001  # s between two questions: a drive's answer takes a quarter of it


class ToolBus:
    """The only controller of a bus, from now until it is closed. Refused, with the cause in words.

    bus : RigBus
    sent : (identifier, is extended, data, why) of every frame that went out
    refused, errors : frames that the interface did not accept, error frames of the controller
    """

    def __init__(self, bus, machine=None):
        self.bus, self.sent, self.refused, self.errors = bus, [], 0, 0
        self.remarks = []
        if bus.interface in (*ONE_PROCESS, UDP, I2C):
            raise Refused(
                Trouble(
                    "TW105",
                    f"[bus.{bus.name}] interface = {bus.interface!r} has no drives",
                    "name a bus of CAN: socketcan, slcan, udp_multicast",
                )
            )
        try:
            self.lock = BusLock(bus.interface, bus.channel)
        except BusTaken as taken:
            raise Refused(
                Trouble(
                    "TW106",
                    f"[bus.{bus.name}] {bus.channel} is controlled by {taken.owner}",
                    "end that one first: a bus has one controller",
                )
            ) from None
        try:
            self.wire = self.open(bus, machine or Machine())
        except CannotOpen as error:
            self.lock.close()
            raise Refused(
                Trouble("TW119", f"[bus.{bus.name}] {bus.interface} {bus.channel}: {error}", SEE_PYTHON_CAN)
            ) from None
        except BaseException:
            self.lock.close()
            raise

    def open(self, bus, machine):
        if bus.interface != SOCKETCAN:
            look_at_port(bus)
            return PythonCanWire(bus.interface, bus.channel, bus.bitrate, bus.fd, bus.options)
        fitness = look(bus, machine)
        self.remarks = fitness.remarks
        wire = SocketCanWire(bus.channel, bus.fd, fitness.virtual)
        wire.listen([(0, 0, b"")])
        wire.socket.setsockopt(socket.SOL_CAN_RAW, ERROR_FILTER, struct.pack("=I", EVERY_ERROR))
        return wire

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self.wire.close()
        self.lock.close()

    def send(self, frame, why):
        """Whether a frame went out. frame : (identifier, is extended, data)"""
        identifier, extended, data = frame
        deadline = time.monotonic() + PATIENCE
        while not self.wire.send(identifier | EXTENDED * extended, bytes(data)):
            if self.wire.trouble or time.monotonic() > deadline:
                self.refused += 1
                return False
            time.sleep(PAUSE)
        self.sent.append((identifier, extended, bytes(data), why))
        return True

    def listen(self, seconds, until=lambda frames: False):
        """Return the frames (identifier, is extended, data) received within some time, or until `until(frames)`."""
        frames, deadline = [], time.monotonic() + seconds
        while True:
            frames += self.take()
            left = deadline - time.monotonic()
            if left <= 0.0 or self.wire.trouble or until(frames):
                return frames
            descriptor = self.wire.fileno()
            if descriptor is None:
                time.sleep(min(left, PAUSE))
            else:
                select.select([descriptor], [], [], left)

    def take(self):
        found = []
        for identifier, data, _ in self.wire.receive():
            if identifier & ERROR:
                self.errors += 1
            elif not identifier & REMOTE:
                found.append((identifier & 0x1FFFFFFF, bool(identifier & EXTENDED), bytes(data)))
        return found

    def ask(self, frame, why, read, patience=0.1, attempts=2):
        """Carry out graph.dialogue.ask."""
        return self.converse(dialogue.ask(frame, why, read, patience, attempts))

    def converse(self, talk, yes=False):
        """Carry out a dialogue of a device family (graph.dialogue); return its result. BadInput where it is rejected.

        yes : whether every question to the operator is answered with yes, unasked
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
            elif isinstance(step, dialogue.Tell):
                reply = tell(step.lines)
            elif isinstance(step, dialogue.Confirm):
                reply = confirm(step.what, yes)
                if not reply:
                    tell(["nothing was changed"])
            else:
                raise TypeError(f"a dialogue on a CAN bus yields Send, Listen, Tell or Confirm, got {step!r}")


def named_buses(options, machine=None):
    """The RigBus that the options of `add_bus` name; all of this machine where they name none. BadInput

    Returns a list.
    """
    machine = machine or Machine()
    if options.rig is not None:
        if options.interface or options.channel or options.bitrate:
            raise BadInput("--rig and --interface, --channel, --bitrate exclude each other: the rig contains all three")
        buses = read(options.rig).buses
        if options.bus is not None and options.bus not in buses:
            hint = suggestion(options.bus, buses) or f"it has {', '.join(buses) or 'none'}"
            raise BadInput(f"--bus {options.bus}: {options.rig} has no such bus; {hint}")
        if not buses:
            raise BadInput(f"{options.rig} has no bus: write [bus.legs] with interface and channel")
        return [bus for bus in buses.values() if bus.interface != UDP and options.bus in (None, bus.name)]
    if options.bus is not None:
        raise BadInput("--bus names a bus of a rig: give --rig, too")
    if options.channel or (options.interface and options.interface != SOCKETCAN):
        if not options.channel:
            example = "/dev/ttyACM0" if options.interface != I2C else "/dev/i2c-1"
            raise BadInput(f"--interface {options.interface}: which channel? as in --channel {example}")
        return [one_bus(options.interface or SOCKETCAN, options.channel, options.bitrate, machine)]
    names = [path.split("/")[-2] for path in machine.glob("sys/class/net/*/type") if machine.read(path) == ARPHRD_CAN]
    if not names:
        raise BadInput(
            "this machine has no CAN interface: is the adapter plugged in, and its driver loaded? the command "
            "`doctor` looks closer; "
            "what is no interface of the network is named: --interface slcan --channel /dev/ttyACM0"
        )
    return [one_bus(SOCKETCAN, name, options.bitrate, machine) for name in names]


def one_bus(interface, channel, bitrate, machine):
    """Return a RigBus as from a rig file, so that errors have the same text."""
    own = None
    if interface == SOCKETCAN and bitrate is None:
        own = ((link(channel, machine).get("info_data") or {}).get("bittiming") or {}).get("bitrate")
    text = f"[bus.can]\ninterface = {quoted(interface)}\nchannel = {quoted(channel)}\n"
    bus = parse("the command line", text + (f"bitrate = {bitrate or own}\n" if bitrate or own else "")).buses["can"]
    plain = "".join(letter if letter.isalnum() else "_" for letter in channel).strip("_")
    return (
        replace(bus, name="imus") if interface == I2C else replace(bus, name=plain) if interface == SOCKETCAN else bus
    )


def quoted(text):
    """Text as TOML writes it."""
    return json.dumps(str(text), ensure_ascii=False)


def entry(bus, name=None):
    """Return the lines of a rig file for a bus."""
    lines = [f"[bus.{name or bus.name}]", f"interface = {quoted(bus.interface)}", f"channel = {quoted(bus.channel)}"]
    lines += [f"bitrate = {bus.bitrate:_}"] * (bus.interface != I2C)
    lines += ["fd = true"] * bus.fd
    if bus.options:
        lines.append("options = { " + ", ".join(f"{key} = {plain(value)}" for key, value in bus.options.items()) + " }")
    return lines


def plain(value):
    """A value of `options` as TOML writes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return "[" + ", ".join(map(plain, value)) + "]"
    return quoted(value) if isinstance(value, str) else repr(value)


def single_bus(options):
    """The one RigBus that the options name. BadInput where there are several."""
    buses = named_buses(options)
    if len(buses) != 1:
        names = ", ".join(f"{bus.name} ({bus.channel})" for bus in buses)
        raise BadInput(
            f"which bus? {names}: " + ("add --bus NAME" if options.rig is not None else "add --channel NAME")
        )
    return buses[0]


def i2c_bus(options):
    """The one RigBus of I2C that the options name, or that this machine has. BadInput"""
    from runtime.rig.i2c import known, paths

    if options.rig is None:
        options.interface = options.interface or I2C
        there = paths()
        if options.channel is None and len(there) == 1:
            options.channel = there[0]
        if options.channel is None:
            raise BadInput(f"which bus? as in --channel /dev/i2c-1; {known()}")
    buses = [bus for bus in named_buses(options) if bus.interface == I2C]
    if len(buses) != 1:
        raise BadInput(
            "which bus? " + (", ".join(f"--bus {bus.name}" for bus in buses) or "none that is named is one of I2C")
        )
    return buses[0]


def opened(bus):
    """A ToolBus. BadInput, with the cause and the cure."""
    try:
        return ToolBus(bus)
    except Refused as refused:
        raise BadInput(str(refused.trouble)) from None


def in_candump(identifier, extended, data):
    """A frame as candump's log writes it."""
    return f"{identifier:08X}#{data.hex().upper()}" if extended else f"{identifier:03X}#{data.hex().upper()}"
