"""Interfaces of a plant's buses, opened as a robot's but without a guardian, since an emulator moves nothing."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cext.bus.socketcan import SocketCan
from cext.ring.rings import Line, Lines
from cext.safety.thresholds import TX_QUEUE_FULL_LIMIT
from runtime.host.child_process import ChildProcess
from runtime.host.errors import BadInput
from runtime.host.machine.probe import Machine
from runtime.host.signed_datagrams import read_key
from runtime.robot.emulation.i2c_server import I2cServer
from runtime.robot.emulation.network_senders import NetworkSender
from runtime.robot.emulation.spi_server import SpiServer
from runtime.robot.guardian.lock import BusLock, BusTaken
from runtime.robot.rig.buses import ONE_PROCESS, SEE_PYTHON_CAN
from runtime.robot.rig.errors import Refused, RigError, RigProblem
from runtime.robot.rig.file import CHIP_BUSES, EMULATED, I2C, SOCKETCAN, UDP
from runtime.robot.rig.interface import Interface
from runtime.robot.rig.serial_port import look_at_port

if TYPE_CHECKING:
    from blocks.chips import ChipDevice
    from cext.bus.memory_bus import BusEnd
    from runtime.robot.rig.file import RigBus, RigFile

READY_TIMEOUT = 30.0  # s
CAN_FRAME_BYTES = 16  # of a datagram
ONE_MACHINE = ("udp_multicast",)  # kinds of python-can whose nodes are processes


class PlantBuses:
    """Ends of a plant's buses. Raises RigError with every problem that prevents opening them.

    rig : RigFile
    names : names of the buses, in the order of the plant's schedule
    chips : {name of an I2C or SPI bus: (device of the robot, its emulator) of each device}

    remarks : texts for the operator
    real : channels on which there may be real drives
    """

    def __init__(
        self,
        rig: RigFile,
        names: Iterable[str],
        machine: Machine | None = None,
        chips: Mapping[str, Sequence[tuple[ChipDevice, ChipDevice]]] | None = None,
    ) -> None:
        self.rig, self.names = rig, list(names)
        self.remarks, self.real = [], []
        self.locks, self.interfaces, self.servers, self.cans, problems = [], {}, [], {}, []
        self.lines, self.bell = None, -1
        self.carrier, self.chips = None, chips or {}
        self.carried = [name for name in names if rig.buses[name].interface not in (SOCKETCAN, UDP, *CHIP_BUSES)]
        if self.carried:
            self.lines, self.bell = Lines(len(self.carried)), os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        try:
            for name in names:
                try:
                    self.cans[name] = self.open(rig.buses[name], machine or Machine())
                except Refused as refused:
                    problems.append(refused.problem)
            if self.carried and not problems:
                problems += self.carry()
            if problems:
                raise RigError(rig.path, dict.fromkeys(problems))
        except BaseException:
            self.close()
            raise

    def open(self, bus: RigBus, machine: Machine) -> SocketCan | Line | I2cServer:
        """Return the end of one bus: a SocketCan, a Line, or the server of an I2C or SPI bus.

        Raises Refused if it cannot be opened.
        """
        if bus.interface in ONE_PROCESS:
            raise Refused(
                RigProblem(
                    "TW105",
                    f"[bus.{bus.name}] interface = {bus.interface!r} has no nodes outside the process that opens it",
                    "use udp_multicast or vcan, whose nodes are processes of this machine",
                )
            )
        if bus.interface == UDP:
            key = None
            if bus.key:
                try:
                    key = read_key(bus.key)
                except ValueError as error:
                    raise Refused(RigProblem("TW139", f"[bus.{bus.name}] key = {bus.key!r}: {error}")) from None
            sender = NetworkSender("udp", bus.channel, CAN_FRAME_BYTES, sender=bus.peer, key=key)
            self.servers.append(sender)
            return SocketCan(sender.source)
        if bus.interface in CHIP_BUSES and not bus.channel.startswith(EMULATED):
            raise Refused(
                RigProblem(
                    "TW105",
                    f"[bus.{bus.name}] channel = {bus.channel!r}: chips on a real {bus.interface.upper()} bus "
                    "cannot be emulated",
                    f'write channel = "{EMULATED}/tmp/{bus.name}" in the rig file of the run and of emulate',
                )
            )
        try:
            self.locks.append(BusLock(f"emulator/{bus.interface}", bus.channel))
        except BusTaken as taken:
            raise Refused(
                RigProblem(
                    "TW107",
                    f"[bus.{bus.name}] {bus.channel} has an emulator: {taken.owner}",
                    "end that process first: two emulators would reply to every frame twice",
                )
            ) from None
        if bus.interface in CHIP_BUSES:
            kind: Any = I2cServer if bus.interface == I2C else SpiServer
            server = kind(Path(bus.channel.removeprefix(EMULATED)), self.chips.get(bus.name, ()))
            self.servers.append(server)
            return server
        if bus.interface != SOCKETCAN:
            look_at_port(bus)
            self.real += [bus.channel] * (bus.interface not in ONE_MACHINE)
            assert self.lines is not None
            return Line(self.lines, self.carried.index(bus.name), self.bell, bus.data_bitrate > 0)
        interface = self.interfaces[bus.name] = Interface(bus, None, [], machine)
        self.remarks += [f"{self.rig.path}: {remark}" for remark in interface.remarks]
        self.real += [bus.channel] * (not interface.virtual)
        return SocketCan(
            interface.socket,
            fd=bus.fd,
            switching=bus.data_bitrate > 0,
            shared=interface.virtual,
            queue_full_limit=TX_QUEUE_FULL_LIMIT,
        )

    def carry(self) -> list[RigProblem]:
        """Start the process with python-can's interfaces. Returns a RigProblem for each that cannot be opened."""
        buses = [self.rig.buses[name] for name in self.carried]
        plan = [
            {
                "name": bus.name,
                "interface": bus.interface,
                "channel": bus.channel,
                "bitrate": bus.bitrate,
                "fd": bus.fd,
                "data_bitrate": bus.data_bitrate,
                "options": bus.options,
            }
            for bus in buses
        ]
        assert self.lines is not None
        self.carrier = Carrier(self.lines, self.bell, self.locks)
        return [
            RigProblem(
                "TW119",
                f"[bus.{name}] {self.rig.buses[name].interface} {self.rig.buses[name].channel}: {why}",
                SEE_PYTHON_CAN,
            )
            for name, why in self.carrier.configure(plan).items()
        ]

    def ends(self) -> list[BusEnd]:
        """Return the plant's end of each bus, in the order of the schedule."""
        return [self.cans[name].end for name in self.names]

    def explain(self, name: str) -> str:
        """Return why a bus has failed. name : name of the bus"""
        cause = self.cans[name].trouble
        if name in self.carried and self.carrier is not None and not self.carrier.alive:
            return "the process that carries its frames has ended"
        return (
            cause if isinstance(cause, str) else os.strerror(cause) if cause and cause > 0 else "it accepts no frames"
        )

    def close(self) -> None:
        """End the process that carries frames, and close the interfaces and locks. May be called again."""
        if self.carrier is not None:
            self.carrier.close()
        for interface in (*self.interfaces.values(), *self.servers):
            interface.close()
        for lock in self.locks:
            lock.close()
        if self.bell >= 0:
            os.close(self.bell)
            self.bell = -1


class Carrier(ChildProcess):
    """Process with python-can's interfaces; it ends with this process, or on `close`."""

    def __init__(self, lines: Lines, bell: int, locks: Sequence[BusLock]) -> None:
        super().__init__(
            "runtime.robot.emulation.carrier", (lines.fd, bell), (lines.fd, bell, *(lock.fileno() for lock in locks))
        )

    def configure(self, plan: Sequence[Mapping[str, Any]]) -> dict[str, str]:
        """Open the buses. Returns {name: reason of a failure}; raises BadInput if the process does not respond.

        plan : {"name", "interface", "channel", "bitrate", "fd", "options"} of each bus
        """
        with suppress(BrokenPipeError):
            self._send(json.dumps(plan).encode() + b"\n")
        try:
            answer = self._answer(READY_TIMEOUT)
        except TimeoutError:
            answer = None
        if answer is None:
            raise BadInput("the process that carries the frames of python-can's interfaces did not start")
        return answer

    @property
    def alive(self) -> bool:
        """Whether the process runs."""
        return self._child.poll() is None

    def close(self) -> None:
        """End the process and wait for it."""
        self.end()
