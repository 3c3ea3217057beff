"""OpenIMU 300RI and 335RI over CAN."""

import math

from blocks.imus.openimu import frames
from blocks.imus.openimu.emulator import EmulatedOpenImu
from cext.kernels.devices.openimu import frames as kernels
from graph import Device, Interval, Memory, Output, Param

NEEDED = {
    "300RI": 0b1111,
    "335RI": 0b0111,
}  # of the settings that must have been returned: cext/kernels/devices/openimu/frames.pxd
SIGNS = {"printed": 1.0, "z up": -1.0}


class OpenImu(Device):
    """An OpenIMU 300RI or 335RI over CAN (SAE J1939): specific force, angular rate, magnetic field, pitch and roll in
    one right-handed frame.

    (Aceinna, OpenIMU300RI and OpenIMU335RI, CAN messages.) As it is sold, x and y have changed places in acceleration
    and angular rate, and y and z of the acceleration alone are negated: no rotation brings the two together. So arming
    sets its axes, its packets, their rate and its filters, which lasts until its power is gone, and it has not answered
    before it has returned them; after a loss of power a unit gives nothing until it has been set up again.
    `axes="printed"` is the frame on its case, x forward, y right, z down, in which a unit at rest shows −9.8 m/s² on z;
    "z up" is that, turned about x by half a turn: x forward, y left, z up. What was not measured is NaN. A bus has one
    bitrate, and a unit as it is sold 250 kbit/s, which its own settings alone change.
    """

    bus = Param("can", "1", "logical name of its CAN bus", dtype=str)
    address = Param(128, "1", "source address set in the unit", min=128, max=247, fixed=True)
    model = Param("300RI", "1", "which one it is; the 335RI has no magnetometer", choices=("300RI", "335RI"))
    rate = Param(100.0, "Hz", "of its samples", choices=tuple(frames.RATES), fixed=True, kernel=False)
    field = Param(
        True, "1", "whether it sends the magnetic field, where it has a magnetometer", fixed=True, kernel=False
    )
    slope = Param(
        False,
        "1",
        "whether it sends pitch and roll: of its firmware for VG or AHRS, not of that for an IMU",
        fixed=True,
        kernel=False,
    )
    slope_sensor = Param(
        2,
        "1",
        "which of its slopes that is: 1 reaches 64°, in steps of 0.002°, and a 335RI alone has it",
        choices=(1, 2),
        fixed=True,
        kernel=False,
    )
    high_resolution = Param(
        False,
        "1",
        "whether a 335RI sends acceleration and angular rate with eight times the "
        "resolution, in steps of "
        "1/800 m/s² and 1/1024 °/s",
        fixed=True,
        kernel=False,
    )
    rate_filter = Param(
        25,
        "Hz",
        "low-pass of the angular rate; 0 for none",
        choices=frames.FILTER_FREQUENCIES,
        fixed=True,
        kernel=False,
    )
    acceleration_filter = Param(
        25,
        "Hz",
        "low-pass of the acceleration; 0 for none",
        choices=frames.FILTER_FREQUENCIES,
        fixed=True,
        kernel=False,
    )
    orientation = Param(
        0,
        "1",
        "its setting of how it is mounted, as Aceinna codes it; 0 for as printed",
        min=0,
        max=0xFFFF,
        fixed=True,
        kernel=False,
    )
    axes = Param(
        "printed",
        "1",
        "frame of the outputs: as printed on its case, or with y and z the other way round",
        choices=tuple(SIGNS),
    )
    told = Param(
        True,
        "1",
        "whether the unit must have returned its settings before it counts as answered",
        fixed=True,
        kernel=False,
    )
    bitrate = Param(250_000.0, "1/s", "bits a second that the unit is set to", above=0.0, fixed=True, kernel=False)
    timeout = Param(
        0.1, "s", "silence after which the run ends in the safe stop; 0 for never", min=0.0, fixed=True, kernel=False
    )

    accel = Output("m/s²", "specific force", shape=(3,))
    gyro = Output("rad/s", "angular rate", shape=(3,))
    mag = Output("µT", "magnetic field", shape=(3,))
    roll = Output("rad", "about x", circle=(-math.pi, math.pi))
    pitch = Output("rad", "about y")
    age = Output("s", "time since the newest whole sample")
    settings = Output(
        "1",
        "which settings it has returned as requested: 1 axes, 2 packets, 4 rate, 8 orientation, 16 filters",
        dtype=int,
    )
    invalid = Output("1", "values so far that it marked as errors or not available", dtype=int)
    wanted = Memory(
        (0.0,) * 11,
        "divider, packets, behaviour, its mask, orientation, filters, sign of y and z, "
        "settings that must be returned, "
        "s of silence after which it must return them again, whether it is a 335RI",
    )
    set_up = Memory((), "what sets it up and asks what is set: identifier, length, eight bytes of each")
    state = Memory(
        (0.0,) * 4,
        "packets since the last whole sample, whether a frame was received, frame to send next, time of the last frame",
    )

    decode = kernels.decode
    encode = kernels.encode
    hardware = ("address", "bitrate", "orientation")

    def configure(self):
        if 0.0 < self.timeout < 2.5 / self.rate:
            raise ValueError(
                f"timeout {self.timeout:g} s is shorter than 2.5 samples at {self.rate:g} Hz: give "
                f"{2.5 / self.rate:g} or more"
            )
        has_field = self.field and self.model == "300RI"
        newer = self.model == "335RI"
        if not newer and (self.high_resolution or self.slope_sensor == 1):
            raise ValueError("a 300RI has neither slope sensor 1 nor packets of high resolution: those are a 335RI's")
        fine, plain = (
            frames.SENDS_FINE_RATE | frames.SENDS_FINE_ACCELERATION,
            frames.SENDS_RATE | frames.SENDS_ACCELERATION,
        )
        slope = frames.SENDS_SLOPE_1 if self.slope_sensor == 1 else frames.SENDS_SLOPE
        self.types = (fine if self.high_resolution else plain) | has_field * frames.SENDS_FIELD | self.slope * slope
        self.divider = frames.RATES[self.rate]
        behaviour = (0, frames.MIXES) if newer else (frames.RIGHT_HANDED, 0xFFFF)
        self.wanted = (
            self.divider,
            self.types,
            *behaviour,
            self.orientation,
            self.rate_filter,
            self.acceleration_filter,
            SIGNS[self.axes],
            NEEDED[self.model] if self.told else 0,
            max(0.05, 2.5 / self.rate),
            float(newer),
        )
        self.set_up = tuple(
            float(x)
            for identifier, _, data in self.enable_frames()
            for x in (identifier, len(data), *data.ljust(8, b"\0"))
        )

    def enable_frames(self):
        """Its settings, and the questions what they are: to a 335RI in either order of bytes, since its firmware does
        not say which.
        """
        address = self.address
        asked = (frames.BEHAVIOUR, frames.PACKET_TYPE, frames.PACKET_RATE)
        return [
            frames.behaviour(address, self.model),
            frames.packet_type(address, self.types, self.model),
            frames.packet_rate(address, self.divider),
            frames.filters(address, self.rate_filter, self.acceleration_filter),
            frames.orientation(address, self.orientation),
            *map(frames.request, asked),
            *(
                [frames.request(group, "big") for group in asked]
                if self.model == "335RI"
                else map(frames.request, (frames.ORIENTATION, frames.FILTERS))
            ),
        ]

    def addresses(self):
        return [(self.address, True)]

    def hears(self):
        return [(self.address, 0xFF, True)]

    def reports(self):
        return [(self.rate, 8, True)] * self.types.bit_count()

    def output_range(self):
        force, turn, field = (Interval(-bound, bound) for bound in (336.0, math.radians(263.0), 840.0))
        angle = Interval(-math.radians(263.0), math.radians(263.0))
        return {
            "accel": force,
            "gyro": turn,
            "mag": field,
            "roll": angle,
            "pitch": angle,
            "age": Interval(0.0),
            "settings": Interval(0.0, 31.0),
            "invalid": Interval(0.0),
        }

    def emulator(self, **parameters):
        return EmulatedOpenImu.of(self, **parameters)
