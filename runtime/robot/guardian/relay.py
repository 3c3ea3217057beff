"""Relay of a charge pump, which the guardian holds while it damps a joint."""

from __future__ import annotations

import fcntl
import os
import stat
import struct
from contextlib import suppress
from time import monotonic_ns
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from runtime.robot.guardian.plan_types import PlanRelay


# <linux/gpio.h>: two u64, the values and a mask of the lines
GPIO_V2_LINE_SET_VALUES_IOCTL = 0xC010B40F
VALUES = struct.Struct("=QQ")


class Relay:
    """Relay of a charge pump.

    relay : entry of the plan (runtime.robot.guardian)
    changed : ns of CLOCK_MONOTONIC of the loop's last change of the line
    """

    def __init__(self, relay: PlanRelay, changed: int) -> None:
        self.descriptor = relay["descriptor"]
        self.gpio = relay["gpio"]
        with suppress(OSError):  # the code of a diagram has closed it
            # a line of `emulate` is a socket, which accepts bytes
            self.gpio = self.gpio and not stat.S_ISSOCK(os.fstat(self.descriptor).st_mode)
        self.frames, self.hold = [bytes.fromhex(frame) for frame in relay["frames"]], round(relay["hold"] * 1e9)
        self.changed, self.sent = changed, 0

    def change(self) -> None:
        """Change the line, unless the relay may have dropped, so that no drive gets its power again.

        Ignores a disconnected line. The clock is read here, as the process may have waited for a processor.
        """
        now = monotonic_ns()
        if now - self.changed >= self.hold:
            return
        frame = self.frames[self.sent % 2]
        with suppress(OSError):
            if self.gpio:
                fcntl.ioctl(self.descriptor, GPIO_V2_LINE_SET_VALUES_IOCTL, VALUES.pack(frame[0], 1))
            else:
                os.write(self.descriptor, frame)
            self.sent += 1
            self.changed = now
