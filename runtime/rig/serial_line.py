"""Serial ports whose device sends by itself, such as a microcontroller, opened for exclusive use.

Keys of `opening`:

    port        path, such as /dev/ttyACM0 or one below /dev/serial/by-id, which is independent of the USB socket
    serial      last characters of the serial number of its USB adapter, instead of a port
    baudrate    bit/s, 115200 by default; ignored by USB devices without an adapter
    setup       messages, as bytes, sent on connect and after every reconnect
"""

import time

from runtime.rig import ports
from runtime.rig.line import Opened, let_go, one_by_one

BAUDRATE = 115200
SETUP_PAUSE = 0.02  # s between messages of the set-up


def open_lines(devices):
    """Open the lines of `devices`. Returns {device: Opened or RigProblem}."""
    return one_by_one(devices, lambda device: opened(device, device.opening()))


def opened(device, wanted):
    path = wanted.get("port") or ports.with_serial(device.path, wanted.get("serial", ""))
    port = ports.open_port(device.path, path, wanted.get("baudrate", BAUDRATE))
    for message in wanted.get("setup", ()):
        port.write(message)
        port.flush()
        time.sleep(SETUP_PAUSE)
    return Opened(let_go(port), path, path=ports.by_id(path), setup=tuple(wanted.get("setup", ())))
