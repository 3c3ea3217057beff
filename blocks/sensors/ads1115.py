"""ADS1115, a four-channel analogue-to-digital converter on I2C. (Texas Instruments, ADS111x, SBAS444E)"""

from __future__ import annotations

from typing import Any

from blocks._plumbing.timeouts import timeout_param
from blocks.i2c import I2cDevice, Read, Round, Transfer, Write
from cext.kernels import no_io
from cext.kernels.devices import converters as kernels
from graph import Input, Interval, Memory, Output, Param

CONVERSION, CONFIG = 0x00, 0x01
# code of MUX, bits 14 to 12
INPUTS = {"a0": 4, "a1": 5, "a2": 6, "a3": 7, "a0_a1": 0, "a0_a3": 1, "a1_a3": 2, "a2_a3": 3}
RANGES = {6.144: 0, 4.096: 1, 2.048: 2, 1.024: 3, 0.512: 4, 0.256: 5}  # V, code of PGA, bits 11 to 9
RATES = {8: 0, 16: 1, 32: 2, 64: 3, 128: 4, 250: 5, 475: 6, 860: 7}  # 1/s, code of DR, bits 7 to 5
START, SINGLE, NO_COMPARATOR = 0x8000, 0x0100, 0x0003
CLOCK_RATE_MINIMUM = 0.9  # the chip's clock may be 10 % slow
WAKE_UP_TIME = 50e-6  # s, before a conversion
ADDRESSES = (0x48, 0x49, 0x4A, 0x4B)


class ADS1115(I2cDevice):
    """ADS1115 converter on I2C, 16 bits, single-ended or differential: u = code · full_scale / 32768.   (SBAS444E)

    Each channel has an output: a0 to a3 relative to ground, a0_a1, a0_a3, a1_a3 and a2_a3 as differences. Channels are
    converted in sequence; each is updated at 0.86 of `rate` divided by the number of channels, 185 Hz for four channels
    at 860 conversions per second. Inputs must remain between ground and the chip's supply for any full scale.
    """

    channels = Param(
        ("a0", "a1", "a2", "a3"), "1", f"channels to convert, of {', '.join(INPUTS)}", dtype=tuple, fixed=True
    )
    address = Param(
        0x48, "1", "address: 0x48 to 0x4b, selected with the pin ADDR", min=0x08, max=0x77, fixed=True, kernel=False
    )
    full_scale = Param(
        4.096, "V", "full-scale magnitude of the voltage", choices=tuple(RANGES), fixed=True, kernel=False
    )
    rate = Param(860, "1/s", "conversions per second", choices=tuple(RATES), fixed=True, kernel=False)
    timeout = timeout_param(default=0.5)

    a0 = Output("V", "voltage at input 0")
    a1 = Output("V", "voltage at input 1")
    a2 = Output("V", "voltage at input 2")
    a3 = Output("V", "voltage at input 3")
    age = Output("s", "time since the newest conversion was read")
    errors = Output("1", "failed transfers since the start of the run", dtype=int)

    identity = Memory(0.0, "bus segment and address")
    layout = Memory((0.0,) * 10, "V per code, code of the range, output of each input")

    hardware = (*I2cDevice.hardware, "full_scale")
    kind = "ADS1115"
    register_bytes = 2
    known_addresses = ADDRESSES
    channel_names = tuple(INPUTS)
    decode = kernels.ads_decode

    def configure(self) -> None:
        super().configure()
        self.check_channels()
        own = {name: Output("V", input_description(name)).named(name) for name in self.channels}
        self.outputs = own | {name: type(self).outputs[name] for name in ("age", "errors")}
        self.identity = self.own_identity()
        places = [
            self.channels.index(name) if name in self.channels else -1
            for name in sorted(INPUTS, key=INPUTS.__getitem__)
        ]
        self.layout = (self.full_scale / 32768.0, RANGES[self.full_scale], *places)

    def check_channels(self) -> None:
        """Raise ValueError for unknown, repeated or no channels."""
        unknown = next((name for name in self.channels if name not in INPUTS), None)
        if unknown is not None:
            raise ValueError(f"channels: unknown channel {unknown!r}. The channels are {', '.join(INPUTS)}")
        if not self.channels or len(set(self.channels)) < len(self.channels):
            raise ValueError("channels: expected at least one channel, without duplicates")

    def output_range(self) -> dict[str, Interval]:
        volts = Interval(-self.full_scale, self.full_scale)
        return {name: volts for name in self.channels} | {"age": Interval(0.0), "errors": Interval(0.0)}

    def configuration(self, name: str) -> int:
        """Return the register value that starts one conversion of a channel."""
        return (
            START | INPUTS[name] << 12 | RANGES[self.full_scale] << 9 | SINGLE | RATES[self.rate] << 5 | NO_COMPARATOR
        )

    @property
    def period(self) -> float:
        """Longest duration of one conversion in s."""
        return 1.0 / (CLOCK_RATE_MINIMUM * self.rate) + WAKE_UP_TIME

    def start(self, name: str) -> Write:
        """Return the write that starts the conversion of a channel. name : name of the channel"""
        return Write(CONFIG, self.configuration(name).to_bytes(2, "big"))

    def set_up(self) -> tuple[Write, ...]:
        return (Write(CONFIG, self.start(self.channels[0]).data, wait=self.period),)

    def rounds(self) -> tuple[Round, ...]:
        """Return the Round that reads a conversion with its configuration and starts the next one."""
        following = [*self.channels[1:], self.channels[0]]
        return (
            Round(
                self.period,
                tuple(
                    Transfer(number, (Read(CONVERSION, 2), Read(CONFIG, 2), self.start(name)))
                    for number, name in enumerate(following)
                ),
                settle=self.period,
            ),
        )

    def emulator(self, **parameters: Any) -> EmulatedADS1115:
        return EmulatedADS1115.of(self, **parameters)


class EmulatedADS1115(I2cDevice):
    """Emulated ADS1115 that converts its input voltages in sequence.

    `EmulatedADS1115.of(robot["insole"])` emulates the converter of a robot, with one input per channel, 0 V by default.
    """

    channels, address, full_scale, rate = (
        ADS1115.parameters[name] for name in ("channels", "address", "full_scale", "rate")
    )

    a0 = Input("V", "voltage at input 0", default=0.0)
    a1 = Input("V", "voltage at input 1", default=0.0)
    a2 = Input("V", "voltage at input 2", default=0.0)
    a3 = Input("V", "voltage at input 3", default=0.0)
    silent = Input("1", "true stops all replies", default=False, dtype=bool)
    stuck = Input("1", "true repeats the last voltage", default=False, dtype=bool)
    wrong_address = Input("1", "address used instead of `address`; 0 for none", default=0, dtype=int)
    not_ready = Input("1", "true never completes a conversion", default=False, dtype=bool)

    identity = Memory(0.0, "bus segment and address")
    layout = Memory((0.0,) * 10, "V per code, s per conversion, configuration of each channel")
    state = Memory((0.0,) * 4, "time of the next reply, its channel, 1 while stuck, stuck value")

    kind, known_addresses, check_channels = ADS1115.kind, ADDRESSES, ADS1115.check_channels
    configuration, period = ADS1115.configuration, ADS1115.period
    decode = no_io.ignore_all
    timeout: Any = 0.0  # nothing replies to an emulator
    encode = kernels.ads_answers

    @classmethod
    def of(cls, converter: ADS1115, **parameters: Any) -> EmulatedADS1115:
        """Return the emulator of one ADS1115. parameters : override those of the converter"""
        return cls(**{name: getattr(converter, name) for name in cls.parameters} | parameters)

    def configure(self) -> None:
        super().configure()
        self.check_channels()
        own = {name: Input("V", input_description(name), default=0.0).named(name) for name in self.channels}
        self.inputs = own | {
            name: type(self).inputs[name] for name in ("silent", "stuck", "wrong_address", "not_ready")
        }
        self.identity = self.own_identity()
        self.layout = (
            self.full_scale / 32768.0,
            self.period,
            *(float(self.configuration(name)) for name in self.channels),
        )


def input_description(name: str) -> str:
    """Return the description of a channel, such as "a0" or, differential, "a0_a1"."""
    first, _, second = name.partition("_")
    return f"voltage at input {first[1]}" + (f" relative to input {second[1]}" if second else "")
