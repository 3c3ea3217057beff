"""Queries of a MicroStrain sensor, as dialogues: its identity, its commands, and its reply to any command."""

from __future__ import annotations

import struct
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from blocks.imus.microstrain import mip
from graph.dialogue import Dialogue, Exchange, NoReply

TEXT = 16  # characters of each text in the device information, right-justified
REPLY_TIMEOUT = 0.25  # s
ATTEMPTS = 3
QUESTION, ANSWER = mip.command(mip.BASE, mip.INFO), 0x81
CAUSES = {1: "unknown command", 2: "wrong checksum", 3: "invalid value", 4: "the command failed", 5: "it took too long"}


class Refusal(ValueError):
    """A command that the sensor has rejected. code : error code of the acknowledgement"""

    def __init__(self, command: int, code: int) -> None:
        super().__init__(CAUSES.get(code, f"code {code}"))
        self.command, self.code = command, code


@dataclass(frozen=True)
class Information:
    """firmware as the vendor writes it, model, number, serial, lot, options: texts; raw : the data of the field"""

    firmware: str
    model: str
    number: str
    serial: str
    lot: str
    options: str
    raw: bytes = b""

    @classmethod
    def of(cls, data: bytes) -> Information:
        """From the data of field 01 81. ValueError"""
        if len(data) < 2 + 5 * TEXT:
            raise ValueError(f"a device information has {2 + 5 * TEXT} bytes, not {len(data)}")
        [firmware] = struct.unpack_from(">H", data)
        texts = (data[at : at + TEXT].decode("ascii", "replace").strip(" \0") for at in range(2, 2 + 5 * TEXT, TEXT))
        version = f"{firmware // 1000}.{firmware % 1000 // 100}.{firmware % 100}"
        return cls(version, *texts, raw=bytes(data))

    def ends_with(self, digits: str) -> bool:
        """Return whether the serial number ends with these digits: 133931 is that of 6253.133931."""
        return bool(digits) and self.serial.endswith(digits)

    def proof(self) -> tuple[bytes, bytes]:
        """Return (query, reply); the reply contains the serial number and is unique to this sensor."""
        return QUESTION, bytes((2 + len(self.raw), ANSWER)) + self.raw


def ask(packet: bytes, attempts: int = ATTEMPTS, timeout: Any = REPLY_TIMEOUT) -> Dialogue:
    """Send a packet of one command; return {descriptor: data} of the fields beside its acknowledgement.

    Raises NoReply, Refusal.
    """
    descriptor_set, [(command, _)] = packet[2], mip.fields(packet)
    for _ in range(attempts):
        rest, data = b"", (yield Exchange(packet, timeout))
        while data:
            packets, rest, _ = mip.split(rest + data)
            for reply in packets:
                fields = mip.fields(reply)
                codes = [
                    data[1] for field, data in fields if field == mip.ACKNOWLEDGE and data[:1] == bytes((command,))
                ]
                if reply[2] == descriptor_set and codes:
                    if codes[0]:
                        raise Refusal(command, codes[0])
                    return {field: data for field, data in fields if field != mip.ACKNOWLEDGE}
            data = yield Exchange()
    raise NoReply


def identify(attempts: int = ATTEMPTS) -> Dialogue:
    """Return the Information of a sensor, and leave it idle. Raises NoReply."""
    with suppress(Refusal):
        yield from ask(mip.command(mip.BASE, mip.IDLE), attempts)
    with suppress(Refusal):
        yield from ask(mip.command(mip.BASE, mip.PING))
    return Information.of((yield from ask(QUESTION)).get(ANSWER, b""))


def known_commands() -> Dialogue:
    """Return the commands and data of a sensor: sets and descriptors in one number each."""
    numbers: set[int] = set()
    for command, reply in ((mip.DESCRIPTORS, 0x82), (mip.MORE_DESCRIPTORS, 0x86)):
        if command == mip.MORE_DESCRIPTORS and mip.BASE << 8 | command not in numbers:
            break
        data = (yield from ask(mip.command(mip.BASE, command))).get(reply, b"")
        numbers |= {data[at] << 8 | data[at + 1] for at in range(0, len(data) - 1, 2)}
    return numbers
