"""Game controllers and keyboards of /dev/input.

Keys of `opening`: device, a path, preferably one below /dev/input/by-id.
"""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path
from typing import TYPE_CHECKING

from runtime.robot.rig.errors import Refused, RigProblem
from runtime.robot.rig.line import Opened, one_by_one

if TYPE_CHECKING:
    from collections.abc import Iterable

    from graph import StreamDevice


EVENT = 24  # bytes of struct input_event with 64-bit time stamps
BY_ID = Path("/dev/input/by-id")


def open_lines(devices: Iterable[StreamDevice]) -> dict[StreamDevice, Opened | RigProblem]:
    """Open the lines of `devices`. Returns {device: Opened or RigProblem}."""
    return one_by_one(devices, lambda device: open_line(device.path, **device.opening()))


def open_line(path: str, device: str) -> Opened:
    """Open an input device. path : block named in messages. Raises Refused."""
    name = f'[device."{path}"] device = "{device}"'
    if not device:
        raise Refused(
            RigProblem(
                "TW127", f'[device."{path}"]: device is missing', f'write device = "{BY_ID}/..."; {_devices_text()}'
            )
        )
    try:
        if not stat.S_ISCHR(os.stat(device).st_mode):
            raise Refused(RigProblem("TW127", f"{name} is not an input device", _devices_text()))
        return Opened(os.open(device, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), device, path=device, record=EVENT)
    except OSError as error:
        if error.errno in (errno.EACCES, errno.EPERM):
            hint = (
                "sudo usermod -aG input $USER, then log in again. Members of that group can read every key that is "
                "pressed on this computer"
            )
            raise Refused(RigProblem("TW118", f"{name}: {error.strerror}", hint)) from None
        raise Refused(RigProblem("TW127", f"{name}: {error.strerror}", _devices_text())) from None


def _devices_text():
    """Return a hint that lists the input devices of this computer."""
    devices = sorted(BY_ID.glob("*event*")) if BY_ID.is_dir() else []
    return (
        f"there are {', '.join(map(str, devices))}"
        if devices
        else "this computer has none: check that it is plugged in"
    )
