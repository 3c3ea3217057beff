"""A sensor's block that is fed bytes by hand, as its line would bring them."""

import numpy as np

from blocks.imus import MicroStrain
from blocks.imus.microstrain.descriptors import EXTRA, STANDARD_GRAVITY
from cext.schedule.kernel_table import feed
from graph import Diagram

EVERYTHING = ("accel", "gyro", "mag", "quaternion", "euler", "temperature", *EXTRA)
TAKEN, NOTED, MALFORMED = 1, 2, -1  # of cext/abi.pxd
GRAVITY = STANDARD_GRAVITY


class Hearing:
    """A MicroStrain with these parameters, on an arena of its own."""

    def __init__(self, **parameters):
        with Diagram("robot", rate=200):
            self.block = MicroStrain(name="imu", **parameters)
        self.scratch = self.block.scratch
        self.scratch.build({"tare": False})

    def feed(self, data, chunk=64, time=0.0, flags=0, identifier=0):
        """{answer of its decode: how often}. time : s"""
        return feed(
            self.block.decode,
            self.scratch.arena,
            self.scratch.table(self.block.decode),
            data,
            chunk,
            round(time * 1e9),
            identifier,
            flags,
        )

    def __getitem__(self, name):
        slot = self.scratch.slots_of[name]
        size = int(np.prod(self.scratch.shapes[name], dtype=int))
        values = self.scratch.arena[slot : slot + size]
        return values.copy() if size > 1 else float(values[0])
