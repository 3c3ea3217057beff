"""Game controllers and keyboards, for tuning during a run. No safety function depends on them."""

from __future__ import annotations

from typing import Any

from blocks._plumbing.ports import check_port_names
from cext.kernels.devices import input_devices as kernels
from graph import Input, Interval, Memory, Output, Param, StreamDevice
from graph.narrowing import is_row

KEY, AXIS = 1, 3
STICK = (-32768, 32767)
CODES = {  # from <linux/input-event-codes.h>
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
    """Input device with one output per axis and button, read from the events of /dev/input.

    If events are lost or the device is unplugged, all axes are 0 and all buttons are up. The state before the run is
    unknown until an axis or button changes.
    """

    axes = Param((), "1", 'axes as (name, code, minimum, maximum), such as ("left_x", "ABS_X", -32768, 32767)')
    buttons = Param((), "1", 'buttons as (name, code), such as ("a", "BTN_SOUTH")')
    device = Param("", "1", "path of the event device, below /dev/input/by-id; set in the rig file", dtype=str)
    dead_zone = Param(0.1, "1", "share of each axis about its centre that reads as 0", min=0.0, below=1.0, fixed=True)

    age = Output("s", "time since the newest event; devices report changes only")
    connected = Output("1", "true once an event has arrived, until the device is unplugged", dtype=bool)
    missed = Output("1", "number of times that events were lost", dtype=int)
    plan = Memory((), "kind, code, minimum and maximum of each axis and button")

    line = "evdev"
    decode = kernels.decode
    hardware = ("device",)

    def configure(self) -> None:
        super().configure()
        named, self.plan = declared(self, type(self).outputs)
        ports = {
            name: Output("1", "axis position", range=(-1.0, 1.0))
            if kind == AXIS
            else Output("1", "true while pressed", dtype=bool)
            for name, kind in named.items()
        }
        self.outputs = {name: port.named(name) for name, port in ports.items()} | type(self).outputs

    def opening(self) -> dict[str, Any]:
        return {"device": self.device}

    def output_range(self) -> dict[str, Interval]:
        return {"age": Interval(0.0), "connected": Interval(0.0, 1.0), "missed": Interval(0.0)} | {
            name: Interval(0.0, 1.0) for name, port in self.outputs.items() if port.dtype == "bool"
        }

    def emulator(self, **parameters: Any) -> Any:
        return EmulatedControls.of(self, **parameters)


class GameController(Controls):
    """Game controller with sticks from −1 to 1 and buttons, for tuning.

    The defaults are the sticks and lettered buttons of controllers with the Linux driver xpad. `evtest` prints the
    codes and ranges of others. If it is unplugged, all axes are 0 and all buttons are up.
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
    """Keyboard with one boolean output per key, independent of the input focus, for tuning.

    The defaults are the space bar and the arrow keys. If it is unplugged, all keys are up.
    """

    buttons = Param(
        (("space", "KEY_SPACE"), ("up", "KEY_UP"), ("down", "KEY_DOWN"), ("left", "KEY_LEFT"), ("right", "KEY_RIGHT")),
        "1",
        Controls.parameters["buttons"].description,
    )


class EmulatedControls(StreamDevice):
    """Emulated game controller or keyboard: one Linux input event per change."""

    axes, buttons = Controls.parameters["axes"], Controls.parameters["buttons"]

    plan = Memory((), "kind, code, minimum and maximum of each axis and button")
    last = Memory((), "last reported value of each")

    line = "evdev"
    decode = kernels.emulated_decode
    encode = kernels.emulated_encode

    @classmethod
    def of(cls, controls: Controls, **parameters: Any) -> EmulatedControls:
        """Return the emulator of one GameController or Keyboard."""
        return cls(bus=controls.bus, axes=controls.axes, buttons=controls.buttons, **parameters)

    def configure(self) -> None:
        super().configure()
        named, self.plan = declared(self, {})
        self.inputs = {
            name: Input(
                "1",
                "axis position from -1 to 1" if kind == AXIS else "true while pressed",
                default=0.0 if kind == AXIS else False,
                dtype=float if kind == AXIS else bool,
            ).named(name)
            for name, kind in named.items()
        }
        self.last = (0.0,) * len(named)


def declared(block: Any, taken: dict[str, Output]) -> tuple[dict[str, int], tuple[float, ...]]:
    """Return ({name: kind} of axes and buttons, plan of the kernel). ValueError for an invalid declaration."""
    named: dict[str, int] = {}
    plan: list[float] = []
    for kind, entries, what in (
        (AXIS, block.axes, "(name, code, minimum, maximum)"),
        (KEY, block.buttons, "(name, code)"),
    ):
        for entry in entries:
            if not is_row(entry) or len(entry) != (4 if kind == AXIS else 2):
                raise ValueError(f"{'an axis' if kind == AXIS else 'a button'} must be {what}, got {entry!r}")
            values: tuple[Any, ...] = (*entry, 0, 1)[:4]
            name, code, low, high = values
            check_port_names([*named, name], taken.keys() | block.parameters.keys() | set(dir(StreamDevice)))
            if code not in CODES and not isinstance(code, int):
                raise ValueError(f"{name}: unknown code {code!r}. Use the number that evtest prints")
            if not low < high:
                raise ValueError(f"{name}: the minimum must be below the maximum, got {low!r} and {high!r}")
            named[name] = kind
            plan += [float(kind), float(code if isinstance(code, int) else CODES[code]), float(low), float(high)]
    return named, tuple(plan)
