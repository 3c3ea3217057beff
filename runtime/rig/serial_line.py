"""Serial ports whose device talks by itself, such as a microcontroller: opened as pyserial opens them, ours alone.

What a block may say in `opening`:

    port        path, such as /dev/ttyACM0 or one below /dev/serial/by-id, which stays the same wherever it is plugged
    in serial      last characters of the serial number of its USB adapter, instead of a port
    baudrate    bit/s, 115200 by default; USB devices that are no adapters do not care
    setup       messages, as bytes, that it is told at the start, and again when it comes back
"""

import os
import time

from runtime.rig import ports
from runtime.rig.streams import Opened, one_by_one

BAUDRATE = 115200
PAUSE = 0.02  # s between messages of the set-up


def open_lines(devices):
    """{device: Opened or Trouble}"""
    return one_by_one(devices, lambda device: opened(device, device.opening()))


def opened(device, wanted):
    path = wanted.get("port") or ports.with_serial(device.path, wanted.get("serial", ""))
    port = ports.open_port(device.path, path, wanted.get("baudrate", BAUDRATE))
    for message in wanted.get("setup", ()):
        port.write(message)
        port.flush()
        time.sleep(PAUSE)
    return Opened(let_go(port), path, path=ports.by_id(path), setup=tuple(wanted.get("setup", ())))


def let_go(port):
    """The descriptor of an open pyserial port, which then is the caller's."""
    descriptor = os.dup(port.fileno())
    port.close()
    return descriptor
