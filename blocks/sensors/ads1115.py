"""ADS1115: four voltages, one after the other, on I2C. (Texas Instruments, ADS111x, SBAS444E)"""

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
SLOWEST = 0.9  # the chip's clock may be 10 % slow
WAKE_UP = 50e-6  # s, before a conversion begins
ADDRESSES = (0x48, 0x49, 0x4A, 0x4B)


class ADS1115(I2cDevice):
    """An ADS1115 on I2C: voltages, single-ended or differential, 16 bits, converted one after the other.

    u = code · full_scale / 32768. Each channel has its output: a0 to a3 against ground, a0_a1, a0_a3, a1_a3 and a2_a3
    as differences; each is new at 0.86 of `rate` over the number of channels, 185 Hz with four at 860 a second. Every
    answer carries the configuration that it was made with. No input may be below ground or above the chip's supply,
    whatever the full scale.   (SBAS444E)
    """

    channels = Param(
        ("a0", "a1", "a2", "a3"), "1", f"those that are converted, of {', '.join(INPUTS)}", dtype=tuple, fixed=True
    )
    address = Param(
        0x48,
        "1",
        "its address: 0x48 to 0x4b, by what its pin ADDR is tied to",
        min=0x08,
        max=0x77,
        fixed=True,
        kernel=False,
    )
    full_scale = Param(
        4.096, "V", "that it measures at most, either way", choices=tuple(RANGES), fixed=True, kernel=False
    )
    rate = Param(860, "1/s", "conversions", choices=tuple(RATES), fixed=True, kernel=False)
    timeout = Param(
        0.5, "s", "of silence after which the run ends in the safe stop; 0 for never", min=0.0, fixed=True, kernel=False
    )

    a0 = Output("V", "at input 0")
    a1 = Output("V", "at input 1")
    a2 = Output("V", "at input 2")
    a3 = Output("V", "at input 3")
    age = Output("s", "since the newest conversion was read")
    errors = Output("1", "transfers that have failed since the run began", dtype=int)

    identity = Memory(0.0, "place and address")
    layout = Memory((0.0,) * 10, "V of a code, code of the range, output of each input")

    hardware = (*I2cDevice.hardware, "full_scale")
    kind = "ADS1115"
    known_addresses = ADDRESSES
    channel_names = tuple(INPUTS)
    decode = kernels.ads_decode

    def configure(self):
        super().configure()
        self.check_channels()
        own = {name: Output("V", told(name)).named(name) for name in self.channels}
        self.outputs = own | {name: type(self).outputs[name] for name in ("age", "errors")}
        self.identity = self.own_identity()
        places = [
            self.channels.index(name) if name in self.channels else -1
            for name in sorted(INPUTS, key=INPUTS.__getitem__)
        ]
        self.layout = (self.full_scale / 32768.0, RANGES[self.full_scale], *places)

    def check_channels(self):
        stranger = next((name for name in self.channels if name not in INPUTS), None)
        if stranger is not None:
            raise ValueError(f"channels: there is no {stranger!r}: {', '.join(INPUTS)}")
        if not self.channels or len(set(self.channels)) < len(self.channels):
            raise ValueError("channels: one or more, each once")

    def output_range(self):
        volts = Interval(-self.full_scale, self.full_scale)
        return {name: volts for name in self.channels} | {"age": Interval(0.0), "errors": Interval(0.0)}

    def configuration(self, name):
        """What starts one conversion of a channel."""
        return (
            START | INPUTS[name] << 12 | RANGES[self.full_scale] << 9 | SINGLE | RATES[self.rate] << 5 | NO_COMPARATOR
        )

    @property
    def period(self):
        """s of one conversion, at the slowest."""
        return 1.0 / (SLOWEST * self.rate) + WAKE_UP

    def start(self, name):
        return Write(CONFIG, self.configuration(name).to_bytes(2, "big"))

    def set_up(self):
        return (Write(CONFIG, self.start(self.channels[0]).data, wait=self.period),)

    def rounds(self):
        """What has been converted is read, with its configuration, and the next conversion begins."""
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

    def emulator(self, **parameters):
        return EmulatedADS1115.of(self, **parameters)


class EmulatedADS1115(I2cDevice):
    """An ADS1115 that is not there: it answers with the conversions of the voltages that are wired to it, one after the
    other.

    `EmulatedADS1115.of(robot["insole"])` plays the converter of a robot, with an input for each of its channels, 0 V by
    default.
    """

    channels, address, full_scale, rate = (
        ADS1115.parameters[name] for name in ("channels", "address", "full_scale", "rate")
    )

    a0 = Input("V", "at input 0", default=0.0)
    a1 = Input("V", "at input 1", default=0.0)
    a2 = Input("V", "at input 2", default=0.0)
    a3 = Input("V", "at input 3", default=0.0)
    silent = Input("1", "it answers nothing", default=False, dtype=bool)
    stuck = Input("1", "it goes on with one and the same voltage", default=False, dtype=bool)
    wrong_address = Input("1", "address that it answers at instead of its own; 0 for its own", default=0, dtype=int)
    not_ready = Input("1", "its conversions are never done", default=False, dtype=bool)

    identity = Memory(0.0, "place and address")
    layout = Memory((0.0,) * 10, "V of a code, s of a conversion, the configuration of each channel")
    state = Memory((0.0,) * 4, "when the next answer is due, its channel, whether it is stuck, with what")

    kind, known_addresses, check_channels = ADS1115.kind, ADDRESSES, ADS1115.check_channels
    configuration, period = ADS1115.configuration, ADS1115.period
    decode = no_io.ignore_all
    encode = kernels.ads_answers

    @classmethod
    def of(cls, converter, **parameters):
        return cls(**{name: getattr(converter, name) for name in cls.parameters} | parameters)

    def configure(self):
        super().configure()
        self.check_channels()
        own = {name: Input("V", told(name), default=0.0).named(name) for name in self.channels}
        self.inputs = own | {
            name: type(self).inputs[name] for name in ("silent", "stuck", "wrong_address", "not_ready")
        }
        self.identity = self.own_identity()
        self.layout = (
            self.full_scale / 32768.0,
            self.period,
            *(float(self.configuration(name)) for name in self.channels),
        )


def told(name):
    """Return the description of a channel: "a0" or, differential, "a0_a1"."""
    first, _, second = name.partition("_")
    return f"at input {first[1]}" + (f", against input {second[1]}" if second else "")
