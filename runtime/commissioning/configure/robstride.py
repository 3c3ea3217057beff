"""Setting up a RobStride drive or a CyberGear: its id, its zero, its protocol, its parameters. Everything is read
before and after.
"""

import math
import struct

from blocks.actuators.cubemars import asking as mit
from blocks.actuators.robstride import asking, parameters
from graph.names import suggestion
from runtime.base.errors import BadInput
from runtime.commissioning.scan import SETTLE, read, refuse_company

STILL, IDLE = 0.1, 0.3  # rad/s and A, from which on a drive counts as running
VENDOR_ONLY = (
    "it is a CubeMars, whose id, mode and limits are set in CubeMars' own program alone (--zero works on the bus, by "
    "its id): connect its serial port with the vendor's R-Link "
    "adapter, open the program's page of the drive's CAN settings, write the id there, and store it; MIT or servo "
    "mode is chosen there"
)


class NotPrivate(BadInput):
    """Nobody has that id in the private protocol."""


class Drive:
    """A drive in the private protocol that alone has its id. BadInput in words where there is none, several, or another
    kind.
    """

    def __init__(self, bus, can_id):
        self.bus, self.can_id = bus, can_id
        refuse_company(bus)
        known = self.identities(can_id)
        if len(known) > 1:
            raise BadInput(f"{len(known)} drives have id {can_id}: {' and '.join(known)}; take all but one off the bus")
        if not known:
            raise NotPrivate(self.nobody())
        self.unique = known[0]
        self.is_robstride = None  # not known before it has been stopped

    def identities(self, can_id):
        self.bus.send(asking.get_id(can_id), "get id")
        return [unique for frame in self.bus.listen(SETTLE) if (unique := asking.identity(*frame, can_id)) is not None]

    def in_mit_mode(self, can_id):
        return self.bus.ask(mit.question(can_id), "disable", lambda *frame: mit.answer(*frame, can_id), attempts=1)

    def nobody(self):
        answer = self.in_mit_mode(self.can_id)
        if answer is None:
            return f"nobody answers as id {self.can_id}; the command `scan` tells who is on the bus"
        if answer.family == mit.MIT:
            return f"id {self.can_id}: {VENDOR_ONLY}"
        return (
            f"id {self.can_id} speaks RobStride's MIT protocol, and is set up in its private one: --protocol "
            "private, then its power off and on"
        )

    def read(self, name, is_cybergear=False):
        return read(self.bus, self.can_id, parameters.PARAMETERS[name], is_cybergear)

    def refuse_running(self):
        """BadInput if it turns or holds something."""
        velocity, current = self.read("mechVel"), self.read("iqf")
        if velocity is None:
            raise BadInput(
                f"id {self.can_id} does not tell its velocity: whether it runs is not known, so nothing was changed"
            )
        if not abs(velocity) < STILL or (current is not None and not abs(current) < IDLE):
            holding = "" if current is None else f", {current:.2f} A"
            raise BadInput(
                f"id {self.can_id} runs ({velocity:.2f} rad/s{holding}): stop what drives it first; nothing was changed"
            )

    def stop(self):
        """Stop it, and learn whether it is a RobStride. BadInput if it does not say that it stands."""
        answer = self.bus.ask(asking.stop(self.can_id), "stop", lambda *frame: asking.feedback(*frame, self.can_id))
        if answer is None or answer.enabled:
            raise BadInput(f"id {self.can_id} does not confirm that it has stopped; nothing was changed")
        firmware = self.bus.ask(
            asking.version(self.can_id), "stop and version", lambda *frame: asking.firmware(*frame, self.can_id)
        )
        self.is_robstride = bool(firmware)
        return answer

    def need_robstride(self, what):
        if not self.is_robstride:
            raise BadInput(
                f"{what}: id {self.can_id} has not told a RobStride's firmware, so it may be a CyberGear, to which "
                "such frames mean "
                "other things (to save: another baud rate); nothing was changed. For a RobStride with old firmware "
                "use the vendor's program"
            )

    def check_free(self, new):
        if self.identities(new) or self.in_mit_mode(new) is not None:
            raise BadInput(f"id {new} is on the bus already: {self.can_id} keeps its own; nothing was changed")


def settings_of(texts):
    """(Parameter, value) of NAME=VALUE. BadInput"""
    found = []
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals:
            raise BadInput(f"--write {text}: expected NAME=VALUE, as in limit_torque=10")
        parameter = named(name.strip(), "--write")
        if not parameter.writable:
            raise BadInput(
                f"--write {name}: it is {parameter.meaning}, which is measured or commanded, and is not set up"
            )
        try:
            number = float(value)
            if not math.isfinite(number) or (parameter.is_whole() and number != int(number)):
                raise ValueError
            asking.write(parameter, number, 1)
        except (ValueError, OverflowError, struct.error):
            kind = "a whole number that fits it" if parameter.is_whole() else f"a number ({parameter.unit})"
            raise BadInput(f"--write {text}: expected {kind}") from None
        found.append((parameter, number))
    return found


def named(name, option):
    try:
        return parameters.find(name)
    except ValueError as error:
        raise BadInput(f"{option} {name}: {error}") from None


def protocol(text):
    if text not in asking.PROTOCOLS:
        raise BadInput(
            f"--protocol {text}: {suggestion(text, asking.PROTOCOLS) or 'there are ' + ', '.join(asking.PROTOCOLS)}"
        )
    return text


def same(parameter, wanted, got):
    """Whether what was read back is what was written, in single precision."""
    if got is None:
        return False
    return got == int(wanted) if parameter.is_whole() else got == struct.unpack("<f", struct.pack("<f", wanted))[0]
