"""GPIO lines of the computer: switches, emergency stops and synchronisation pulses.

Lines are accessed through libgpiod (pip install 'tickwork[gpio]'). Edges carry the kernel's time stamps, so a press
between two ticks is not missed and edges are timed to a few µs. Levels are logical levels, after `active_low`.
"""

from __future__ import annotations

from typing import Any

from cext.kernels import no_io
from cext.kernels.devices import gpio as kernels
from graph import Input, Interval, Memory, Output, Param, StreamDevice

BIASES = ("as_is", "disabled", "pull_up", "pull_down")


class GpioLine:
    """Parameters that select a line and describe its wiring."""

    chip = Param("/dev/gpiochip0", "1", "path of the GPIO chip; unix:PATH for `emulate`", dtype=str)
    pin = Param(
        "", "1", 'name of the line, such as "GPIO17", or its number on the chip; set in the rig file', dtype=str
    )
    active_low = Param(
        False, "1", "true if a low voltage is active, as for a switch to ground", fixed=True, kernel=False
    )

    bias: Any
    debounce: Any
    parameters: dict[str, Param[Any]]

    line = "gpio"
    hardware = ("chip", "pin", "active_low", "bias", "debounce")

    def opening(self) -> dict[str, Any]:
        """Return the arguments for opening the line."""
        return {"chip": self.chip, "pin": self.pin, "active_low": self.active_low, "output": True} | (
            {"bias": self.bias, "debounce": self.debounce, "output": False} if "bias" in self.parameters else {}
        )


class GpioInput(GpioLine, StreamDevice):
    """GPIO input: level, number of edges, and their times by the kernel's clock.

    For buttons and switches; `SyncIn` is for the edges of another system. Times are the kernel's time stamps of the
    edges, not the times of the ticks that receive them. They are measured from the start of arming, like the frames of
    a recording.
    """

    bias = Param("as_is", "1", "bias resistor of the chip", choices=BIASES)
    debounce = Param(
        0.0,
        "s",
        "time for which a level must be stable; 0 disables debouncing",
        min=0.0,
        max=1.0,
        fixed=True,
        kernel=False,
    )

    on = Output("1", "true while the line is active", dtype=bool)
    known = Output("1", "true while the level is known", dtype=bool)
    rises = Output("1", "number of edges to active", dtype=int)
    falls = Output("1", "number of edges to inactive", dtype=int)
    rise_time = Output("s", "time of the newest edge to active, since the start of arming")
    fall_time = Output("s", "time of the newest edge to inactive, since the start of arming")
    missed = Output("1", "number of edges that exceeded the kernel's buffer", dtype=int)
    age = Output("s", "time since the newest event")
    state = Memory(0.0, "sequence number of the next event, 0 before the first")

    decode = kernels.decode

    def output_range(self) -> dict[str, Interval]:
        return {
            "on": Interval(0.0, 1.0),
            "known": Interval(0.0, 1.0),
            "rises": Interval(0.0),
            "falls": Interval(0.0),
            "missed": Interval(0.0),
            "age": Interval(0.0),
        }

    def emulator(self, **parameters: Any) -> Any:
        return EmulatedGpio(bus=self.bus, **parameters)


class SyncIn(GpioInput):
    """Synchronisation input: number and times of the edges of another system, such as motion capture.

    The edge appears in both recordings. `on` is true from a rising edge to the next falling edge: during the other
    recording, if that system holds the line high for its duration.
    """


class EStopSwitch(GpioLine, StreamDevice):
    """Emergency stop on a GPIO line: pressed unless the line is active.

    An open contact and a broken wire stop the robot. Connect a normally closed contact between the line and ground
    (`bias="pull_up"`, `active_low=True`, the defaults). A press ends the run in the tick that receives it: no command
    of that tick is sent. It is latched, however short it is, even during arming. A disconnected line and an unknown
    level count as a press. This is software, and never replaces a switch that cuts the power of the motors.
    """

    active_low = Param(
        True, "1", "true if a low voltage means released, as for a contact to ground", fixed=True, kernel=False
    )
    bias = Param("pull_up", "1", "bias resistor of the chip", choices=BIASES)
    debounce = Param(
        0.0,
        "s",
        "time for which a level must be stable; 0 detects every press, however short",
        min=0.0,
        max=0.02,
        fixed=True,
        kernel=False,
    )

    pressed = Output("1", "true while pressed", dtype=bool)
    known = Output("1", "true once the level is known", dtype=bool)
    age = Output("s", "time since the newest event; the line reports changes only")
    state = Memory(0.0, "1 once pressed since arming")

    decode = kernels.estop_decode
    encode = kernels.estop_encode

    def output_range(self) -> dict[str, Interval]:
        return {"pressed": Interval(0.0, 1.0), "known": Interval(0.0, 1.0), "age": Interval(0.0)}

    def emulator(self, **parameters: Any) -> Any:
        return EmulatedGpio(bus=self.bus, rest=True, **parameters)


class SyncOut(GpioLine, StreamDevice):
    """Synchronisation output: a pulse at tick 0, where the recording starts, and whenever `pulse` is true.

    The pulse is sent at the end of the tick. After the run the line is released, and its level depends on the chip and
    the connected device.
    """

    duration = Param(0.1, "s", "duration of a pulse", above=0.0, max=3600.0, fixed=True)

    pulse = Input("1", "true starts a pulse or extends the present one", default=False, dtype=bool)
    high = Output("1", "true while the line is active", dtype=bool)
    state = Memory((0.0,) * 3, "end of the pulse in s; 1 after the first pulse; level sent + 1")

    decode = no_io.ignore_all
    encode = kernels.pulse
    sent_outputs = ("high",)
    hardware = ("chip", "pin", "active_low")

    def output_range(self, pulse: Interval) -> dict[str, Interval]:
        return {"high": Interval(0.0, 1.0)}

    def emulator(self, **parameters: Any) -> Any:
        return EmulatedGpio(bus=self.bus, **parameters)


class EmulatedGpio(StreamDevice):
    """Emulated GPIO line: one Linux event per change of an input's level, and the level that the robot sets."""

    rest = Param(False, "1", "level if the input `level` is not connected", fixed=True, kernel=False)

    level = Input("1", "true while the line is active", default=False, dtype=bool)
    lost = Input("1", "true while the chip is disconnected", default=False, dtype=bool)
    on = Output("1", "true while the robot holds the line active, as an output", dtype=bool)
    state = Memory((0.0,) * 3, "reported level + 1, number of events, 1 while disconnected")

    line = "gpio"
    decode = kernels.emulated_decode
    encode = kernels.emulated_encode

    def configure(self) -> None:
        super().configure()
        lost = type(self).inputs["lost"]
        self.inputs = {
            "level": Input("1", "true while the line is active", default=self.rest, dtype=bool).named("level"),
            "lost": lost,
        }

    def output_range(self, **inputs: Interval) -> dict[str, Interval]:
        return {"on": Interval(0.0, 1.0)}
