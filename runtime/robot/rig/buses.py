"""Buses of a robot on its rig: opened before a run, and queried for statistics after it."""

from __future__ import annotations

import errno
import os
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

from cext.bus.socketcan import SocketCan
from cext.ring.rings import Line, Lines
from cext.safety.thresholds import GUARDIAN_SILENCE, GUARDIAN_SILENCE_REALTIME, NOTHING_TO_STOP, TX_QUEUE_FULL_LIMIT
from graph import Device, StreamDevice
from graph.device import actuators_of
from runtime.host.descriptors import Descriptors
from runtime.host.machine.probe import Machine
from runtime.robot.guardian import MEMORY_LOCKED, REALTIME, GuardianError, GuardianProcess, with_flags
from runtime.robot.guardian import plan as guardians_plan
from runtime.robot.guardian.lock import BusLock, BusTaken
from runtime.robot.guardian.wires import SHARED
from runtime.robot.rig.errors import Refused, RigError, RigProblem
from runtime.robot.rig.file import CHIP_BUSES, I2C, SOCKETCAN, UDP
from runtime.robot.rig.i2c import I2cInterface, SeveralRefused, error_in_words
from runtime.robot.rig.interface import Interface
from runtime.robot.rig.interface_checks import WIRING, again, take_up
from runtime.robot.rig.serial_port import look_at_port
from runtime.robot.rig.spi import SpiInterface
from runtime.robot.rig.streams import StreamLines
from runtime.robot.rig.udp import UdpInterface, failure_in_words

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from typing import Any

    from cext.bus.memory_bus import BusEnd
    from cext.lines.stream import Stream
    from cext.memory.shared_state import SharedState
    from graph import Diagram
    from graph.schedule import Schedule
    from runtime.robot.guardian.plan_types import PlanBus, PlanRelay, StopReport
    from runtime.robot.rig.file import RigBus, RigFile
    from runtime.robot.rig.streams import StreamInterface

SEE_PYTHON_CAN = "interface and channel are python-can's: see its documentation of this interface"
GONE = (errno.ENODEV, errno.ENXIO)


NATIVE = (SOCKETCAN, UDP)  # kinds that the loop drives itself
ONE_PROCESS = ("virtual",)  # kinds whose nodes must be in the process that opens them


@dataclass
class OpenBus:
    """Bus of a rig that is open.

    interface : its interface or line
    can : its end for the loop
    """

    interface: Interface | Carried | UdpInterface | I2cInterface | StreamInterface
    can: SocketCan | Line | I2cInterface | Stream


class Carried:
    """Interface that the guardian opens, and whose frames it carries. bus : RigBus"""

    virtual, remarks, strangers = False, (), None

    def __init__(self, bus: RigBus) -> None:
        self.bus = bus

    def close(self) -> None:
        """The guardian closes the interface."""


class RigBuses:
    """Interfaces of a robot's buses, and the guardian of both.

    Raises RigError with every problem that prevents a run.

    SocketCAN interfaces open in the constructor, the others in `watch`.

    rig : RigFile
    robot : Diagram, as the rig has it
    names : names of the buses, in the order of the schedule
    """

    def __init__(self, rig: RigFile, robot: Diagram, names: Sequence[str], machine: Machine | None = None) -> None:
        self.rig, self.buses, problems = rig, {}, []
        self.locks, self.guardian, self.report = [], None, None
        self.descriptors, self.lost = Descriptors(), []
        self.lines, self.bell = None, -1
        self.left: dict[str, dict[str, Any]] = {}  # counts of buses that were closed before the end of a stop
        devices = [block for block in robot if isinstance(block, Device)]
        self.commands = bool(actuators_of(devices)) or any(block.relay_time for block in devices)
        self.media = {block.bus: block.medium for block in devices}
        kinds = [rig.buses[name].interface for name in names if self.media[name] == "can"]
        if any(kind not in NATIVE for kind in kinds):
            self.lines, self.bell = Lines(len(names)), os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self.streams = StreamLines([block for block in devices if isinstance(block, StreamDevice)])
        problems += self.streams.problems
        for index, name in enumerate(names):
            if self.media[name] == "stream":
                if name in self.streams.lines:
                    self.buses[name] = OpenBus(*self.streams.lines[name])
                continue
            try:
                self.buses[name] = self._open(
                    index, name, [block for block in devices if block.bus == name], machine or Machine()
                )
            except SeveralRefused as refused:
                problems += refused.problems
            except Refused as refused:
                problems.append(refused.problem)
        if problems:
            self.close()
            raise RigError(rig.path, dict.fromkeys(problems))

    def _open(self, index, name, devices, machine):
        """Open the interface of a bus. Raises Refused."""
        bus = self.rig.buses[name]
        medium = self.media[name]
        if medium != (bus.interface if bus.interface in CHIP_BUSES else "can"):
            raise Refused(
                RigProblem(
                    "TW105",
                    f"[bus.{name}] interface = {bus.interface!r}, but its devices use {medium.upper()}",
                    f'write interface = "{medium}" and channel = "{CHIP_BUSES[medium]}"'
                    if medium in CHIP_BUSES
                    else 'write interface = "socketcan"',
                )
            )
        if bus.interface in ONE_PROCESS:
            raise Refused(
                RigProblem(
                    "TW105",
                    f"[bus.{name}] interface = {bus.interface!r} has no nodes outside the process that opens it",
                    "run without --rig to emulate every device, or use udp_multicast, whose nodes are processes of "
                    "this machine",
                )
            )
        try:
            self.locks.append(BusLock(bus.interface, bus.channel, stop_identifiers(devices)))
        except BusTaken as taken:
            raise Refused(
                RigProblem("TW106", f"[bus.{name}] {bus.channel} is controlled by {taken.owner}", taken.remedy)
            ) from None
        if bus.interface in CHIP_BUSES:
            interface = (I2cInterface if bus.interface == I2C else SpiInterface)(bus, devices)
            return OpenBus(interface, interface)
        if bus.interface == UDP:
            interface = UdpInterface(bus, devices)
            return OpenBus(
                interface,
                SocketCan(interface.socket, shared=True, queue_full_limit=TX_QUEUE_FULL_LIMIT, mute=not bus.peer),
            )
        if bus.interface != SOCKETCAN:
            if self.locks[-1].handover is None:  # otherwise its process closes the port when the guardian opens it
                look_at_port(bus)
            assert self.lines is not None
            return OpenBus(Carried(bus), Line(self.lines, index, self.bell, bus.data_bitrate > 0))
        filters = [device.acceptance_filters() for device in devices]
        listens = None if None in filters else sorted({each for several in filters for each in several})
        interface = Interface(
            bus, listens, sorted({address for device in devices for address in device.addresses()}), machine
        )
        return OpenBus(
            interface,
            SocketCan(
                interface.socket,
                fd=bus.fd,
                switching=bus.data_bitrate > 0,
                shared=interface.virtual,
                queue_full_limit=TX_QUEUE_FULL_LIMIT,
            ),
        )

    def ends(self) -> list[BusEnd]:
        """Return the robot's end of each bus, in the order of the schedule."""
        return [bus.can.end for bus in self.buses.values()]

    @property
    def carries(self) -> bool:
        """Whether the guardian carries the frames of any bus."""
        return self.lines is not None

    @property
    def grace(self) -> float:
        """Time in s of a delay that the run tolerates at least: a measurement outlasts it."""
        return 0.0 if self.commands else NOTHING_TO_STOP * 1e-9

    @property
    def guardian_silence(self) -> float:
        """Time in s without a check by the guardian after which the loop ends the run.

        No other process delays a guardian that has a real-time priority and locked memory; a serial interface may.
        """
        granted = [] if self.guardian is None else self.guardian.granted
        privileged = MEMORY_LOCKED in granted and any(each.startswith(REALTIME) for each in granted)
        prompt = all(
            bus.interface.bus.interface in {*SHARED, UDP}
            for name, bus in self.buses.items()
            if self.media[name] == "can"
        )
        return max((GUARDIAN_SILENCE_REALTIME if privileged and prompt else GUARDIAN_SILENCE) * 1e-9, self.grace)

    def watch(self, shared: SharedState, schedule: Schedule, robot: Diagram, priority: int | None) -> None:
        """Start the guardian, which opens the remaining interfaces. Raises RigError.

        shared : shared state of the run; robot : Diagram; priority : SCHED_FIFO priority of the loop, or None
        """
        relays: list[PlanRelay] = [
            {
                "descriptor": self.buses[block.bus].can.fileno(),
                "gpio": block.line == "gpio",
                "frames": [frame.hex() for frame in block.relay_frames()],
                "hold": block.relay_time,
            }
            for block in robot
            if isinstance(block, StreamDevice) and block.relay_time
        ]
        self.guardian = GuardianProcess(
            shared, self.lines, self.bell, self.locks, [relay["descriptor"] for relay in relays]
        )
        buses: list[PlanBus] = [
            {
                "name": name,
                "interface": bus.interface.bus.interface,
                "channel": bus.interface.bus.channel,
                "bitrate": bus.interface.bus.bitrate,
                "fd": bus.interface.bus.fd,
                "data_bitrate": bus.interface.bus.data_bitrate,
                "virtual": bus.interface.virtual,
                "options": bus.interface.bus.options,
                "line": index if isinstance(bus.can, Line) else None,
            }
            for index, (name, bus) in enumerate(self.buses.items())
            if self.media[name] == "can"
        ]
        self.start_sensors(max(priority - 1, 0) if priority else 0)
        try:
            self.guardian.configure(guardians_plan(buses, schedule, priority, relays, self.grace))
        except GuardianError as error:
            problems = [
                RigProblem(
                    "TW119",
                    f"[bus.{name}] {self.rig.buses[name].interface} {self.rig.buses[name].channel}: {why}",
                    SEE_PYTHON_CAN,
                )
                for name, why in error.problems.items()
            ]
            raise RigError(
                self.rig.path, problems or [RigProblem("TW120", str(error), "see its message on the terminal")]
            ) from None
        self.keep_descriptors()

    def keep_descriptors(self) -> None:
        """Remember the files behind the descriptors of the run."""
        assert self.guardian is not None
        self.guardian.keep_descriptors(self.descriptors)
        for lock in self.locks:
            self.descriptors.keep("the locks of the buses", lock.fileno())
        for name, bus in self.buses.items():
            if isinstance(bus.interface, (Interface, UdpInterface)):
                self.descriptors.keep(f"the socket of bus {name}", bus.interface.socket.fileno())

    def start_sensors(self, priority: int) -> None:
        """Start the threads that read devices other than CAN. priority : SCHED_FIFO priority if granted, else 0"""
        self.streams.start(priority)
        for name, bus in self.buses.items():
            if self.media[name] in CHIP_BUSES:
                bus.interface.start(priority)

    def leave_sensors(self) -> None:
        """Close everything but the CAN buses: while a stop continues, another run may open it."""
        if self.report is None and not self.left:
            self.lost = self.descriptors.replaced_purposes()
        for name, bus in self.buses.items():
            if self.media[name] != "can" or bus.interface.bus.interface == UDP:
                self.left[name] = self._count(bus)
                with suppress(OSError):  # a block has closed its descriptor
                    bus.interface.close()
        self.streams.close()

    def take_over(self, lasts: float, ended: Callable[[], bool]) -> StopReport:
        """Stop the actuators without the guardian. Arguments as in GuardianProcess.take_over. Returns its report."""
        assert self.guardian is not None
        self.lost = self.descriptors.replaced_purposes()
        died, problems, stop = self.guardian.take_over(lasts, ended, self.leave_sensors)
        self.report = {"stop": None, "troubles": problems, "died": died, "taken_over": stop}
        return stop

    def remarks(self) -> list[str]:
        """Return remarks for the operator before the run."""
        return [f"{self.rig.path}: {remark}" for bus in self.buses.values() for remark in bus.interface.remarks]

    def close(self) -> None:
        """End the guardian, and close all interfaces, lines and locks."""
        if self.guardian is not None:
            self.guardian.kill()
        self.streams.close()
        for opened in (*(bus.interface for bus in self.buses.values()), *self.locks):
            with suppress(OSError):  # a block has closed its descriptor
                opened.close()
        if self.bell >= 0:
            with suppress(OSError):
                os.close(self.bell)
            self.bell = -1

    def finish(self) -> dict[str, dict[str, Any]]:
        """Close the interfaces and return {bus: its counts, state and foreign IDs} as plain data."""
        if self.report is None and not self.left:
            self.lost = self.descriptors.replaced_purposes()
        if self.guardian is not None and self.report is None:
            self.report = self.guardian.finish()
        self.after = {name: self.left.get(name) or self._count(bus) for name, bus in self.buses.items()}
        self.close()
        return self.after

    def _count(self, bus):
        """Return the counts, state and foreign IDs of a bus as plain data."""
        strangers, ids = 0, []
        if bus.interface.strangers is not None:
            with suppress(OSError):  # a block has closed its descriptor
                strangers, ids = bus.interface.strangers.counts()
        return {
            "interface": bus.interface.bus.interface,
            "channel": bus.interface.bus.channel,
            **bus.can.counts,
            "strangers": strangers,
            "stranger_ids": ids,
            "worst_state": getattr(bus.can, "worst", None),
        }

    def correct(self, frames: dict[str, int]) -> dict[str, int]:
        """Return the frame counts of a run, {kind: number}, with those that did not reach the robot.

        Call it after `finish`.
        """
        kinds = ("errors", "strangers", "refused", "echoes", "corrupt", "overflows")
        can = [bus for name, bus in self.after.items() if self.media[name] == "can"]
        total = {kind: sum(bus[kind] for bus in can) for kind in kinds}
        strangers = total.pop("strangers")
        corrected = frames | total
        corrected["received"] += strangers
        corrected["foreign"] += strangers
        return corrected

    def strangers(self) -> dict[str, list[str]]:
        """Return the IDs of frames from unknown nodes, by bus."""
        return {name: bus["stranger_ids"] for name, bus in self.after.items() if bus["stranger_ids"]}

    def sensors(self) -> list[str]:
        """Return 'shank 200 Hz' for each device on I2C or SPI, with its errors."""
        lines = []
        for name, bus in self.after.items():
            for path, counts in bus["devices"].items() if self.media[name] in CHIP_BUSES else ():
                words = f"{path} {counts['rate']:.4g} Hz"
                if counts["failures"]:
                    words += f", failed {counts['failures']} times ({error_in_words(counts['error'])})"
                if counts["losses"]:
                    words += f", lost {counts['losses']} times, reconnected {counts['returns']}"
                lines.append(words)
        return lines

    def failures(self) -> list[tuple[str, dict[str, Any], str]]:
        """Return (path, counts, last error) of the devices on I2C or SPI that failed to reply at times."""
        return [
            (path, counts, error_in_words(counts["error"]))
            for name, bus in self.after.items()
            if self.media[name] in CHIP_BUSES
            for path, counts in bus["devices"].items()
            if counts["failures"]
        ]

    def unheard(self) -> list[str]:
        """Return the channels on which no node acknowledged frames."""
        return [
            bus["channel"]
            for name, bus in self.after.items()
            if self.media[name] == "can" and (bus["worst_state"] in ("passive", "off") or bus["refused"])
        ]

    def line(self, name: str) -> str:
        """Return the port of a serial line, and whether it is connected, as text. name : name of the bus"""
        bus = self.buses[name]
        counts = self.after[name] if hasattr(self, "after") else bus.can.counts
        lost, back = counts["losses"], counts["returns"]
        gone = (
            f", disconnected {lost} time{'s' * (lost > 1)}"
            + (" and still missing" if lost > back else " and reconnected")
            if lost
            else ", connected"
        )
        other = ", replaced by another device" if lost > back and counts["strangers"] else ""
        return f"{bus.interface.bus.channel}{gone}{other}"

    def explain(self, name: str) -> tuple[str, str]:
        """Return (why a bus failed, remedy). name : name of the bus"""
        bus = self.buses[name].interface.bus
        if isinstance(self.buses[name].can, Line):
            reason = (self.report or {}).get("troubles", {}).get(name) or "it accepts no frames"
            return f"{bus.interface} {bus.channel}: {reason}", "check that the adapter is plugged in and powered"
        if bus.interface == UDP:
            return failure_in_words(self.buses[name].can.trouble, bus)
        return in_words(
            self.buses[name].can.trouble, self.buses[name].interface.bus, self.buses[name].interface.virtual
        )


def stop_identifiers(devices: Sequence[Device]) -> set[int]:
    """Return the identifiers, with flag bits, of the frames that stop devices."""
    frames = [frame for device in devices for frame in (*device.zero_frames(), *device.disable_frames())]
    return {with_flags(identifier, extended) for identifier, extended, _ in frames}


def in_words(error: int | str | None, bus: RigBus, virtual: bool) -> tuple[str, str]:
    """Return (the failure of a SocketCan as text, its remedy).

    error : errno, "bus-off" or "full"
    bus : RigBus
    virtual : whether all nodes are processes of this machine
    """
    channel = bus.channel
    if error == "bus-off":
        return (f"{channel} is bus-off after too many errors", f"{WIRING}; then: {again(bus)}")
    if error == "full":
        return (
            f"the queue of {channel} was full for {TX_QUEUE_FULL_LIMIT} ticks: no node acknowledges its frames, "
            "or the bus is overloaded",
            f"{WIRING}; for a longer queue: sudo ip link set {channel} txqueuelen 128",
        )
    if error == errno.ENETDOWN:
        return f"{channel} went down", take_up(bus, virtual)
    if error in GONE:
        return f"{channel} disappeared: its adapter was unplugged or lost power", (
            f"plug it in, then: {take_up(bus, virtual)}"
        )
    reason = os.strerror(error) if isinstance(error, int) and error else "sending and receiving failed"
    return f"{channel}: {reason}", f"see: ip -details -statistics link show {channel}"
