"""Game controllers and keyboards of /dev/input.

Keys of `opening`: device, a path, preferably one below /dev/input/by-id.
"""

import errno
import os
import stat
from pathlib import Path

from runtime.rig.errors import Refused, RigProblem
from runtime.rig.line import Opened, one_by_one

EVENT = 24  # bytes of struct input_event with 64-bit time stamps
BY_ID = Path("/dev/input/by-id")


def open_lines(devices):
    """Open the lines of `devices`. Returns {device: Opened or RigProblem}."""
    return one_by_one(devices, lambda device: opened(device.path, **device.opening()))


def opened(path, device):
    name = f'[device."{path}"] device = "{device}"'
    if not device:
        raise Refused(
            RigProblem("TW127", f'[device."{path}"]: device is missing', f'write device = "{BY_ID}/..."; {there()}')
        )
    try:
        if not stat.S_ISCHR(os.stat(device).st_mode):
            raise Refused(RigProblem("TW127", f"{name} is not an input device", there()))
        return Opened(os.open(device, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), device, path=device, record=EVENT)
    except OSError as error:
        if error.errno in (errno.EACCES, errno.EPERM):
            hint = (
                "sudo usermod -aG input $USER, then log in again. Members of that group can read every key that is "
                "pressed on this computer"
            )
            raise Refused(RigProblem("TW118", f"{name}: {error.strerror}", hint)) from None
        raise Refused(RigProblem("TW127", f"{name}: {error.strerror}", there())) from None


def there():
    devices = sorted(BY_ID.glob("*event*")) if BY_ID.is_dir() else []
    return (
        f"there are {', '.join(map(str, devices))}"
        if devices
        else "this computer has none: check that it is plugged in"
    )
