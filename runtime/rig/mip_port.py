"""A MicroStrain sensor behind an open port: asked one command at a time, before anything is armed."""

import time
from contextlib import suppress

from blocks.imus.microstrain import mip
from blocks.imus.microstrain.asking import Information

PATIENCE = 0.25  # s for an answer
ATTEMPTS = 3
NO_SUCH_COMMAND = 1
WHO, TOLD = mip.command(mip.BASE, mip.INFO), 0x81
WHY = {
    1: "it does not know the command",
    2: "it got a wrong checksum",
    3: "it does not take that value",
    4: "it failed",
    5: "it took too long",
}


class Silent(Exception):
    """Nobody has answered."""


class Refusal(Exception):
    """It has answered that it does not do that. code : of MIP's acknowledgement"""

    def __init__(self, command, code):
        super().__init__(WHY.get(code, f"code {code}"))
        self.command, self.code = command, code


class MipPort:
    """port : pyserial's Serial, open"""

    def __init__(self, port):
        self.port = port
        self.rest = self.told = b""

    def ask(self, packet, attempts=ATTEMPTS, patience=PATIENCE):
        """{descriptor: data} of the fields that come back with the acknowledgement of a packet of one command. Silent,
        Refusal
        """
        descriptor_set, [(command, _)] = packet[2], mip.fields(packet)
        for _ in range(attempts):
            self.port.write(packet)
            deadline = time.monotonic() + patience
            while time.monotonic() < deadline:
                found = self.answer(descriptor_set, command)
                if found is not None:
                    return found
                time.sleep(0.0005)
        raise Silent

    def answer(self, descriptor_set, command):
        self.rest += self.port.read(4096)
        packets, self.rest, _ = mip.split(self.rest)
        for packet in packets:
            found = mip.fields(packet)
            if packet[2] == descriptor_set and (mip.ACKNOWLEDGE, command) in (
                (field, data[0]) for field, data in found if data
            ):
                code = next(data[1] for field, data in found if field == mip.ACKNOWLEDGE)
                if code:
                    raise Refusal(command, code)
                return {field: data for field, data in found if field != mip.ACKNOWLEDGE}
        return None

    def identify(self, attempts=ATTEMPTS, patience=PATIENCE):
        """Its Information, once it is idle. Silent"""
        with suppress(Refusal):
            self.ask(mip.command(mip.BASE, mip.IDLE), attempts, patience)
        with suppress(Refusal):
            self.ask(mip.command(mip.BASE, mip.PING))
        self.told = self.ask(WHO).get(TOLD, b"")
        return Information.of(self.told)

    def proof(self):
        """(what asks who it is, what this one answers): with its serial number no other says the same. Once it was
        identified
        """
        return WHO, bytes((2 + len(self.told), TOLD)) + self.told

    def known(self):
        """Its commands and data: sets and descriptors in one number each."""
        found = set()
        for command, reply in ((mip.DESCRIPTORS, 0x82), (mip.MORE_DESCRIPTORS, 0x86)):
            if command == mip.MORE_DESCRIPTORS and mip.BASE << 8 | command not in found:
                break
            data = self.ask(mip.command(mip.BASE, command)).get(reply, b"")
            found |= {data[at] << 8 | data[at + 1] for at in range(0, len(data) - 1, 2)}
        return found
