"""Forces out of voltages: load cells behind an amplifier, force sensitive resistors in a divider."""

import math

from cext.kernels.devices import forces as kernels
from graph import Block, Input, Interval, Memory, Output, Param


class LoadCell(Block):
    """Force of a load cell behind an amplifier: F = (signal − zero) · capacity / at_capacity, tared at the start or on
    an input.

    Direct feedthrough; NaN passes, and no tare takes it in. While a tare goes on, zero is the mean of what has come so
    far.
    """

    capacity = Param(100.0, "N", "force at which the amplifier gives `at_capacity`", above=0.0)
    at_capacity = Param(
        1.0, "any", "signal at that force, less that without a load; negative where it goes down", fixed=True
    )
    tare_at_start = Param(True, "1", "whether it is tared with its first samples", fixed=True, kernel=False)
    tare_time = Param(0.5, "s", "over which a tare takes the mean", above=0.0, max=60.0, fixed=True, kernel=False)
    zero = Param(0.0, "any", "signal without a load, until it is tared", fixed=True, kernel=False)

    signal = Input("any", "of the amplifier")
    tare = Input("1", "its rising edge tares", default=False, dtype=bool)
    force = Output("N", "tared")

    taring = Memory(
        (0.0,) * 6, "zero, sum, samples so far, samples wanted, whether a tare goes on, whether it was asked for"
    )

    kernel = kernels.load_cell

    def configure(self):
        if self.at_capacity == 0.0:
            raise ValueError("at_capacity: the signal at the cell's capacity is not 0")

    def prepare(self, dt):
        self.taring = (self.zero, 0.0, 0.0, max(1.0, round(self.tare_time / dt)), float(self.tare_at_start), 0.0)


class FSR(Block):
    """Force on a force sensitive resistor in a divider, F = k u / (R (U − u)): its conductance times a constant.

    The sensor lies between the supply U and the converter's input, the resistor R between that and ground. They are
    rough, 10 % from one press to the next and more from one to another: good for contact and its strength, not for a
    measurement. Direct feedthrough; NaN passes, and leaves `pressed` as it was.   (Interlink Electronics, FSR 400
    series, integration guide)
    """

    supply = Param(3.3, "V", "U of the divider", above=0.0)
    resistor = Param(10e3, "Ω", "R of the divider", above=0.0)
    sensitivity = Param(25e3, "N·Ω", "k, force times the sensor's resistance: about 25 kN·Ω for an FSR 402", above=0.0)
    most = Param(100.0, "N", "told where the voltage reaches the supply, and never passed", above=0.0)
    press = Param(5.0, "N", "from which on it is pressed", min=0.0)
    release = Param(3.0, "N", "at which it is no longer", min=0.0)

    voltage = Input("V", "at the resistor")
    force = Output("N", "on the sensor")
    pressed = Output("1", "whether it is pressed", dtype=bool)

    kernel = kernels.force_sensitive_resistor

    def configure(self):
        if self.release > self.press:
            raise ValueError(f"release is at most press, {self.press:g} N, got {self.release:g} N")

    def output_range(self, voltage):
        return {
            "force": Interval(0.0, self.span("most").high if math.isfinite(self.most) else math.inf),
            "pressed": Interval(0.0, 1.0),
        }
