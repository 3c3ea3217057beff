"""The relay of a charge pump, held by the guardian while it damps a joint."""

import fcntl
import os
import struct
from contextlib import suppress

# of <linux/gpio.h>; two u64: values, and a mask of the lines that they are for
GPIO_V2_LINE_SET_VALUES_IOCTL = 0xC010B40F
VALUES = struct.Struct("=QQ")


class Relay:
    """
    relay : of the plan (runtime.guardian)
    changed : ns, CLOCK_MONOTONIC at which the loop changed the line last
    """

    def __init__(self, relay, changed):
        self.descriptor, self.gpio = relay["descriptor"], relay["gpio"]
        self.frames, self.hold = [bytes.fromhex(frame) for frame in relay["frames"]], round(relay["hold"] * 1e9)
        self.changed, self.sent = changed, 0

    def change(self, now):
        """Change the line once more, unless the relay may have dropped: no drive gets its power back. A line that is
        gone is left alone.
        """
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
