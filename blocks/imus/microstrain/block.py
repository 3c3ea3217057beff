"""MicroStrain sensors as devices of a robot."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from typing import Any

from blocks._plumbing.timeouts import timeout_param
from blocks.imus.microstrain import queries, set_up
from blocks.imus.microstrain.descriptors import (
    CHANNELS,
    COMMON,
    EXTRA,
    FIELDS,
    FILTER,
    SENSOR,
    SHARED,
    STANDARD,
    TIMES,
    wanted,
)
from blocks.imus.microstrain.emulator import EmulatedMicroStrain
from blocks.serial_lines import speed_of
from cext.kernels.devices.microstrain import mip as kernels
from graph import Input, Interval, Memory, Output, Param, StreamDevice

PLAIN, ATTITUDE, ANGLES, CLOCK = range(4)  # roles of a field, in cext/kernels/devices/microstrain/mip.pyx
ENVELOPE, SHORTEST_TIME = 6, 10  # bytes of a packet around its fields, and of the field with its time
SHORTEST_TIME_CONSTANT, LONGEST_TIME_CONSTANT = 1.0, 1000.0  # s, of command 0C 51
START_TARE_LIMIT = 0.8  # s; arming waits 1 s for a reply


class MicroStrain(StreamDevice):
    """MicroStrain inertial sensor (3DM-GX5, CX5, CV5, CV7, GV7 and related models) with MIP on a serial line.

    `quaternion`, `euler` and `rotation` are the attitude of the sensor relative to its tare, or before a tare relative
    to the earth (x north, y east, z down); `rotation` converts vectors from the sensor's axes to those axes.
    `raw_quaternion` and `raw_euler` are as sent by the sensor. Quantities that were not requested, have not arrived, or
    are marked as invalid are NaN. The clock of the sensor is mapped to the computer's by the smallest delay of every
    second (cext/kernels/devices/clock_map.pxd).
    """

    serial = Param("", "1", "last digits of the serial number, which identifies the sensor at any port", dtype=str)
    port = Param("", "1", "path of the port, instead of a serial number", dtype=str)
    baudrate = Param(
        115200,
        "1",
        "baud rate of a hardware serial port in bit/s; no effect on USB",
        min=9600,
        max=4_000_000,
        fixed=True,
        kernel=False,
    )
    rate = Param(
        200.0, "Hz", "rate of the samples: the base rate divided by an integer", above=0.0, max=1000.0, fixed=True
    )
    channels = Param(
        STANDARD,
        "1",
        f"requested channels: {', '.join(COMMON)}, quaternion, euler; with an additional output: {', '.join(EXTRA)}",
        dtype=tuple,
    )
    attitude = Param(
        "filter",
        "1",
        "source of quaternion and euler: the estimation filter, or the complementary filter beside the sensors",
        dtype=str,
        choices=("filter", "sensor"),
    )
    heading = Param(
        "",
        "1",
        "heading source of the estimation filter; the sensor's setting by default",
        dtype=str,
        choices=("", "none", "magnetometer"),
    )
    up_compensation = Param(
        None,
        "s",
        "time constant with which the complementary filter corrects roll and pitch by gravity: 1 to 1000, or 0 for no "
        "correction; the sensor's setting by default",
        min=0.0,
        max=LONGEST_TIME_CONSTANT,
        fixed=True,
        kernel=False,
    )
    north_compensation = Param(
        None,
        "s",
        "time constant with which the complementary filter corrects the heading by the magnetic field: 1 to 1000, or 0 "
        "for no correction; the sensor's setting by default",
        min=0.0,
        max=LONGEST_TIME_CONSTANT,
        fixed=True,
        kernel=False,
    )
    sensor_to_vehicle = Param(
        (),
        "rad",
        "roll, pitch and yaw of the sensor relative to the axes in which it reports; the sensor's setting by default",
        dtype=tuple,
    )
    low_pass = Param(
        0.0,
        "Hz",
        "cut-off of the low-pass of accel, gyro, mag and pressure; 0: the sensor's setting",
        min=0.0,
        max=1000.0,
        fixed=True,
    )
    anti_aliasing = Param(
        "",
        "1",
        "low-pass of these quantities at half the sample rate: on, or off for no low-pass; the sensor's setting by "
        "default",
        dtype=str,
        choices=("", "on", "off"),
    )
    tare_at_start = Param(False, "1", "whether to tare with the first samples; arming waits for them", fixed=True)
    tare_time = Param(0.5, "s", "averaging time of a tare", min=0.0, max=60.0, fixed=True)
    timeout = timeout_param("sample")

    tare = Input(
        "1", "on a rising edge, the mean attitude of the next `tare_time` becomes zero", default=False, dtype=bool
    )

    accel = Output("m/s²", "specific force", shape=(3,))
    gyro = Output("rad/s", "angular rate", shape=(3,))
    mag = Output("µT", "magnetic field", shape=(3,))
    quaternion = Output("1", "attitude since the tare, w first", shape=(4,))
    euler = Output(
        "rad", "roll, pitch and yaw since the tare", shape=(3,), range=(-math.pi, math.pi), circle=(-math.pi, math.pi)
    )
    rotation = Output("1", "rotation matrix since the tare", shape=(3, 3))
    raw_quaternion = Output("1", "attitude as sent by the sensor, w first", shape=(4,))
    raw_euler = Output("rad", "roll, pitch and yaw as sent by the sensor", shape=(3,), circle=(-math.pi, math.pi))
    temperature = Output("°C", "mean temperature of the sensor")
    age = Output("s", "time since the newest sample of all requested channels arrived")
    sample_time = Output("s", "sampling time of the newest sample, on the clock of the run")
    clock_drift = Output("1", "relative slowness of the sensor's clock")
    measured_rate = Output("Hz", "number of samples received in the previous second")
    packets = Output("1", "number of data packets received", dtype=int)
    corrupt = Output("1", "number of packets with a wrong checksum", dtype=int)
    lost = Output("1", "number of samples missing according to the sensor's clock", dtype=int)
    valid = Output("1", "whether the filter marks the newest values as valid", dtype=bool)
    tared = Output("1", "whether the sensor is tared", dtype=bool)
    tare_attitude = Output("1", "attitude of the tare, w first", shape=(4,))
    connected = Output("1", "whether the line is connected", dtype=bool)

    pending = Memory((0.0,) * 65, "bytes of an incomplete packet")
    index = Memory((0.0,) * 768, "number of the row of each descriptor, by set")
    rows = Memory(0.0, "role and destination of each field")
    settings = Memory((0.0,) * 5, "rate, time of the tare, whether to tare at the start, reported set, requested sets")
    state = Memory((0.0,) * 72, "newest times, attitude of the tare, map of the clock")

    line = "dialogue"
    identify = staticmethod(queries.identify)
    sensor = "MicroStrain sensor"
    usb_vendors = (0x199B,)
    remedy = "MicroStrain's usual baud rates are 115200 and 921600"
    kernel = kernels.before
    decode = kernels.decode
    encode = kernels.encode
    hardware = ("serial", "port", "baudrate", "timeout", "sensor_to_vehicle")

    def configure(self) -> None:
        super().configure()
        self.channels = tuple(self.channels)
        known = (*COMMON, "quaternion", "euler", *EXTRA)
        strangers = [channel for channel in self.channels if channel not in known]
        if strangers or not self.channels:
            raise ValueError(
                f"channels must be among {', '.join(known)}, got {strangers[0] if strangers else 'none'!r}"
            )
        self.check_filters()
        if self.tare_at_start and self.timeout > 0.0 and self.tare_time > START_TARE_LIMIT:
            raise ValueError(
                "a tare at the start must end during arming: tare_time must be at most "
                f"{START_TARE_LIMIT:g} s, got {self.tare_time:g}"
            )
        self.fields = wanted(self.channels, self.attitude)
        extra = [
            field for field in self.fields if field.name in EXTRA and field.name not in CHANNELS[self.attitude].values()
        ]
        self.outputs = {
            **type(self).outputs,
            **{
                field.name: Output(
                    field.unit, "channel as sent by the sensor", shape=(field.values,) if field.values > 1 else ()
                ).named(field.name)
                for field in extra
            },
        }
        self.tabulate()
        sets = [any(field.set == each for field in self.fields) for each in (SENSOR, FILTER)]
        self.settings = (
            self.rate,
            self.tare_time,
            float(self.tare_at_start),
            float(not sets[0]),
            float(sets[0] + 2 * sets[1]),
        )

    def check_filters(self) -> None:
        """Check the rules between the settings of the sensor's filters. Raises ValueError."""
        for name in ("up_compensation", "north_compensation"):
            constant = getattr(self, name)
            if constant is not None and 0.0 < constant < SHORTEST_TIME_CONSTANT:
                raise ValueError(f"{name} must be 0, or 1 to 1000 s, got {constant:g} s")
        if self.low_pass > 0.0 and self.anti_aliasing:
            raise ValueError("low_pass sets a cut-off, and anti_aliasing another one or none: set one of the two")
        self.sensor_to_vehicle = tuple(self.sensor_to_vehicle)
        if len(self.sensor_to_vehicle) not in (0, 3) or not all(map(math.isfinite, self.sensor_to_vehicle)):
            raise ValueError(f"sensor_to_vehicle must be (roll, pitch, yaw) in rad, got {self.sensor_to_vehicle}")

    def tabulate(self) -> None:
        """Return the table of the kernel, see cext/kernels/devices/microstrain/mip.pyx."""
        places = kernels.decode.names
        places += [name for name in self.outputs if name not in places]
        items = {name: places.index(name) for name in self.outputs}
        meant = {
            **COMMON,
            "raw_quaternion": CHANNELS[self.attitude]["quaternion"],
            "raw_euler": CHANNELS[self.attitude]["euler"],
        }
        goes = {field: items[name] for name, field in meant.items()} | {
            name: items[name] for name in items if name in EXTRA
        }
        roles = {
            CHANNELS[self.attitude]["quaternion"]: ATTITUDE,
            CHANNELS[self.attitude]["euler"]: ANGLES,
            **dict.fromkeys(TIMES, CLOCK),
        }
        rows: list[float] = []
        index = [0.0] * 768
        asked = {field.name for field in self.fields}
        for field in FIELDS:
            if field.name not in asked and field.name not in TIMES:
                continue
            first = 2 if field.name == "temperatures" else 0  # the mean follows the smallest and the largest
            rows += [
                float(roles.get(field.name, PLAIN)),
                float(field.kind),
                float(1 if first else field.values),
                field.scale,
                float(goes.get(field.name, -1)),
                float(field.flagged),
                4.0 * first,
            ]
            for part, descriptor_set in enumerate((SENSOR, FILTER, None)):
                if field.set in (descriptor_set, SHARED):
                    index[256 * part + field.descriptor] = len(rows) / 7
        self.rows, self.index = tuple(rows), tuple(index)

    def opening(self) -> dict[str, int | str]:
        return {"serial": self.serial, "port": self.port, "baudrate": self.baudrate}

    def sends(self) -> list[tuple[float, int]]:
        """Return a packet of each set, with the shortest possible time field."""
        sizes = [
            ENVELOPE
            + SHORTEST_TIME
            + sum(2 + struct.calcsize(f">{field.layout}") for field in self.fields if field.set in (own, SHARED))
            for own in (SENSOR, FILTER)
            if any(field.set == own for field in self.fields)
        ]
        return [(self.rate, size) for size in sizes]

    def line_speed(self) -> float:
        return speed_of(self.port, self.baudrate)

    def output_range(self, **inputs: Interval) -> dict[str, Interval]:
        return {name: Interval(0.0) for name in ("age", "packets", "corrupt", "lost")}

    def set_up(self) -> Iterator[Any]:
        return set_up.set_up(self)

    def emulator(self, **parameters: Any) -> EmulatedMicroStrain:
        return EmulatedMicroStrain.of(self, **parameters)
