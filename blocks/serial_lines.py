"""Which serial ports have a baud rate that counts: those with a real line behind them. USB devices that only look like
a port carry what they can.
"""

import re

REAL = re.compile(r"^/dev/(tty(USB|AMA|S|THS|mxc|O|PS|SC|LP|MSM)\d+|serial\d+)$|^/dev/serial/by-(id|path)/.*-port\d+$")


def speed_of(port, baudrate):
    """bit/s of the line behind a port, 0.0 where its name does not say that there is one."""
    return float(baudrate) if REAL.match(port) else 0.0
