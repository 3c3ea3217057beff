"""The set-up of a RobStride drive or a CyberGear: its id, zero, protocol and parameters.

The drive is stopped first, everything is read before and after, and a running drive is not changed.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from blocks.actuators.queries import disable_in_mit_mode
from blocks.actuators.robstride import frames, parameters, queries
from graph.dialogue import Confirm, Dialogue, Listen, Rejected, Send, Show, ask
from graph.names import suggestion

if TYPE_CHECKING:
    from blocks.actuators.robstride.parameters import Parameter
    from graph.family import Request

MAX_VELOCITY, MAX_CURRENT = 0.1, 0.3  # rad/s and A of a drive at rest
IDENTITY_TIME = 0.08  # s in which every drive with an id replies
ZERO_TOLERANCE = 0.01  # rad
# frame of the MIT protocol that selects the private protocol from the next power-on
SWITCH_BACK = b"\xff\xff\xff\xff\xff\xff\x00\xfd"
POWER_CYCLE = "it takes effect at the next power-on. Then run `scan`"


def check(request: Request) -> None:
    """Raise Rejected for parameters and protocols that no drive has."""
    reads(request)
    writes(request)
    if request.protocol not in (None, *queries.PROTOCOLS):
        hint = suggestion(request.protocol, queries.PROTOCOLS) or f"expected {', '.join(queries.PROTOCOLS)}"
        raise Rejected(f"--protocol {request.protocol}: {hint}")


def reads(request: Request) -> list[Parameter]:
    """Return the Parameters to read."""
    if "all" in request.reads:
        return list(parameters.PARAMETERS.values())
    return [parameter_of(name, "--read") for name in request.reads]


def writes(request: Request) -> list[tuple[Parameter, float]]:
    """Return [(Parameter, number)] of the texts NAME=VALUE."""
    found: list[tuple[Parameter, float]] = []
    for text in request.writes:
        name, equals, value = text.partition("=")
        if not equals:
            raise Rejected(f"--write {text}: expected NAME=VALUE, as in limit_torque=10")
        parameter = parameter_of(name.strip(), "--write")
        if not parameter.writable:
            raise Rejected(f"--write {name}: {parameter.meaning} is measured or commanded and cannot be configured")
        try:
            number = float(value)
            if not math.isfinite(number) or (parameter.is_whole() and number != int(number)):
                raise ValueError
            queries.write(parameter, number, 1)
        except (ValueError, OverflowError, struct.error):
            kind = (
                "an integer in the range of the parameter" if parameter.is_whole() else f"a number ({parameter.unit})"
            )
            raise Rejected(f"--write {text}: expected {kind}") from None
        found.append((parameter, number))
    return found


def parameter_of(name: str, option: str) -> Parameter:
    """Return a parameter by its name. option : command-line option named in the message

    Raises Rejected for an unknown parameter.
    """
    try:
        return parameters.find(name)
    except ValueError as error:
        raise Rejected(f"{option} {name}: {error}") from None


def set_up(request: Request) -> Dialogue:
    """Dialogue of graph.family.Family.set_up."""
    if request.protocol == "private" and not request.other_than("--protocol"):
        if (done := (yield from switch_back(request.can_id))) is not None:
            return done
    drive = Drive(request.can_id)
    known = yield from drive.identities(drive.can_id)
    if len(known) > 1:
        raise Rejected(f"{len(known)} drives have id {drive.can_id}: {' and '.join(known)}. Disconnect all but one")
    if not known:
        return (yield from drive.absent())
    drive.unique = known[0]
    check(request)
    return (yield from drive.carry_out(request))


def switch_back(can_id: int) -> Dialogue:
    """Send a drive in the MIT protocol back to the private one; None where no drive responds in that protocol."""
    if (yield from in_mit_mode(can_id)) is None:
        return None
    yield Show((f"  id {can_id}: protocol: mit -> private, from the next power-on",))
    if not (yield Confirm("apply these changes")):
        return True
    yield Send((can_id, False, SWITCH_BACK), "set protocol")
    yield Listen(0.1)
    yield Show((f"sent: protocol private; {POWER_CYCLE}",))
    return True


def in_mit_mode(can_id: int, attempts: int = 2) -> Dialogue:
    """Return the state of a drive in MIT mode, which this disables; None if it does not reply."""
    read = partial(queries.state_in_mit_mode, can_id=can_id)
    return (yield from ask(disable_in_mit_mode(can_id), "disable", read, attempts=attempts))


class Drive:
    """A drive in the private protocol that alone has its id."""

    def __init__(self, can_id: int) -> None:
        self.can_id, self.unique = can_id, ""
        self.is_robstride = False  # not known before it has been stopped

    def identities(self, can_id: Any) -> Dialogue:
        """Return the unique numbers of the drives that respond to an id."""
        yield Send(queries.get_id(can_id), "get id")
        received = yield Listen(IDENTITY_TIME)
        return [unique for frame in received if (unique := queries.identity(*frame, can_id=can_id)) is not None]

    def absent(self) -> Dialogue:
        """Return None unless a drive in the MIT protocol responds instead; then raise Rejected."""
        if (yield from in_mit_mode(self.can_id, attempts=1)) is None:
            return None
        raise Rejected(
            f"id {self.can_id} uses RobStride's MIT protocol and can be configured only in the private one. Run "
            "configure with --protocol private, then cycle its power"
        )

    def read(self, name: str) -> Dialogue:
        """Return the value of a parameter; None if the drive does not report it. name : name of the parameter"""
        return (yield from queries.value(self.can_id, parameters.PARAMETERS[name]))

    def carry_out(self, request: Request) -> Dialogue:
        """Show, confirm, write and read back; return whether every change was confirmed."""
        yield Show((f"id {self.can_id}, unique {self.unique}",))
        for parameter in reads(request):
            value = yield from self.read(parameter.name)
            text = "-" if value is None else parameter.text(value)
            yield Show((f"  {parameter.name:<14} {text:<14} {parameter.meaning}",))
        if not request.other_than("--read"):
            return True
        yield from self.refuse_running()
        yield from self.stop()
        yield from self.check(request)
        wanted = writes(request)
        before: dict[str, float | None] = {}
        for parameter, _ in wanted:
            before[parameter.name] = yield from self.read(parameter.name)
        position = (yield from self.read("mechPos")) if request.zero else None
        yield Show(tuple(self.planned(request, wanted, before, position)))
        if not (yield Confirm("apply these changes")):
            return True
        done: list[bool] = []
        for parameter, value in wanted:
            done.append((yield from self.write(parameter, value)))
        for asked, change in (
            (request.zero, self.zero),
            (request.save, self.save),
            (request.protocol, lambda: self.switch(request.protocol)),
            (request.new_id, lambda: self.rename(request.new_id)),
        ):
            if asked:
                done.append((yield from change()))
        return all(done)

    def refuse_running(self) -> Dialogue:
        """Raise Rejected if the drive turns or carries current."""
        velocity, current = (yield from self.read("mechVel")), (yield from self.read("iqf"))
        if velocity is None:
            raise Rejected(
                f"id {self.can_id} does not report its velocity, so it may be moving; nothing was changed. Run the "
                "command again"
            )
        if not abs(velocity) < MAX_VELOCITY or (current is not None and not abs(current) < MAX_CURRENT):
            holding = "" if current is None else f", {current:.2f} A"
            raise Rejected(
                f"id {self.can_id} is running ({velocity:.2f} rad/s{holding}); nothing was changed. End the program "
                "that commands it first"
            )

    def stop(self) -> Dialogue:
        """Stop the drive, and detect whether it is a RobStride. Raises Rejected without a confirmed stop."""
        answer = yield from ask(queries.stop(self.can_id), "stop", queries.feedback_of(self.can_id))
        if answer is None or answer.enabled:
            raise Rejected(f"id {self.can_id} does not confirm that it has stopped; nothing was changed")
        read = partial(queries.firmware, can_id=self.can_id)
        self.is_robstride = bool((yield from ask(queries.version(self.can_id), "stop and version", read)))

    def check(self, request: Request) -> Dialogue:
        """Raise Rejected for what must not be sent to this drive."""
        if request.save:
            self.need_robstride("--save")
        if request.protocol:
            self.need_robstride(f"--protocol {request.protocol}")
        for parameter, _ in writes(request):
            if not parameter.cybergear:
                self.need_robstride(f"--write {parameter.name}, which a CyberGear does not have")
        new = request.new_id
        if new and ((yield from self.identities(new)) or (yield from self.is_taken(new))):
            raise Rejected(
                f"id {new} is already in use on the bus; id {self.can_id} was not changed. Choose another id"
            )

    def is_taken(self, can_id: int) -> Dialogue:
        """Return whether any drive in MIT mode has an id."""

        def read(_: int, extended: bool, data: bytes) -> bool | None:
            return True if not extended and len(data) in (6, 7, 8) and data[0] == can_id else None

        return (yield from ask(disable_in_mit_mode(can_id), "disable", read, attempts=1)) is not None

    def need_robstride(self, what: str) -> None:
        """Raise Rejected if the drive may be a CyberGear. what : setting that is not written then"""
        if not self.is_robstride:
            raise Rejected(
                f"{what}: id {self.can_id} did not report the firmware of a RobStride, so it may be a CyberGear, which "
                "interprets such frames differently (--save would set another baud rate); nothing was changed. For a "
                "RobStride with old firmware, use the vendor's software"
            )

    def planned(
        self,
        request: Request,
        wanted: Sequence[tuple[Parameter, float]],
        before: dict[str, float | None],
        position: float | None,
    ) -> list[str]:
        """Return lines with the present and the new values."""

        def now(value: float | None, parameter: Parameter) -> str:
            return "not reported" if value is None else parameter.text(value)

        lines = [
            f"  {parameter.name}: {now(before[parameter.name], parameter)} -> {parameter.text(value)}"
            for parameter, value in wanted
        ]
        lines += [f"  position: {now(position, parameters.PARAMETERS['mechPos'])} -> 0 rad"] * bool(request.zero)
        lines += ["  saved permanently"] * bool(request.save)
        lines += [f"  protocol: private -> {request.protocol}, from the next power-on"] * bool(request.protocol)
        lines += [f"  id: {self.can_id} -> {request.new_id}"] * bool(request.new_id)
        return lines

    def write(self, parameter: Parameter, value: float) -> Dialogue:
        """Write a parameter and read it back. Returns whether the drive has the value."""
        yield Send(queries.write(parameter, value, self.can_id), f"write {parameter.name}")
        yield Listen(0.05)
        after = yield from self.read(parameter.name)
        text = "not reported" if after is None else parameter.text(after)
        if same(parameter, value, after):
            yield Show((f"done: {parameter.name} is {text}",))
            return True
        yield Show((f"NOT done: {parameter.name} is {text} instead of {parameter.text(value)}",))
        return False

    def zero(self) -> Dialogue:
        """Make the present position the zero. Returns whether the drive reports a position of 0 afterwards."""
        yield Send(frames.set_zero(self.can_id, queries.HOST), "set zero")
        yield Listen(0.2)
        after = yield from self.read("mechPos")
        confirmed = after is not None and abs(after) < ZERO_TOLERANCE
        text = "not reported" if after is None else f"{after:.4f} rad"
        yield Show((f"done: position is {text}" if confirmed else f"NOT done: position is {text}",))
        return confirmed

    def save(self) -> Dialogue:
        """Save the parameters. Returns whether the drive confirms it."""
        read = queries.feedback_of(self.can_id)
        answer = yield from ask(queries.save(self.can_id), "save", read, timeout=0.5, attempts=1)
        silent = (
            "NOT confirmed: the drive did not reply to the save command. Cycle its power and read the parameters again"
        )
        yield Show(("done: saved" if answer else silent,))
        return answer is not None

    def switch(self, name: Any) -> Dialogue:
        """Select a protocol for the time after the next power cycle. name : key of PROTOCOLS

        Returns True: the drive does not confirm it.
        """
        yield Send(queries.set_protocol(self.can_id, name), "set protocol")
        yield Listen(0.1)
        yield Show((f"sent: protocol {name}; {POWER_CYCLE}",))
        return True

    def rename(self, new: Any) -> Dialogue:
        """Change the id. Returns whether the drive, and no other, responds to the new one only."""
        yield Send(queries.set_id(self.can_id, new), "set id")
        yield Listen(0.2)
        after = yield from self.identities(new)
        confirmed = after == [self.unique] and not (yield from self.identities(self.can_id))
        silent = f"NOT done: {' and '.join(after) or 'no drive'} responds as id {new}. Run `scan`"
        yield Show((f"done: id {self.can_id} is now {new}, unique {self.unique}" if confirmed else silent,))
        return confirmed


def same(parameter: Parameter, wanted: float, got: float | None) -> bool:
    """Return whether the value read back equals the written one in single precision."""
    if got is None:
        return False
    return got == int(wanted) if parameter.is_whole() else got == struct.unpack("<f", struct.pack("<f", wanted))[0]
