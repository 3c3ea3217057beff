"""The set-up of a MicroStrain sensor before a run, as a dialogue.

    base rate, formats                 requested data and their rates
    heading source, low-pass           if the block sets them
    streams, resume

Two generations differ: the older has a format command for each set and calls the streams 1 and 3; the newer has one
for all (0C 0F) and calls a stream by its set. The messages that were sent are sent again after a reconnect.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from blocks.imus.microstrain import mip
from blocks.imus.microstrain.descriptors import BY_NAME, FILTER, SENSOR
from blocks.imus.microstrain.queries import Refusal, ask, known
from graph.dialogue import Rejected

if TYPE_CHECKING:
    from blocks.imus.microstrain.descriptors import Field
    from graph.dialogue import Exchange

GENERIC_FORMAT, GENERIC_BASE_RATE = 0x0C0F, 0x0C0E
# commands format and base rate, its reply, stream
LEGACY = {SENSOR: (0x08, 0x06, 0x83, 1), FILTER: (0x0A, 0x0B, 0x8A, 3)}
HEADING, MEASUREMENT, MAGNETIC_FIELD = 0x0D18, 0x0D50, 0x8006
INVALID_PARAMETER = 3  # of an acknowledgement
MAGNETOMETER_HEADING, MAGNETOMETER_MEASUREMENT = 1, 4
NEW_LOW_PASS, OLD_LOW_PASS = 0x0C54, 0x0C50
VENDOR_PROGRAM = "MicroStrain's program SensorConnect shows which settings the sensor accepts"


def set_up(device: Any) -> Iterator[Exchange]:
    """Configure a sensor for a MicroStrain block; return (messages sent, remarks for the operator).

    Raises Rejected, NoReply, Refusal.
    """
    sensor = SetUp(device, (yield from known()))
    yield from sensor.send()
    return sensor.messages, sensor.remarks


class SetUp:
    """device : blocks.imus.MicroStrain; known : commands and data of the sensor"""

    def __init__(self, device: Any, known: set[int]) -> None:
        self.device, self.known = device, known
        self.newer = GENERIC_FORMAT in known
        self.messages, self.remarks = [mip.command(mip.BASE, mip.IDLE)], []

    def send(self) -> Iterator[Exchange]:
        """Set the format of its messages, the heading source and the low-pass. Raises Rejected or NoReply."""
        formats = {descriptor_set: self.fields(descriptor_set) for descriptor_set in (SENSOR, FILTER)}
        lacking = [field.name for field in self.device.fields if not self.has(field)]
        if lacking:
            self.remarks.append(f"has no {', '.join(lacking)}: those outputs are NaN")
        if not any(formats.values()):
            self.refuse(
                f"it supports none of {', '.join(field.name for field in self.device.fields)}",
                "select supported ones: channels=...",
            )
        for descriptor_set, fields in formats.items():
            if self.has_set(descriptor_set):
                yield from self.format(descriptor_set, fields)
        yield from self.heading()
        yield from self.low_pass()
        for descriptor_set, fields in formats.items():
            if self.has_set(descriptor_set):
                stream = descriptor_set if self.newer else LEGACY[descriptor_set][3]
                yield from self.apply(
                    mip.command(mip.COMMAND_3DM, 0x11, "BBB", mip.WRITE, stream, bool(fields)), "its stream"
                )
        yield from self.apply(mip.command(mip.BASE, mip.RESUME), "to resume")

    def has(self, field: Field) -> bool:
        """Return whether the sensor can send a field."""
        return field.set << 8 | field.descriptor in self.known or (
            field.set == 0x100
            and any(descriptor_set << 8 | field.descriptor in self.known for descriptor_set in (SENSOR, FILTER))
        )

    def has_set(self, descriptor_set: int) -> bool:
        """Return whether the sensor has any command or field of a descriptor set."""
        return any(number >> 8 == descriptor_set for number in self.known)

    def fields(self, descriptor_set: int) -> list[int]:
        """Return the descriptors to request of a set, its time first; [] for none."""
        wanted = [
            field.descriptor
            for field in self.device.fields
            if field.set in (descriptor_set, 0x100) and descriptor_set << 8 | field.descriptor in self.known
        ]
        own = [field for field in self.device.fields if field.set == descriptor_set and self.has(field)]
        if not own:
            return []
        legacy = BY_NAME["sensor_time" if descriptor_set == SENSOR else "filter_time"].descriptor
        time_of = next((number for number in (0xD5, 0xD3, legacy) if descriptor_set << 8 | number in self.known), None)
        return list(dict.fromkeys(([] if time_of is None else [time_of]) + wanted))

    def format(self, descriptor_set: int, fields: Sequence[int]) -> Iterator[Exchange]:
        """Select the fields that the sensor sends in a descriptor set."""
        decimation = (yield from self.decimation(descriptor_set)) if fields else 1
        body = b"".join(struct.pack(">BH", field, decimation) for field in fields)
        if self.newer:
            data = bytes((mip.WRITE, descriptor_set, len(fields))) + body
            packet = mip.packet(mip.COMMAND_3DM, (GENERIC_FORMAT & 0xFF, data))
        else:
            packet = mip.packet(mip.COMMAND_3DM, (LEGACY[descriptor_set][0], bytes((mip.WRITE, len(fields))) + body))
        yield from self.apply(
            packet, f"the format of set {descriptor_set:02X}: {' '.join(f'{field:02X}' for field in fields)}"
        )

    def decimation(self, descriptor_set: int) -> Iterator[Exchange]:
        """Return the integer by which the base rate is divided. Raises Rejected if it is not an integer."""
        if self.newer and GENERIC_BASE_RATE in self.known:
            reply = yield from self.ask(mip.command(mip.COMMAND_3DM, 0x0E, "B", descriptor_set), "its base rate")
            [base] = struct.unpack(">H", reply[0x8E][1:3])
        else:
            _, command, field, _ = LEGACY[descriptor_set]
            reply = yield from self.ask(mip.command(mip.COMMAND_3DM, command), "its base rate")
            [base] = struct.unpack(">H", reply[field][:2])
        ratio = base / self.device.rate
        if ratio < 1.0 - 1e-6 or abs(ratio - round(ratio)) > 1e-6:
            near = sorted({base / divisor for divisor in (int(ratio) or 1, int(ratio) + 1)}, reverse=True)
            self.refuse(
                f"rate {self.device.rate:g} Hz is not its base rate, {base} Hz, divided by an integer",
                f"set rate to {' or '.join(f'{rate:g}' for rate in near)} Hz",
            )
        return round(ratio)

    def heading(self) -> Iterator[Exchange]:
        """Select the heading source of its filter. Raises Rejected if it cannot use a magnetometer."""
        if not self.device.heading:
            return
        magnetic = self.device.heading == "magnetometer"
        if magnetic and (MAGNETIC_FIELD not in self.known or not {HEADING, MEASUREMENT} & set(self.known)):
            why = "no magnetometer" if MAGNETIC_FIELD not in self.known else "no command to enable one"
            self.refuse(
                f"its filter cannot use a magnetometer for the heading: it has {why}",
                'omit `heading`, or set it to "none"',
            )
        if HEADING in self.known:
            yield from self.apply(
                mip.command(mip.COMMAND_FILTER, 0x18, "BB", mip.WRITE, MAGNETOMETER_HEADING * magnetic),
                "its heading source",
            )
        elif MEASUREMENT in self.known:
            yield from self.measure(magnetic)
        else:
            self.remarks.append("has no command for its heading source, which remains unchanged")

    def measure(self, magnetic: bool) -> Iterator[Exchange]:
        """Set whether the filter of the newer generation uses the magnetometer, as in MicroStrain's own examples.

        A sensor without a magnetometer rejects the source as unknown, which has the same effect as disabling it.
        """
        packet = mip.command(mip.COMMAND_FILTER, 0x50, "BHB", mip.WRITE, MAGNETOMETER_MEASUREMENT, magnetic)
        try:
            yield from ask(packet)
        except Refusal as refusal:
            if magnetic or refusal.code != INVALID_PARAMETER:
                self.refuse(f"its heading source: {refusal}", VENDOR_PROGRAM)
        else:
            self.messages.append(packet)

    def low_pass(self) -> Iterator[Exchange]:
        """Set the low-pass of the selected sensor channels. Does nothing without a cutoff."""
        cutoff = self.device.low_pass
        if cutoff <= 0.0:
            return
        for name in ("accel", "gyro", "mag"):
            field = BY_NAME[name]
            if not self.has(field) or field not in self.device.fields:
                continue
            if NEW_LOW_PASS in self.known:
                yield from self.apply(
                    mip.command(mip.COMMAND_3DM, 0x54, "BBBBBf", mip.WRITE, SENSOR, field.descriptor, 1, 1, cutoff),
                    f"the low-pass of {name}",
                )
            elif OLD_LOW_PASS in self.known:
                yield from self.apply(
                    mip.command(mip.COMMAND_3DM, 0x50, "BBBBHB", mip.WRITE, field.descriptor, 1, 1, round(cutoff), 0),
                    f"the low-pass of {name}",
                )
            else:
                self.remarks.append("has no command for its low-pass, which remains unchanged")
                return

    def apply(self, packet: bytes, what: str) -> Iterator[Exchange]:
        """Send a setting, and keep it for a reconnect."""
        yield from self.ask(packet, what)
        self.messages.append(packet)

    def ask(self, packet: bytes, what: str) -> Iterator[Exchange]:
        """Send a packet and return the reply. Raises Rejected if the sensor refuses it.

        what : name of the packet, for the message
        """
        try:
            return (yield from ask(packet))
        except Refusal as refusal:
            self.refuse(f"{what}: {refusal}", VENDOR_PROGRAM)

    def refuse(self, message: str, hint: str) -> Any:
        """Raise Rejected."""
        raise Rejected(message, hint)
