"""Forces from voltages: load cells with an amplifier, force-sensitive resistors in a voltage divider."""

from __future__ import annotations

import math
from typing import Any

from cext.kernels.devices import forces as kernels
from graph import Block, Input, Interval, Memory, Output, Param


class LoadCell(Block):
    """Force of a load cell with an amplifier: F = (signal − zero) · capacity / at_capacity.

    Tared at the start or on a rising edge of `tare`. During a tare, zero is the mean of the samples so far. Direct
    feedthrough; NaN passes and is excluded from a tare.
    """

    capacity = Param(100.0, "N", "rated force of the load cell", above=0.0)
    at_capacity = Param(
        1.0, "any", "change of the signal from no load to `capacity`; negative if it decreases", fixed=True
    )
    tare_at_start = Param(True, "1", "true tares with the first samples", fixed=True, kernel=False)
    tare_time = Param(0.5, "s", "averaging time of a tare", above=0.0, max=60.0, fixed=True, kernel=False)
    zero = Param(0.0, "any", "signal without a load, until the first tare", fixed=True, kernel=False)

    signal = Input("any", "signal of the amplifier")
    tare = Input("1", "rising edge starts a tare", default=False, dtype=bool)
    force = Output("N", "tared force")

    taring = Memory((0.0,) * 6, "zero, sum, number of samples, required samples, 1 during a tare, previous `tare`")

    kernel = kernels.load_cell

    def configure(self) -> None:
        if self.at_capacity == 0.0:
            raise ValueError("at_capacity: must not be 0")

    def prepare(self, dt: float) -> None:
        self.taring = (self.zero, 0.0, 0.0, max(1.0, round(self.tare_time / dt)), float(self.tare_at_start), 0.0)

    def emulator(self, **parameters: Any) -> EmulatedLoadCell:
        """Return the emulator of this load cell. parameters : override those of the block"""
        return EmulatedLoadCell.of(self, **parameters)


class EmulatedLoadCell(Block):
    """Emulated load cell with its amplifier: signal = zero + F · at_capacity / capacity.

    `robot["left/cell"].emulator()` emulates the cell of a robot's LoadCell; its signal is an input of the emulated
    converter or microcontroller. Direct feedthrough; NaN passes.
    """

    capacity, at_capacity = LoadCell.parameters["capacity"], LoadCell.parameters["at_capacity"]
    zero = Param(0.0, "any", "signal without a load", fixed=True)

    force = Input("N", "force on the load cell")
    signal = Output("any", "signal of the amplifier")

    kernel = kernels.emulated_load_cell

    @classmethod
    def of(cls, cell: LoadCell, **parameters: Any) -> EmulatedLoadCell:
        """Return the emulator of one LoadCell. parameters : override those of the block"""
        return cls(**{name: getattr(cell, name) for name in cls.parameters} | parameters)


class FSR(Block):
    """Force on a force-sensitive resistor in a voltage divider: F = k u / (R (U − u)), k times its conductance.

    The sensor is between the supply U and the converter input, the resistor R between that input and ground. The
    repeatability is about 10 %, and worse between sensors: suitable to detect contact and its strength, not to measure.
    Direct feedthrough; NaN passes and leaves `pressed` unchanged.   (Interlink Electronics, FSR 400 series, integration
    guide)
    """

    rules = ("release <= press",)

    supply = Param(3.3, "V", "supply voltage U of the divider", above=0.0)
    resistor = Param(10e3, "Ω", "resistor R of the divider", above=0.0)
    sensitivity = Param(25e3, "N·Ω", "force times resistance k of the sensor; about 25 kN·Ω for an FSR 402", above=0.0)
    most = Param(100.0, "N", "upper limit of the force, reached at the supply voltage", above=0.0)
    press = Param(5.0, "N", "force above which `pressed` becomes true", min=0.0)
    release = Param(3.0, "N", "force below which `pressed` becomes false", min=0.0)

    voltage = Input("V", "voltage at the resistor")
    force = Output("N", "force on the sensor")
    pressed = Output("1", "true while pressed", dtype=bool)

    kernel = kernels.force_sensitive_resistor

    def output_range(self, voltage: Interval) -> dict[str, Interval]:
        return {
            "force": Interval(0.0, self.span("most").high if math.isfinite(self.most) else math.inf),
            "pressed": Interval(0.0, 1.0),
        }

    def emulator(self, **parameters: Any) -> EmulatedFSR:
        """Return the emulator of this resistor in its divider. parameters : override those of the block"""
        return EmulatedFSR.of(self, **parameters)


class EmulatedFSR(Block):
    """Force-sensitive resistor in its voltage divider, for a plant: u = U F R / (F R + k).

    `robot["left/heel"].emulator()` emulates the sensor of a robot's FSR; its voltage is an input of the emulated
    converter. Direct feedthrough; NaN and infinity give NaN.
    """

    supply, resistor, sensitivity = (FSR.parameters[name] for name in ("supply", "resistor", "sensitivity"))

    force = Input("N", "force on the sensor; negative values count as 0")
    voltage = Output("V", "voltage at the resistor")

    kernel = kernels.resistor_divider

    @classmethod
    def of(cls, fsr: FSR, **parameters: Any) -> EmulatedFSR:
        """Return the emulator of one FSR. parameters : override those of the FSR"""
        return cls(**{name: getattr(fsr, name) for name in cls.parameters} | parameters)

    def output_range(self, force: Interval) -> Interval:
        return Interval(0.0, self.span("supply").high)
