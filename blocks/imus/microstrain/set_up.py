"""The set-up of a MicroStrain sensor before a run, as a dialogue.

    base rate, formats                 requested data and their rates
    filters and mounting               as the block sets them; read back, set or not
    streams, resume

Two generations differ: the older has a format command for each set and calls the streams 1 and 3; the newer has one
for all (0C 0F) and calls a stream by its set. The messages that were sent are sent again after a reconnect.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from blocks.imus.microstrain import mip
from blocks.imus.microstrain.commands import GENERIC_FORMAT, Commands
from blocks.imus.microstrain.descriptors import FILTER, SENSOR, lacking, requested
from blocks.imus.microstrain.filters import SETTINGS
from blocks.imus.microstrain.queries import known_commands

if TYPE_CHECKING:
    from graph.dialogue import Dialogue

GENERIC_BASE_RATE = 0x0C0E
# commands format and base rate, its reply, stream
LEGACY = {SENSOR: (0x08, 0x06, 0x83, 1), FILTER: (0x0A, 0x0B, 0x8A, 3)}


def set_up(device: Any) -> Dialogue:
    """Configure a sensor for a MicroStrain block; return (messages sent, remarks for the operator, settings read back).

    Raises Rejected, NoReply, Refusal.
    """
    sensor = SetUp(device, (yield from known_commands()))
    yield from sensor.send()
    return sensor.messages, sensor.remarks, sensor.settings


class SetUp(Commands):
    """The set-up of a sensor for a MicroStrain block."""

    def send(self) -> Dialogue:
        """Set the format of its messages, its filters and mounting, and start its streams. Raises Rejected, NoReply."""
        device = self.device
        missing, refused = lacking(device.channels, device.attitude, self.known)
        if refused:
            self.refuse(f"it has no {', '.join(refused)}", "select channels that it supports: channels=...")
        if missing:
            self.remarks.append(f"has no {', '.join(missing)}: those outputs are NaN")
        formats = {each: requested(device.fields, each, self.known) for each in (SENSOR, FILTER)}
        for descriptor_set, fields in formats.items():
            if self.has_set(descriptor_set):
                yield from self.format(descriptor_set, fields)
        for setting in SETTINGS:
            yield from setting(self)
        for descriptor_set, fields in formats.items():
            if self.has_set(descriptor_set):
                stream = descriptor_set if self.newer else LEGACY[descriptor_set][3]
                yield from self.apply(
                    mip.command(mip.COMMAND_3DM, 0x11, "BBB", mip.WRITE, stream, bool(fields)), "its stream"
                )
        yield from self.apply(mip.command(mip.BASE, mip.RESUME), "to resume")

    def has_set(self, descriptor_set: int) -> bool:
        """Return whether the sensor has any command or field of a descriptor set."""
        return any(number >> 8 == descriptor_set for number in self.known)

    def format(self, descriptor_set: int, fields: Sequence[int]) -> Dialogue:
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

    def decimation(self, descriptor_set: int) -> Dialogue:
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
