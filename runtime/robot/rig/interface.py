"""Sockets of a SocketCAN interface.

Frames of the rig's devices arrive at a socket with a kernel filter, so that other traffic does not delay them. All
other frames arrive at a second socket that a tick never reads: the kernel counts them there and keeps the first few,
so that their IDs can be reported.
"""

from __future__ import annotations

import errno
import os
import socket
import struct
from typing import TYPE_CHECKING

from runtime.robot.rig.errors import Refused, RigProblem
from runtime.robot.rig.interface_checks import absent, look, refusal, take_up

if TYPE_CHECKING:
    from collections.abc import Sequence

    from runtime.host.machine.probe import Machine
    from runtime.robot.rig.file import RigBus


SO_TIMESTAMPNS, SO_MEMINFO = 35, 55  # Linux constants that Python's socket lacks
SOL_CAN_RAW, FILTER, ERROR_FILTER, RECEIVE_OWN, FD_FRAMES, JOIN_FILTERS = 101, 1, 2, 4, 5, 6
MEMINFO = struct.Struct("=9I")  # the last number counts dropped frames
STANDARD_MASK, EXTENDED_MASK = 0x7FF, 0x1FFFFFFF
EXTENDED, REMOTE, INVERTED = 0x80000000, 0x40000000, 0x20000000
FILTER_LIMIT = 512  # filters of a socket in the kernel
ERROR_CLASSES = 0x004 | 0x040 | 0x100  # of error frames: controller, bus-off, restarted
FRAME = struct.Struct("=IB3x8s")  # struct can_frame


class Interface:
    """Open SocketCAN interface.

    bus : RigBus
    listens : (arbitration id, mask, is extended) of all frames that the devices receive; None for everything
    speaks : (arbitration id, is extended) of all frames sent to them
    machine : runtime.host.machine.probe.Machine, for the checks

    socket : bound
    virtual, remarks : fields of the interface's Fitness
    strangers : Strangers, or None if everything is received

    Raises Refused.
    """

    def __init__(
        self,
        bus: RigBus,
        listens: Sequence[tuple[int, int, bool]] | None,
        speaks: Sequence[tuple[int, bool]],
        machine: Machine,
    ) -> None:
        self.bus, self.strangers = bus, None
        self.socket = _new_socket(bus)
        try:
            fitness = look(bus, machine)
            self.virtual, self.remarks = fitness.virtual, fitness.remarks
            self._set_up(listens, speaks)
        except OSError as error:
            self.close()
            raise Refused(self._problem(error, machine)) from None
        except Refused:
            self.close()
            raise

    def _set_up(self, listens, speaks):
        if self.bus.fd:
            self.socket.setsockopt(SOL_CAN_RAW, FD_FRAMES, 1)
        self.socket.setsockopt(SOL_CAN_RAW, RECEIVE_OWN, 0)
        self.socket.setsockopt(SOL_CAN_RAW, ERROR_FILTER, ERROR_CLASSES)
        self.socket.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        if listens is not None and len(listens) + len(speaks) <= FILTER_LIMIT:
            self.socket.setsockopt(SOL_CAN_RAW, FILTER, b"".join(_filter(*each) for each in listens))
            self.strangers = Strangers(self.bus, listens, speaks)
        self.socket.bind((self.bus.channel,))

    def close(self) -> None:
        """Close the sockets."""
        self.socket.close()
        if self.strangers is not None:
            self.strangers.close()

    def _problem(self, error, machine):
        """Return an error of the system as a RigProblem."""
        name = self.bus.channel
        if error.errno in (errno.EPERM, errno.EACCES):
            return _permission_problem(error)
        if error.errno in (errno.ENODEV, errno.ENXIO):
            return absent(self.bus, machine)
        if error.errno == errno.ENETDOWN:
            return refusal(self.bus, "TW114", f"{name} is down", take_up(self.bus, self.virtual)).problem
        return _other_problem(self.bus, error)


class Strangers:
    """Frames of unknown nodes, which the kernel counts at no cost to a tick."""

    def __init__(
        self, bus: RigBus, listens: Sequence[tuple[int, int, bool]], speaks: Sequence[tuple[int, bool]]
    ) -> None:
        ours: list[tuple[int, int, bool]] = [
            *listens,
            *((identifier, EXTENDED_MASK if extended else STANDARD_MASK, extended) for identifier, extended in speaks),
        ]
        self.socket = _new_socket(bus)
        self.socket.setblocking(False)
        self.socket.setsockopt(SOL_CAN_RAW, FILTER, b"".join(_filter(*each, INVERTED) for each in ours))
        self.socket.setsockopt(SOL_CAN_RAW, JOIN_FILTERS, 1)
        # the smallest possible buffer: further frames are counted, not kept
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)
        self.socket.bind((bus.channel,))

    def close(self) -> None:
        """Close the socket."""
        self.socket.close()

    def counts(self) -> tuple[int, list[str]]:
        """Return (number of frames, IDs of the first few in the format of candump)."""
        dropped = MEMINFO.unpack(self.socket.getsockopt(socket.SOL_SOCKET, SO_MEMINFO, MEMINFO.size))[-1]
        names = []
        while True:
            try:
                identifier, _, _ = FRAME.unpack(self.socket.recv(FRAME.size))
            except OSError:
                return dropped + len(names), list(dict.fromkeys(names))
            names.append(
                f"{identifier & EXTENDED_MASK:08X}" if identifier & EXTENDED else f"{identifier & STANDARD_MASK:03X}"
            )


def _filter(identifier, mask, extended, inverted=0):
    """Return one kernel filter: data frames whose identifiers equal this one in the bits of the mask."""
    kind = EXTENDED if extended else 0
    return struct.pack("=II", identifier | kind | inverted, mask | EXTENDED | REMOTE)


def _new_socket(bus):
    """Create an unbound raw CAN socket. Raises Refused."""
    family = getattr(socket, "AF_CAN", None)
    if family is None:
        raise Refused(RigProblem("TW111", "this Python has no CAN sockets", "SocketCAN requires Python on Linux"))
    try:
        return socket.socket(family, socket.SOCK_RAW, socket.CAN_RAW)
    except PermissionError as error:
        raise Refused(_permission_problem(error)) from None
    except OSError as error:
        if error.errno not in (errno.EAFNOSUPPORT, errno.EPROTONOSUPPORT, errno.ESOCKTNOSUPPORT):
            raise Refused(_other_problem(bus, error)) from None
        raise Refused(
            RigProblem(
                "TW111",
                f"this kernel, {os.uname().release}, provides no CAN socket: {error.strerror}",
                "sudo modprobe can_raw; where that fails, the kernel was built without CAN, as that of WSL 2 is: use "
                "another",
            )
        ) from None


def _other_problem(bus, error):
    """Return the problem of an interface that cannot be opened for an unexpected reason."""
    name = bus.channel
    return RigProblem(
        "TW119", f"[bus.{bus.name}] {name}: {error.strerror}", f"see: ip -details -statistics link show {name}"
    )


def _permission_problem(error):
    """Return the problem of a process that may not open CAN sockets."""
    return RigProblem(
        "TW118",
        f"the system provides no CAN socket: {error.strerror}",
        "in a container, start it with the host's network: --network host",
    )
