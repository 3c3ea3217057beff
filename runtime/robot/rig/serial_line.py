"""Serial ports whose device sends by itself, such as a microcontroller, opened for exclusive use.

Keys of `opening`:

    port        path, such as /dev/ttyACM0 or one below /dev/serial/by-id, which is independent of the USB socket
    serial      last characters of the serial number of its USB adapter, instead of a port
    baudrate    bit/s, 115200 by default; ignored by USB devices without an adapter
    setup       messages, as bytes, sent on connect and after every reconnect
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from runtime.robot.rig import ports
from runtime.robot.rig.line import Opened, detach, one_by_one

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from typing import Any

    from graph import StreamDevice
    from runtime.robot.rig.errors import RigProblem


BAUDRATE = 115200
SETUP_PAUSE = 0.02  # s between messages of the set-up


def open_lines(devices: Iterable[StreamDevice]) -> dict[StreamDevice, Opened | RigProblem]:
    """Open the lines of `devices`. Returns {device: Opened or RigProblem}."""
    return one_by_one(devices, lambda device: open_line(device, device.opening()))


def open_line(device: StreamDevice, options: Mapping[str, Any]) -> Opened:
    """Open the port of a device and send its set-up. options : options as returned by `opening`. Raises Refused."""
    path = options.get("port") or ports.with_serial(device.path, options.get("serial", ""))
    port = ports.open_port(device.path, path, options.get("baudrate", BAUDRATE))
    for message in options.get("setup", ()):
        port.write(message)
        port.flush()
        time.sleep(SETUP_PAUSE)
    return Opened(detach(port), path, path=ports.by_id(path), setup=tuple(options.get("setup", ())))
