"""Inputs and outputs of the computer itself, on its GPIO header: switches, emergency stops, and pulses that
synchronise.

A line is taken through libgpiod (the extra `gpio`: pip install 'tickwork[gpio]'), and its edges come with the kernel's
own times, so that a press between two ticks is not missed and an edge is timed to some µs. A level is that which the
kernel says after `active_low`.
"""

from typing import Any

from cext.kernels import no_io
from cext.kernels.devices import gpio as kernels
from graph import Input, Interval, Memory, Output, Param, StreamDevice

BIASES = ("as_is", "disabled", "pull_up", "pull_down")


class GpioLine:
    """Parameters that say which line, and how it is wired."""

    chip = Param("/dev/gpiochip0", "1", "the chip that it is on", dtype=str)
    pin = Param("", "1", 'the line: its name, such as "GPIO17", or its number on the chip; a rig says which', dtype=str)
    active_low = Param(False, "1", "whether a low voltage is active: a switch to ground", fixed=True, kernel=False)

    bias: Any
    debounce: Any
    parameters: dict[str, Param[Any]]

    line = "gpio"
    hardware = ("chip", "pin", "active_low", "bias", "debounce")

    def opening(self):
        return {"chip": self.chip, "pin": self.pin, "active_low": self.active_low, "output": True} | (
            {"bias": self.bias, "debounce": self.debounce, "output": False} if "bias" in self.parameters else {}
        )


class GpioInput(GpioLine, StreamDevice):
    """An input of the computer: its level, how often it rose and fell, and when, by the kernel's clock.

    For buttons and switches, and as `SyncIn` for what another system's edge says. Times are those of the edge itself,
    as the kernel stamped it, not of the tick that heard of it; they count from where the frames of a recording do, the
    beginning of arming.
    """

    bias = Param("as_is", "1", "resistor of the chip at the line", choices=BIASES)
    debounce = Param(
        0.0,
        "s",
        "for which a level has to stay before it counts; 0 for none",
        min=0.0,
        max=1.0,
        fixed=True,
        kernel=False,
    )

    on = Output("1", "whether it is active", dtype=bool)
    known = Output("1", "whether its level is known: it is there", dtype=bool)
    rises = Output("1", "edges to active so far", dtype=int)
    falls = Output("1", "edges from active so far", dtype=int)
    rise_time = Output("s", "of the newest edge to active, since arming began")
    fall_time = Output("s", "of the newest edge from active, likewise")
    missed = Output("1", "edges that were more than the kernel could keep", dtype=int)
    age = Output("s", "since anything was heard of it")
    state = Memory(0.0, "number of the next event of this line, 0 before the first")

    decode = kernels.decode

    def output_range(self):
        return {
            "on": Interval(0.0, 1.0),
            "known": Interval(0.0, 1.0),
            "rises": Interval(0.0),
            "falls": Interval(0.0),
            "missed": Interval(0.0),
            "age": Interval(0.0),
        }

    def emulator(self, **parameters):
        return EmulatedGpio(bus=self.bus, **parameters)


class SyncIn(GpioInput):
    """The edge by which another system, such as motion capture, says that it has begun: its number and its time, in
    both recordings.

    `on` is true from a rise to the next fall: while the other one records, where it holds its line up for that. The
    rest is as of GpioInput.
    """


class EStopSwitch(GpioLine, StreamDevice):
    """An emergency stop on a GPIO line: pressed unless the line is active, so that an open contact and a broken wire
    stop the robot.

    Wire a contact that is closed as long as nobody presses it between the line and ground (`bias="pull_up"`,
    `active_low=True`, as it is here by default). A press ends the run in the tick that hears of it, no command of that
    tick is sent, and it is latched, however short it was, even while the robot is being armed. So does a line that is
    gone, and one whose level is not known. It is software: it never replaces a switch that cuts the power of the
    motors.
    """

    active_low = Param(True, "1", "whether a low voltage is released: a contact to ground", fixed=True, kernel=False)
    bias = Param("pull_up", "1", "resistor of the chip at the line", choices=BIASES)
    debounce = Param(
        0.0,
        "s",
        "for which a level has to stay before it counts; 0, so that no press is too short",
        min=0.0,
        max=0.02,
        fixed=True,
        kernel=False,
    )

    pressed = Output("1", "whether it is pressed", dtype=bool)
    known = Output("1", "whether its level has been heard", dtype=bool)
    age = Output("s", "since anything was heard of it: it tells of changes alone")
    state = Memory(0.0, "whether it has been pressed since it was armed")

    decode = kernels.estop_decode
    encode = kernels.estop_encode

    def output_range(self):
        return {"pressed": Interval(0.0, 1.0), "known": Interval(0.0, 1.0), "age": Interval(0.0)}

    def emulator(self, **parameters):
        return EmulatedGpio(bus=self.bus, rest=True, **parameters)


class SyncOut(GpioLine, StreamDevice):
    """A pulse on a GPIO line at tick 0, where the recording begins, and whenever `pulse` is true: by it other
    recordings find ours.

    It goes out at the end of the tick. When the run is over the line is let go, and what it is then its chip or the
    other end says.
    """

    duration = Param(0.1, "s", "of a pulse", above=0.0, max=3600.0, fixed=True)

    pulse = Input("1", "begins a pulse, or makes the present one longer", default=False, dtype=bool)
    high = Output("1", "whether the line is active", dtype=bool)
    state = Memory((0.0,) * 3, "s, when the pulse ends; whether there was the first one; the level that was sent + 1")

    decode = no_io.ignore_all
    encode = kernels.pulse
    sent_outputs = ("high",)
    hardware = ("chip", "pin", "active_low")

    def output_range(self, pulse):
        return {"high": Interval(0.0, 1.0)}

    def emulator(self, **parameters):
        return EmulatedGpio(bus=self.bus, **parameters)


class EmulatedGpio(StreamDevice):
    """A line that is not there: its level, and an event whenever that changes, as Linux tells them, for a plant."""

    rest = Param(False, "1", "whether it is active where nothing is wired to `level`", fixed=True, kernel=False)

    level = Input("1", "whether it is active", default=False, dtype=bool)
    lost = Input("1", "the chip is gone", default=False, dtype=bool)
    state = Memory((0.0,) * 3, "level that was told + 1, events so far, whether it is gone")

    line = "gpio"
    decode = kernels.emulated_decode
    encode = kernels.emulated_encode

    def configure(self):
        super().configure()
        lost = type(self).inputs["lost"]
        self.inputs = {
            "level": Input("1", "whether it is active", default=self.rest, dtype=bool).named("level"),
            "lost": lost,
        }
