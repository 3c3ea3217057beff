"""NAU7802, a 24-bit amplifier and converter for load cells on I2C. (Nuvoton, NAU7802 1.7)"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from blocks._plumbing.timeouts import timeout_param
from blocks.i2c import I2cDevice, Identity, Read, Round, Transfer, Write
from cext.kernels import no_io
from cext.kernels.devices import converters as kernels
from graph import Input, Interval, Memory, Output, Param

POWER, CONTROL_1, CONTROL_2, COUNTS, CONVERTER, POWER_2, REVISION = 0x00, 0x01, 0x02, 0x12, 0x15, 0x1C, 0x1F
RESET, DIGITAL, ANALOGUE, STARTED, INTERNAL_SUPPLY = 0x01, 0x02, 0x04, 0x10, 0x80  # of POWER
CALIBRATE, CALIBRATION_FAILED = 0x04, 0x08  # of CONTROL_2
CHOPPER_OFF, CAPACITOR_ON = 0x30, 0x80  # of CONVERTER and POWER_2
GAINS = (1, 2, 4, 8, 16, 32, 64, 128)
RATES = {10: 0, 20: 1, 40: 2, 80: 3, 320: 7}
SUPPLIES = {4.5: 0, 4.2: 1, 3.9: 2, 3.6: 3, 3.3: 4, 3.0: 5, 2.7: 6, 2.4: 7}
CALIBRATION_TIME = 0.5  # s, longest internal calibration
SPAN = 2.0**24  # counts over the full range, the supply divided by the gain


class NAU7802(I2cDevice):
    """NAU7802 with a load cell: force = (counts − zero) · capacity / (sensitivity 2²⁴ gain).

    ratio = counts / (2²⁴ gain) does not depend on the supply, which is also the reference of the converter. The force
    is tared at the start or on a rising edge of `tare`. Set `capacity` and `sensitivity` from the data sheet of the
    cell, or `scale`, in N per count, from a measurement with a weight.   (Nuvoton, NAU7802 1.7)
    """

    address = Param(0x2A, "1", "address, always 0x2a", min=0x08, max=0x77, fixed=True, kernel=False)
    rate = Param(80, "1/s", "conversions per second", choices=tuple(RATES), fixed=True, kernel=False)
    gain = Param(128, "1", "gain of the amplifier", choices=GAINS, fixed=True, kernel=False)
    supply = Param(
        3.0,
        "V",
        "supply of the load cell, at least 0.3 V below that of the chip",
        choices=tuple(SUPPLIES),
        fixed=True,
        kernel=False,
    )
    capacity = Param(100.0, "N", "capacity of the load cell", above=0.0, fixed=True, kernel=False)
    sensitivity = Param(
        0.002,
        "1",
        "full-scale signal in V per V of supply: 2 mV/V is 0.002; negative for tension",
        fixed=True,
        kernel=False,
    )
    scale = Param(
        0.0, "N", "force per count, instead of capacity and sensitivity; 0 for none", fixed=True, kernel=False
    )
    tare_at_start = Param(True, "1", "true tares with the first samples", fixed=True, kernel=False)
    tare_time = Param(0.5, "s", "averaging time of a tare", above=0.0, max=60.0, fixed=True, kernel=False)
    timeout = timeout_param(default=0.5)

    tare = Input("1", "rising edge starts a tare", default=False, dtype=bool)
    counts = Output("1", "raw counts of the converter", dtype=int)
    ratio = Output("1", "signal of the cell in V per V of supply, not tared")
    force = Output("N", "tared force")
    age = Output("s", "time since the newest conversion was read")
    errors = Output("1", "failed transfers since the start of the run", dtype=int)

    identity = Memory(0.0, "bus segment and address")
    scales = Memory((0.0,) * 2, "V/V and N per count")
    taring = Memory((0.0,) * 6, "zero, sum, number of samples, required samples, 1 during a tare, previous `tare`")

    hardware = (*I2cDevice.hardware, "supply", "capacity", "sensitivity", "scale")
    kind = "NAU7802"
    known_addresses = (0x2A,)
    decode = kernels.nau_decode

    def configure(self) -> None:
        super().configure()
        if self.sensitivity == 0.0 and self.scale == 0.0:
            raise ValueError(
                "sensitivity: must not be 0. Set it from the data sheet of the cell, usually 1 to 3 mV/V, or set scale"
            )
        self.identity = self.own_identity()
        ratio = 1.0 / (SPAN * self.gain)
        self.scales = (ratio, self.scale or self.capacity * ratio / self.sensitivity)
        self.taring = (0.0, 0.0, 0.0, max(1.0, round(self.tare_time * self.rate)), float(self.tare_at_start), 0.0)

    def output_range(self, tare: Interval | None = None) -> dict[str, Interval]:
        largest = SPAN / 2.0
        force = 2.0 * largest * abs(self.scales[1])
        return {
            "counts": Interval(-largest, largest),
            "ratio": Interval(-largest * self.scales[0], largest * self.scales[0]),
            "force": Interval(-force, force),
            "age": Interval(0.0),
            "errors": Interval(0.0),
        }

    def identities(self) -> tuple[Identity, ...]:
        return (Identity(REVISION, {0x0F: "NAU7802"}, mask=0x0F),)

    @property
    def control_1(self) -> int:
        """Return the value of the register CTRL1: supply voltage and gain."""
        return SUPPLIES[self.supply] << 3 | GAINS.index(self.gain)

    def set_up(self) -> tuple[Write, ...]:
        on, rate = DIGITAL | ANALOGUE | INTERNAL_SUPPLY, RATES[self.rate] << 4
        values = (
            (POWER, RESET, 0.001),
            (POWER, DIGITAL, 0.01),
            (POWER, on, 0.0),
            (CONTROL_1, self.control_1, 0.0),
            (CONTROL_2, rate, 0.0),
            (CONVERTER, CHOPPER_OFF, 0.0),
            (POWER_2, CAPACITOR_ON, 0.25),
            (CONTROL_2, rate | CALIBRATE, CALIBRATION_TIME),
            (POWER, on | STARTED, 1.0 / self.rate),
        )
        return tuple(Write(register, bytes((value,)), wait) for register, value, wait in values)

    def learn(self, read: Callable[..., Any], write: Callable[..., Any] | None) -> None:
        if read(CONTROL_2, 1)[0] & CALIBRATION_FAILED:
            raise ValueError(
                "the internal calibration failed. Check that the supply of the load cell is connected and not shorted"
            )

    def check(self) -> tuple[int, bytes]:
        return CONTROL_1, bytes((self.control_1,))

    def rounds(self) -> tuple[Round, ...]:
        """Return the Round of reads, slightly faster than the conversions.

        No conversion is missed, and a status bit identifies those that were read before.
        """
        return (Round(1.0 / (1.1 * self.rate), (Transfer(0, (Read(POWER, 1), Read(COUNTS, 3))),)),)

    def emulator(self, **parameters: Any) -> EmulatedNAU7802:
        return EmulatedNAU7802.of(self, **parameters)


class EmulatedNAU7802(I2cDevice):
    """Emulated NAU7802 that converts the signal of its load cell, in V per V, or the force on it.

    `EmulatedNAU7802.of(robot["handle"])` emulates the amplifier of a robot.
    """

    address, rate, gain, capacity, sensitivity, scale = (
        NAU7802.parameters[name] for name in ("address", "rate", "gain", "capacity", "sensitivity", "scale")
    )

    ratio = Input("1", "signal of the load cell without a force, in V per V of supply", default=0.0)
    force = Input("N", "force on the load cell", default=0.0)
    silent = Input("1", "true stops all replies", default=False, dtype=bool)
    stuck = Input("1", "true repeats the last count", default=False, dtype=bool)
    wrong_address = Input("1", "address used instead of `address`; 0 for none", default=0, dtype=int)
    not_ready = Input("1", "true never completes a conversion", default=False, dtype=bool)

    identity = Memory(0.0, "bus segment and address")
    layout = Memory((0.0,) * 3, "V/V per count, s per conversion, V/V per N")
    state = Memory((0.0,) * 4, "time of the next reply, 1 while stuck, stuck value")

    kind, known_addresses = NAU7802.kind, NAU7802.known_addresses
    timeout: Any = 0.0  # nothing replies to an emulator
    decode = no_io.ignore_all
    encode = kernels.nau_answers

    @classmethod
    def of(cls, amplifier: NAU7802, **parameters: Any) -> EmulatedNAU7802:
        """Return the emulator of an amplifier, with its parameters. parameters : that differ"""
        return cls(**{name: getattr(amplifier, name) for name in cls.parameters} | parameters)

    def configure(self) -> None:
        super().configure()
        self.identity = self.own_identity()
        per_count = 1.0 / (SPAN * self.gain)
        per_newton = per_count / self.scale if self.scale else self.sensitivity / self.capacity
        self.layout = (per_count, 1.0 / self.rate, per_newton)
