"""Checks of serial ports with CAN adapters such as slcan, before the guardian opens them."""

from __future__ import annotations

import errno
import getpass
import grp
import os
import stat
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from runtime.host.machine.ports import SERIAL
from runtime.host.suggestions import suggestion
from runtime.robot.rig.errors import Refused, RigProblem
from runtime.robot.rig.udp import holder_of

if TYPE_CHECKING:
    from runtime.robot.rig.file import RigBus


RULES = "/etc/udev/rules.d/70-tickwork.rules"


def look_at_port(bus: RigBus, folder: str = "/dev") -> None:
    """Raise Refused if the channel of a bus is a device that cannot be opened. Ignores other channels.

    bus : RigBus
    folder : folder of the device files
    """
    path = bus.channel.partition("@")[0]  # slcan's "PORT@BAUDRATE"
    if not path.startswith("/"):
        return
    name = f"[bus.{bus.name}] {path}"
    try:
        if not stat.S_ISCHR(os.stat(path).st_mode):
            raise Refused(RigProblem("TW125", f"{name} is not a serial port", _ports_text(path, folder)))
        descriptor = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as error:
        raise Refused(_open_problem(name, path, error, folder)) from None
    os.close(descriptor)
    owner = holder(path)
    if owner:
        raise Refused(_in_use(name, owner))


def _open_problem(name, path, error, folder):
    """Return a RigProblem that explains why a port cannot be opened."""
    if error.errno in (errno.EACCES, errno.EPERM):
        return RigProblem("TW124", f"{name}: {error.strerror}", permission(path))
    if error.errno in (errno.ENOENT, errno.ENXIO, errno.ENODEV, errno.ENOTDIR):
        return RigProblem("TW125", f"{name}: no such port", _ports_text(path, folder))
    if error.errno == errno.EBUSY:
        return _in_use(name, holder(path))
    return RigProblem("TW119", f"{name}: {error.strerror}", "check that the adapter is plugged in and powered")


def _in_use(name, owner):
    """Return the problem of a port that another process has open. owner : that process, "" if unknown"""
    remedy = "end that process first: two readers of a port each lose data"
    if owner:
        return RigProblem("TW126", f"{name} is in use by {owner}", remedy)
    return RigProblem(
        "TW126",
        f"{name} is in use by a process that this user cannot see",
        f"{remedy}; find it: sudo fuser -v {name.split()[-1]}",
    )


def holder(path: str | Path) -> str:
    """Return the process that has a port open, in the format of runtime.robot.rig.udp.holder_of."""
    real = os.path.realpath(path)
    return holder_of(lambda target: target == real)


def permission(path: str | Path) -> str:
    """Return the commands that give this user access to a port."""
    group = "dialout"
    with suppress(OSError, KeyError):
        group = grp.getgrgid(os.stat(path).st_gid).gr_name
    user = "$USER"
    with suppress(OSError, KeyError):
        user = getpass.getuser()
    kind = Path(os.path.realpath(path)).name.rstrip("0123456789")
    rule = f'KERNEL=="{kind}[0-9]*", MODE="0666"'
    rule = f"echo '{rule}' | sudo tee {RULES} && sudo udevadm control --reload && sudo udevadm trigger"
    if group in ("root", "tty"):
        return f"give all users access: {rule}"
    return f"sudo usermod -aG {group} {user}, then log in again; or give all users access: {rule}"


def _ports_text(path, folder):
    """Return a hint that lists the ports of this machine, with the best match first."""
    names = sorted(str(port) for pattern in SERIAL for port in Path(folder).glob(pattern))
    if not names:
        return "no serial port found: check that the adapter is plugged in"
    near = suggestion(path, names)
    return (f"{near} " if near else "") + f"there are {', '.join(names)}"
