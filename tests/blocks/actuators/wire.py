"""One device of a compiled diagram, its native decode and encode called one frame at a time through the public kernel
ABI.
"""

import ctypes

import numpy as np

from cext.schedule.kernel_table import address, call_kernel
from graph import Diagram, compile
from graph.arena_layout import kernel_table

FOREIGN, TAKEN, IDLE, MALFORMED = 0, 1, 7, -1  # cext/abi.pxd: what a decode returns
NOT_FINITE, OUT_OF_LIMITS = -1, -2  # and an encode that refuses
EXTENDED, REMOTE, ERROR_FRAME = 0x80000000, 0x40000000, 0x20000000
AUTHORITY = 6  # slot of the share of a command that is let through


class Frame(ctypes.Structure):
    _fields_ = [
        ("time", ctypes.c_int64),
        ("id", ctypes.c_uint32),
        ("length", ctypes.c_uint8),
        ("flags", ctypes.c_uint8),
        ("bus", ctypes.c_uint8),
        ("sent", ctypes.c_uint8),
        ("data", ctypes.c_uint8 * 64),
    ]


TABLES = (ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p)


class Wired:
    """`Wired(CubeMars, "AK80-9", can_id=1)` compiles a diagram of that device alone; its ports, parameters and memory
    are items by name.
    """

    def __init__(self, device, *values, **parameters):
        with Diagram("wired", rate=200) as diagram:
            self.block = device(*values, **parameters)
            self.block(**{name: port.default or 0.0 for name, port in self.block.inputs.items()})
        self.schedule = compile(diagram)
        steps = self.schedule.devices[0]
        self.arena = self.schedule.arena.copy()
        self.arena[AUTHORITY] = 1.0
        self.tables = [
            [np.array(words, np.int32) for words in table] for table in (steps.decode_table, steps.encode_table)
        ]
        self.items = self.schedule.items[self.block.path]
        self.place = {name: slice(slot, slot + size) for name, (slot, size) in self.items.items()}
        self.native_decode = ctypes.CFUNCTYPE(ctypes.c_int, *TABLES, ctypes.POINTER(Frame))(
            address(steps.decode, "decode")
        )
        self.native_encode = ctypes.CFUNCTYPE(ctypes.c_int, *TABLES, ctypes.POINTER(Frame))(
            address(steps.encode, "encode")
        )
        self.point()
        self.frames = (Frame * 4)()

    def point(self):
        self.of_decode, self.of_encode = (
            (self.arena.ctypes.data, *(words.ctypes.data for words in table)) for table in self.tables
        )

    @classmethod
    def again(cls, wired):
        """Another one in its first state, without compiling."""
        new = cls.__new__(cls)
        vars(new).update(vars(wired), arena=wired.schedule.arena.copy(), frames=(Frame * 4)())
        new.arena[AUTHORITY] = 1.0
        new.point()
        return new

    def __getitem__(self, name):
        values = self.arena[self.place[name]]
        return float(values[0]) if len(values) == 1 else values.copy()

    def __setitem__(self, name, value):
        self.arena[self.place[name]] = value

    def hear(self, identifier, data, length=None, time=0):
        """Offer it a frame of so many ns; data beyond `length` is there, as a controller's buffer would have it.
        Returns what decode says.
        """
        frame = Frame(id=identifier, length=len(data) if length is None else length, time=time)
        frame.data[: len(data)] = data
        return self.native_decode(*self.of_decode, frame)

    def say(self, **inputs):
        """Set inputs, encode: a list of (identifier, data), or the number below zero by which it refuses."""
        for name, value in inputs.items():
            self[name] = value
        count = self.native_encode(*self.of_encode, self.frames)
        return count if count < 0 else [(f.id, bytes(f.data[: f.length])) for f in self.frames[:count]]

    def step(self, **inputs):
        """Set inputs and run the device's own step, where it has one."""
        for name, value in inputs.items():
            self[name] = value
        table = kernel_table(self.block, self.block.kernel, self.items)
        assert call_kernel(self.block.kernel, self.arena, table) == 0
