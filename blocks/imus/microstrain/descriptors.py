"""Fields of MIP data packets: the table that the block, the emulator, the set-up and the tools share.

Source: MicroStrain's MIP SDK 4.0 and the data communications protocol of the 3DM-GX5. Note: 80 10 and 80 11
are the stabilised vectors; the time since power-on of newer devices is D5.
"""

from __future__ import annotations

import struct
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

SENSOR, FILTER, SHARED = 0x80, 0x82, 0x100  # sets; a shared field may be in any
STANDARD_GRAVITY = 9.80665  # m/s²
KINDS = {
    "f": 0,
    "d": 1,
    "B": 2,
    "H": 3,
    "I": 4,
    "Q": 5,
}  # of a value, as cext/kernels/devices/microstrain/mip.pyx numbers them
SIZES = {"f": 4, "d": 8, "B": 1, "H": 2, "I": 4, "Q": 8}


@dataclass(frozen=True)
class Field:
    """Field of a data packet.

    set, descriptor : its numbers
    name : name of the field's values
    layout : layout of the field's data, as a format of struct without the byte order
    unit : SI unit of the values; scale : factor from the wire to this unit
    flagged : whether its last word states that the filter marks it as valid
    """

    set: int
    descriptor: int
    name: str
    layout: str
    unit: str = "1"
    scale: float = 1.0
    flagged: bool = False

    @property
    def values(self) -> int:
        """Return the number of values, without flags and what else follows them."""
        return len(self.layout) - len(self.layout.lstrip(self.layout[0])) - (self.flagged and self.layout[0] == "H")

    @property
    def kind(self) -> int:
        """Number of its layout in the kernel."""
        return KINDS[self.layout[0]]

    def decode(self, data: Any) -> Any:
        """Values in SI, None if the field is too short. Of a field that the filter calls invalid they are none."""
        form = struct.Struct(">" + self.layout)
        if len(data) < form.size:
            return None
        found = form.unpack_from(data)
        if self.flagged and not found[-1]:
            return [float("nan")] * self.values
        return [value * self.scale for value in found[: self.values]]


FIELDS = (
    Field(SENSOR, 0x04, "accel", "fff", "m/s²", STANDARD_GRAVITY),
    Field(SENSOR, 0x05, "gyro", "fff", "rad/s"),
    Field(SENSOR, 0x06, "mag", "fff", "µT", 100.0),
    Field(SENSOR, 0x07, "delta_angle", "fff", "rad"),
    Field(SENSOR, 0x08, "delta_velocity", "fff", "m/s", STANDARD_GRAVITY),
    Field(SENSOR, 0x09, "sensor_matrix", "fffffffff"),
    Field(SENSOR, 0x0A, "sensor_quaternion", "ffff"),
    Field(SENSOR, 0x0C, "sensor_euler", "fff", "rad"),
    Field(SENSOR, 0x0E, "internal_ticks", "I"),
    Field(SENSOR, 0x10, "stabilised_mag", "fff", "µT", 100.0),
    Field(SENSOR, 0x11, "stabilised_accel", "fff", "m/s²", STANDARD_GRAVITY),
    Field(SENSOR, 0x12, "sensor_time", "dHH", "s"),
    Field(SENSOR, 0x14, "temperatures", "fff", "°C"),
    Field(SENSOR, 0x17, "pressure", "f", "Pa", 100.0),
    Field(FILTER, 0x03, "filter_quaternion", "ffffH", flagged=True),
    Field(FILTER, 0x04, "filter_matrix", "fffffffffH", flagged=True),
    Field(FILTER, 0x05, "filter_euler", "fffH", "rad", flagged=True),
    Field(FILTER, 0x06, "gyro_bias", "fffH", "rad/s", flagged=True),
    Field(FILTER, 0x0D, "linear_accel", "fffH", "m/s²", flagged=True),
    Field(FILTER, 0x0E, "compensated_gyro", "fffH", "rad/s", flagged=True),
    Field(FILTER, 0x10, "filter_status", "HHH"),
    Field(FILTER, 0x11, "filter_time", "dHH", "s"),
    Field(FILTER, 0x13, "gravity", "fffH", "m/s²", flagged=True),
    Field(FILTER, 0x1C, "compensated_accel", "fffH", "m/s²", flagged=True),
    Field(SHARED, 0xD0, "event", "B"),
    Field(SHARED, 0xD1, "ticks", "I"),
    Field(SHARED, 0xD2, "delta_ticks", "I"),
    Field(SHARED, 0xD3, "gps_time", "dHH", "s"),
    Field(SHARED, 0xD4, "delta_time", "d", "s"),
    Field(SHARED, 0xD5, "reference_time", "Q", "s", 1e-9),
    Field(SHARED, 0xD6, "delta_reference_time", "Q", "s", 1e-9),
    Field(SHARED, 0xD7, "external_time", "QH", "s", 1e-9, flagged=True),
    Field(SHARED, 0xD8, "delta_external_time", "QH", "s", 1e-9, flagged=True),
)
BY_NAME = {field.name: field for field in FIELDS}
BY_KEY = {(field.set, field.descriptor): field for field in FIELDS}
TIMES = ("reference_time", "gps_time", "sensor_time", "filter_time")  # times of a sample

# What a block's channel is on the wire, by where its attitude comes from.
CHANNELS = {
    "filter": {"quaternion": "filter_quaternion", "euler": "filter_euler"},
    "sensor": {"quaternion": "sensor_quaternion", "euler": "sensor_euler"},
}
COMMON = {"accel": "accel", "gyro": "gyro", "mag": "mag", "temperature": "temperatures"}
STANDARD = ("accel", "gyro", "mag", "quaternion", "temperature")  # channels that are requested by default
UNTURNED = (  # older generation: what is wrong, and the remedy
    "sensor_to_vehicle, does not turn the attitude of its complementary filter",
    'set attitude="filter", or sensor_to_vehicle=(0.0, 0.0, 0.0)',
)
EXTRA = tuple(field.name for field in FIELDS if field.name not in COMMON.values())


def field_of(descriptor_set: Any, descriptor: Any) -> Any:
    """The Field, None if it is not known."""
    return BY_KEY.get((descriptor_set, descriptor)) or BY_KEY.get((SHARED, descriptor))


def wanted(channels: tuple[str, ...], attitude: str) -> list[Field]:
    """The Fields of a block's channels, in the order of the table."""
    names = {name_of(channel, attitude) for channel in channels}
    return [field for field in FIELDS if field.name in names]


def name_of(channel: str, attitude: str) -> str:
    """Return the name of the Field of a block's channel."""
    return (COMMON | CHANNELS[attitude]).get(channel, channel)


def of_complementary_filter(fields: Sequence[Field]) -> bool:
    """Return whether an attitude of the complementary filter is among Fields."""
    return any(field.name in ("sensor_quaternion", "sensor_euler", "sensor_matrix") for field in fields)


def is_known(field: Field, known: Collection[int]) -> bool:
    """Return whether a sensor sends a field. known : its data, each as set and descriptor in one number"""
    sets = (SENSOR, FILTER) if field.set == SHARED else (field.set,)
    return any(each << 8 | field.descriptor in known for each in sets)


def lacking(channels: Sequence[str], attitude: str, known: Collection[int]) -> tuple[list[str], list[str]]:
    """Return the channels that a sensor lacks: (those that may be NaN, those that a diagram must not request).

    Every channel by default is of the first kind, as long as another one is available.
    """
    missing = [name for name in channels if not is_known(BY_NAME[name_of(name, attitude)], known)]
    refused = missing if len(missing) == len(channels) else [name for name in missing if name not in STANDARD]
    return [name for name in missing if name not in refused], refused


def requested(fields: Sequence[Field], descriptor_set: int, known: Collection[int]) -> list[int]:
    """Return the descriptors to request of a set, its time first; [] for none. known : as for is_known"""
    if not any(field.set == descriptor_set and is_known(field, known) for field in fields):
        return []
    legacy = BY_NAME["sensor_time" if descriptor_set == SENSOR else "filter_time"].descriptor
    times = [number for number in (0xD5, 0xD3, legacy) if descriptor_set << 8 | number in known]
    own = [field.descriptor for field in fields if field.set in (descriptor_set, SHARED)]
    return list(dict.fromkeys(times[:1] + [number for number in own if descriptor_set << 8 | number in known]))
