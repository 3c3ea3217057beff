"""Game controllers and keyboards, as /dev/input has them. What a block says in `opening`: device, a path, best one
below /dev/input/by-id.
"""

import errno
import os
import stat
from pathlib import Path

from runtime.rig.errors import Refused, Trouble
from runtime.rig.streams import Opened, one_by_one

EVENT = 24  # bytes of struct input_event where a time has 64 bits
BY_ID = Path("/dev/input/by-id")


def open_lines(devices):
    """{device: Opened or Trouble}"""
    return one_by_one(devices, lambda device: opened(device.path, **device.opening()))


def opened(who, device):
    name = f'[device."{who}"] device = "{device}"'
    if not device:
        raise Refused(Trouble("TW127", f'[device."{who}"] names no device', f'write device = "{BY_ID}/..."; {there()}'))
    try:
        if not stat.S_ISCHR(os.stat(device).st_mode):
            raise Refused(Trouble("TW127", f"{name} gives no events", there()))
        return Opened(os.open(device, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), device, path=device, record=EVENT)
    except OSError as error:
        if error.errno in (errno.EACCES, errno.EPERM):
            hint = (
                "sudo usermod -aG input $USER, then log in again: who is in that group can read every key that is "
                "pressed on this computer"
            )
            raise Refused(Trouble("TW118", f"{name}: {error.strerror}", hint)) from None
        raise Refused(Trouble("TW127", f"{name}: {error.strerror}", there())) from None


def there():
    found = sorted(BY_ID.glob("*event*")) if BY_ID.is_dir() else []
    return f"there are {', '.join(map(str, found))}" if found else "this computer has none: is it plugged in?"
