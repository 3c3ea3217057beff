"""Baud rates of serial ports: hardware ports have one, USB devices with a virtual port do not."""

import re

HARDWARE_PORT = re.compile(
    r"^/dev/(tty(USB|AMA|S|THS|mxc|O|PS|SC|LP|MSM)\d+|serial\d+)$|^/dev/serial/by-(id|path)/.*-port\d+$"
)


def speed_of(port: str, baudrate: int) -> float:
    """Return the speed of a port's line in bit/s, 0.0 unless its name identifies a hardware port."""
    return float(baudrate) if HARDWARE_PORT.match(port) else 0.0
