"""Something in a person's hands, to tune with while a robot runs: a game controller, or keys of a keyboard. No part of
what makes a robot safe.
"""

from cext.kernels.devices import input_devices as kernels
from graph import Input, Interval, Memory, Output, Param, StreamDevice

KEY, AXIS = 1, 3
STICK = (-32768, 32767)
CODES = {  # of <linux/input-event-codes.h>
    "ABS_X": 0,
    "ABS_Y": 1,
    "ABS_Z": 2,
    "ABS_RX": 3,
    "ABS_RY": 4,
    "ABS_RZ": 5,
    "ABS_HAT0X": 16,
    "ABS_HAT0Y": 17,
    "BTN_SOUTH": 304,
    "BTN_EAST": 305,
    "BTN_NORTH": 307,
    "BTN_WEST": 308,
    "BTN_TL": 310,
    "BTN_TR": 311,
    "BTN_TL2": 312,
    "BTN_TR2": 313,
    "BTN_SELECT": 314,
    "BTN_START": 315,
    "BTN_MODE": 316,
    "BTN_THUMBL": 317,
    "BTN_THUMBR": 318,
    "KEY_ESC": 1,
    "KEY_ENTER": 28,
    "KEY_LEFTCTRL": 29,
    "KEY_LEFTSHIFT": 42,
    "KEY_SPACE": 57,
    "KEY_UP": 103,
    "KEY_LEFT": 105,
    "KEY_RIGHT": 106,
    "KEY_DOWN": 108,
    **{f"KEY_{digit}": number for number, digit in enumerate("1234567890", 2)},
    **{
        f"KEY_{letter}": number
        for row, first in (("QWERTYUIOP", 16), ("ASDFGHJKL", 30), ("ZXCVBNM", 44))
        for number, letter in enumerate(row, first)
    },
}


class Controls(StreamDevice):
    """What a game controller and a keyboard share: an output for each axis and button, by the events of /dev/input.

    Where events were lost, and where it is unplugged, nothing is held: axes are 0 and buttons are up. What was held
    before a run began is not known until it moves.
    """

    axes = Param((), "1", '(name, code, lowest, highest) of each, such as ("left_x", "ABS_X", -32768, 32767)')
    buttons = Param((), "1", '(name, code) of each, such as ("a", "BTN_SOUTH")')
    device = Param("", "1", "path of its events, below /dev/input/by-id; a rig says which", dtype=str)
    dead_zone = Param(0.1, "1", "share of an axis about its middle that counts as 0", min=0.0, below=1.0, fixed=True)

    age = Output("s", "since anything was heard of it: it tells of changes alone")
    connected = Output("1", "whether it is there, as far as it has been heard", dtype=bool)
    missed = Output("1", "how often events were lost", dtype=int)
    plan = Memory((), "kind, code, lowest and highest of each axis and button")

    line = "evdev"
    decode = kernels.decode
    hardware = ("device",)

    def configure(self):
        super().configure()
        named, self.plan = declared(self, type(self).outputs)
        ports = {
            name: Output("1", "of the axis, -1 to 1", range=(-1.0, 1.0))
            if kind == AXIS
            else Output("1", "whether it is down", dtype=bool)
            for name, kind in named.items()
        }
        self.outputs = {name: port.named(name) for name, port in ports.items()} | type(self).outputs

    def opening(self):
        return {"device": self.device}

    def output_range(self):
        return {"age": Interval(0.0), "connected": Interval(0.0, 1.0), "missed": Interval(0.0)} | {
            name: Interval(0.0, 1.0) for name, port in self.outputs.items() if port.dtype == "bool"
        }

    def emulator(self, **parameters):
        return EmulatedControls.of(self, **parameters)


class GameController(Controls):
    """A game controller: sticks from −1 to 1 and buttons, for tuning. By default the sticks and letters of those that
    Linux calls xpad.

    Its ranges: `evtest` or `cat /proc/bus/input/devices`. Everything else is as of Controls.
    """

    axes = Param(
        tuple(
            (f"{side}_{axis}", f"ABS_{code}{axis.upper()}", *STICK)
            for side, code in (("left", ""), ("right", "R"))
            for axis in "xy"
        ),
        "1",
        Controls.parameters["axes"].description,
    )
    buttons = Param(
        (("a", "BTN_SOUTH"), ("b", "BTN_EAST"), ("x", "BTN_NORTH"), ("y", "BTN_WEST"), ("start", "BTN_START")),
        "1",
        Controls.parameters["buttons"].description,
    )


class Keyboard(Controls):
    """Keys of a keyboard, wherever the cursor is: each is down or up. By default the space bar and the arrows. As of
    Controls in all else.
    """

    buttons = Param(
        (("space", "KEY_SPACE"), ("up", "KEY_UP"), ("down", "KEY_DOWN"), ("left", "KEY_LEFT"), ("right", "KEY_RIGHT")),
        "1",
        Controls.parameters["buttons"].description,
    )


class EmulatedControls(StreamDevice):
    """Controls that are not there: an event for each that changes, as Linux tells them, for a plant."""

    axes, buttons = Controls.parameters["axes"], Controls.parameters["buttons"]

    plan = Memory((), "kind, code, lowest and highest of each axis and button")
    last = Memory((), "value of each that was told")

    line = "evdev"
    decode = kernels.emulated_decode
    encode = kernels.emulated_encode

    @classmethod
    def of(cls, controls, **parameters):
        """The emulator of one block of a robot."""
        return cls(bus=controls.bus, axes=controls.axes, buttons=controls.buttons, **parameters)

    def configure(self):
        super().configure()
        named, self.plan = declared(self, {})
        self.inputs = {
            name: Input(
                "1",
                "of the axis, -1 to 1" if kind == AXIS else "whether it is down",
                default=0.0 if kind == AXIS else False,
                dtype=float if kind == AXIS else bool,
            ).named(name)
            for name, kind in named.items()
        }
        self.last = (0.0,) * len(named)


def declared(block, taken):
    """({name: kind} of axes and buttons, the plan of a kernel). ValueError"""
    named, plan = {}, []
    for kind, entries, what in (
        (AXIS, block.axes, "(name, code, lowest, highest)"),
        (KEY, block.buttons, "(name, code)"),
    ):
        for entry in entries:
            if not isinstance(entry, (tuple, list)) or len(entry) != (4 if kind == AXIS else 2):
                raise ValueError(f"{'an axis' if kind == AXIS else 'a button'} is {what}, got {entry!r}")
            name, code, low, high = (*entry, 0, 1)[:4]
            words = named.keys() | taken.keys() | block.parameters.keys()
            if not isinstance(name, str) or not name.isidentifier() or name in words or hasattr(StreamDevice, name):
                raise ValueError(f"{name!r} is no name that is free here")
            if code not in CODES and not isinstance(code, int):
                raise ValueError(f"{name}: no code is called {code!r}; give its number, as evtest tells it")
            if not low < high:
                raise ValueError(f"{name}: its lowest value is below its highest, got {low!r} and {high!r}")
            named[name] = kind
            plan += [float(kind), float(CODES[code] if code in CODES else code), float(low), float(high)]
    return named, tuple(plan)
