"""OpenIMU 300RI and 335RI over CAN."""

from __future__ import annotations

import math
from typing import Any

from blocks._plumbing.timeouts import timeout_param
from blocks.imus.openimu import frames
from blocks.imus.openimu.emulator import EmulatedOpenImu
from cext.kernels.devices.openimu import frames as kernels
from graph import Device, Interval, Memory, Output, Param

NEEDED = {
    "300RI": 0b1111,
    "335RI": 0b0111,
}  # bits of the settings that the unit must return: cext/kernels/devices/openimu/frames.pxd
SIGNS = {"printed": 1.0, "z up": -1.0}


class OpenImu(Device):
    """OpenIMU 300RI or 335RI over CAN (SAE J1939): specific force, angular rate, magnetic field, pitch and roll.

    All outputs are in one right-handed frame. `axes="printed"` is the frame on the case, x forward, y right, z down, in
    which a unit at rest measures −9.8 m/s² on z; "z up" is rotated about x by half a turn: x forward, y left, z up.
    Quantities that are not measured are NaN.

    By default, x and y of acceleration and angular rate are swapped, and y and z of the acceleration only are negated,
    so that no rotation relates the two. Arming therefore writes axes, packets, rate and filters, which the unit keeps
    until it loses power, and waits until the unit has returned them. After a loss of power, the outputs are NaN until
    the settings are written again.

    A bus has one bitrate; a unit has 250 kbit/s as delivered, which only its settings change.
    (Aceinna, OpenIMU300RI and OpenIMU335RI, CAN messages.)
    """

    bus = Param("can", "1", "logical name of the CAN bus", dtype=str)
    address = Param(128, "1", "source address set in the unit", min=128, max=247, fixed=True)
    model = Param("300RI", "1", "model of the unit; the 335RI has no magnetometer", choices=("300RI", "335RI"))
    rate = Param(100.0, "Hz", "rate of the samples", choices=tuple(frames.RATES), fixed=True, kernel=False)
    field = Param(
        True, "1", "whether the unit sends the magnetic field, if it has a magnetometer", fixed=True, kernel=False
    )
    slope = Param(
        False,
        "1",
        "whether the unit sends pitch and roll, which requires its VG or AHRS firmware",
        fixed=True,
        kernel=False,
    )
    slope_sensor = Param(
        2,
        "1",
        "slope sensor of pitch and roll: 1, on a 335RI only, has a range of ±64° and steps of 0.002°",
        choices=(1, 2),
        fixed=True,
        kernel=False,
    )
    high_resolution = Param(
        False,
        "1",
        "whether a 335RI sends acceleration and angular rate with eight times the resolution, in steps of 1/800 m/s² "
        "and 1/1024 °/s",
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
        "orientation setting in Aceinna's code; 0: as printed on the case",
        min=0,
        max=0xFFFF,
        fixed=True,
        kernel=False,
    )
    axes = Param(
        "printed", "1", "frame of the outputs: as printed on its case, or with y and z reversed", choices=tuple(SIGNS)
    )
    write_settings = Param(
        True,
        "1",
        "whether arming writes the settings and waits until the unit has returned them",
        fixed=True,
        kernel=False,
    )
    bitrate = Param(250_000.0, "1/s", "bitrate set in the unit, bit/s", above=0.0, fixed=True, kernel=False)
    timeout = timeout_param("sample")

    accel = Output("m/s²", "specific force", shape=(3,))
    gyro = Output("rad/s", "angular rate", shape=(3,))
    mag = Output("µT", "magnetic field", shape=(3,))
    roll = Output("rad", "angle about x", circle=(-math.pi, math.pi))
    pitch = Output("rad", "angle about y")
    temperature = Output("°C", "temperature, if the firmware sends the ambient conditions of J1939; NaN otherwise")
    age = Output("s", "time since the newest complete sample")
    settings = Output(
        "1",
        "settings that the unit has confirmed, as bits: 1 axes, 2 packets, 4 rate, 8 orientation, 16 filters",
        dtype=int,
    )
    invalid = Output("1", "number of values that the unit marked as errors or not available", dtype=int)
    wanted = Memory(
        (0.0,) * 11,
        "divider, packets, behaviour, its mask, orientation, filters, sign of y and z, settings that the unit must "
        "return, s of silence after which it must return them again, 1 for a 335RI",
    )
    set_up = Memory((), "frames that write and read the settings: identifier, length and eight bytes of each")
    state = Memory(
        (0.0,) * 4,
        "packets since the last complete sample, 1 once a frame was received, next frame to send, time of the last",
    )

    decode = kernels.decode
    encode = kernels.encode
    hardware = ("address", "bitrate", "orientation")

    def configure(self) -> None:
        if 0.0 < self.timeout < 2.5 / self.rate:
            raise ValueError(
                f"timeout {self.timeout:g} s is shorter than 2.5 samples at {self.rate:g} Hz: set "
                f"timeout={2.5 / self.rate:g} or more"
            )
        has_field = self.field and self.model == "300RI"
        newer = self.model == "335RI"
        if not newer and (self.high_resolution or self.slope_sensor == 1):
            raise ValueError("slope_sensor=1 and high_resolution=True require model='335RI', got '300RI'")
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
            NEEDED[self.model] if self.write_settings else 0,
            max(0.05, 2.5 / self.rate),
            float(newer),
        )
        self.set_up = tuple(
            float(x)
            for identifier, _, data in self.enable_frames()
            for x in (identifier, len(data), *data.ljust(8, b"\0"))
        )

    def enable_frames(self) -> list[tuple[int, bool, bytes]]:
        """Return the frames that write and read the settings, for a 335RI in both byte orders, as its firmware does not
        report its own; none if the unit keeps its settings.
        """
        if not self.write_settings:
            return []
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

    def addresses(self) -> list[tuple[int, bool]]:
        return [(self.address, True)]

    def acceptance_filters(self) -> list[tuple[int, int, bool]]:
        return [(self.address, 0xFF, True)]

    def reports(self) -> list[tuple[float, int, bool]]:
        return [(self.rate, 8, True)] * self.types.bit_count()

    def output_range(self) -> dict[str, Interval]:
        force, turn, field = (Interval(-bound, bound) for bound in (336.0, math.radians(263.0), 840.0))
        angle = Interval(-math.radians(263.0), math.radians(263.0))
        return {
            "accel": force,
            "gyro": turn,
            "mag": field,
            "roll": angle,
            "pitch": angle,
            "temperature": Interval(-273.0, 1775.0),
            "age": Interval(0.0),
            "settings": Interval(0.0, 31.0),
            "invalid": Interval(0.0),
        }

    def emulator(self, **parameters: Any) -> Any:
        return EmulatedOpenImu.of(self, **parameters)
