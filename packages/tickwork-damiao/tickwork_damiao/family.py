"""Device family of Damiao drives, by which the commands of Tickwork work with them."""

from __future__ import annotations

import math
import struct
from dataclasses import replace
from functools import partial

from blocks.actuators.mit_frames import SET_ZERO
from blocks.actuators.queries import disable_in_mit_mode, same_id
from blocks.actuators.ranges import unit_of
from graph.dialogue import Confirm, Dialogue, Frame, Listen, Rejected, Send, Show, ask
from graph.family import Answer, Drive, Family, Query, Request, StopQuery, Table
from graph.names import suggestion
from tickwork_damiao import models, protocol
from tickwork_damiao.block import Damiao
from tickwork_damiao.protocol import CTRL_MODE, ESC_ID, MST_ID, PMAX, STORE, TMAX, VMAX, WRITE

CLEAR = "clear"  # in place of a register: clear the error
ZERO_TOLERANCE = 0.01  # rad
MOTION = 0.1  # rad/s of a drive at rest


def identify(can_id: int) -> Frame | None:
    """Return the frame that reads MST_ID, None for an id outside the range of this family."""
    return protocol.read(MST_ID, can_id) if 1 <= can_id <= 15 else None


def answers(received: list[Frame], can_ids: list[int], before: list[Frame]) -> list[Answer]:
    """Return an Answer for each id that returned its MST_ID."""
    found: list[Answer] = []
    for can_id in can_ids:
        replies = [reply for frame in received if (reply := protocol.register(*frame, can_id=can_id, index=MST_ID))]
        if replies:
            answer = Answer(protocol.FAMILY, can_id, block="Damiao", settings={"master_id": replies[0][0]})
            if len(replies) > 1:
                answer.remarks.append(same_id(len(replies), can_id))
            if replies[0][0] == 0:
                answer.remarks.append("MST_ID is 0: set another with `configure`, as MST_ID=17")
            found.append(answer)
    return found


def value_of(can_id: int, index: int) -> Dialogue:
    """Dialogue that returns the value of a register, None if the drive does not return it."""
    reply = yield from ask(
        protocol.read(index, can_id), "read register", partial(protocol.register, can_id=can_id, index=index)
    )
    return None if reply is None else reply[1]


def ranges_of(can_id: int) -> Dialogue:
    """Dialogue that returns a model with the encoded ranges of a unit, None if it does not return them."""
    values = []
    for index in (PMAX, VMAX, TMAX):
        values.append((yield from value_of(can_id, index)))
    if None in values:
        return None
    names = ("wire_position", "wire_velocity", "wire_torque")
    return replace(models.MODELS["DM-J4310"], **dict(zip(names, values)))


def details(found: Answer) -> Dialogue:
    """Dialogue that returns the Answer with the ranges, the time-out, the firmware and the state of a drive."""
    can_id, master = found.can_id, found.settings["master_id"]
    unit = yield from ranges_of(can_id)
    mode = yield from value_of(can_id, CTRL_MODE)
    version = yield from value_of(can_id, protocol.REGISTERS["sw_ver"])
    state = yield from ask(
        protocol.refresh(can_id), "request state", partial(protocol.state, can_id=can_id, master_id=master, model=unit)
    )
    answer = found if state is None else replace(state, remarks=found.remarks)
    answer.firmware = "" if version is None else str(version)
    if unit is not None:
        of = ", ".join(fitting(unit)) or "no model: set wire_position, wire_velocity and wire_torque"
        answer.notes.append(
            f"PMAX {unit.wire_position:g} rad, VMAX {unit.wire_velocity:g} rad/s, TMAX {unit.wire_torque:g} N·m: those "
            f"of {of}"
        )
    if mode not in (None, protocol.MIT):
        answer.notes.append(f"CTRL_MODE is {mode}: arming selects MIT mode, 1")
    return answer


def fitting(unit: models.Model) -> list[str]:
    """Return the names of the models that have the ranges of a unit."""
    names = ("wire_position", "wire_velocity", "wire_torque")
    return [
        model.name
        for model in models.MODELS.values()
        if all(math.isclose(getattr(model, name), getattr(unit, name), rel_tol=1e-3) for name in names)
    ]


def index_of(name: str, option: str) -> int:
    """Return the index of a register. Raises Rejected for an unknown one."""
    known = {each.upper(): index for each, index in protocol.REGISTERS.items()}
    if name.strip().upper() not in known:
        hint = suggestion(name, protocol.REGISTERS) or f"there are {', '.join(protocol.REGISTERS)}"
        raise Rejected(f"{option} {name}: not a register of a Damiao drive: {hint}")
    return known[name.strip().upper()]


def writes(request: Request) -> list[tuple[int | None, float]]:
    """Return [(register, number)] of the texts NAME=VALUE, with None for `clear`. Raises Rejected."""
    found: list[tuple[int | None, float]] = []
    for text in request.writes:
        name, _, value = text.partition("=")
        if name.strip() == CLEAR:
            found.append((None, 1.0))
            continue
        index = index_of(name, "--write")
        try:
            number = float(value)
            if not math.isfinite(number) or (index in protocol.WHOLE and number != int(number)):
                raise ValueError
            protocol.write(index, number, 1)
        except (ValueError, OverflowError, struct.error):
            raise Rejected(f"--write {text}: expected NAME=VALUE with a number, as in TIMEOUT=2000") from None
        if index not in protocol.WRITABLE or index == ESC_ID:
            raise Rejected(f"--write {name}: " + ("use --set-id" if index == ESC_ID else "is read-only"))
        if index == MST_ID and not 1 <= number <= 0x7FE:
            raise Rejected(f"--write {text}: MST_ID must be from 1 to 2046; with 0, replies precede every command")
        if index in (PMAX, VMAX, TMAX) and number <= 0.0:
            raise Rejected(f"--write {text}: a range must be above 0")
        found.append((index, number))
    return found


class DamiaoFamily(Family):
    """Device family of Damiao drives in MIT mode."""

    name = "Damiao"
    precedence = 2
    drives = (Drive(Damiao, models.find),)
    tables = (Table("Damiao DM-J", "Damiao", models.MODELS),)
    queries = (Query(identify, "read of MST_ID of Damiao drives", answers, details),)
    configure_note = (
        "A Damiao drive keeps registers until power-off; --save stores all. --write clear=1 clears an error."
    )

    def commanded(self, identifier: int, extended: bool, data: bytes) -> int | None:
        register = not extended and identifier == protocol.BROADCAST and len(data) == 8 and data[2] in (WRITE, STORE)
        return data[0] if register else None

    def stop_queries(self, can_id: int, model: models.Model | None = None) -> tuple[StopQuery, ...]:
        return (StopQuery(disable_in_mit_mode(can_id), partial(protocol.state, can_id=can_id, model=model)),)

    def stop_query(self, block: Damiao) -> StopQuery:
        read = partial(protocol.state, can_id=block.can_id, master_id=block.master_id, model=unit_of(block))
        return StopQuery(disable_in_mit_mode(block.can_id), read)

    def check(self, request: Request) -> None:
        if request.protocol is not None:
            raise Rejected("--protocol is not supported by Damiao drives")
        if request.new_id is not None and not 1 <= request.new_id <= 15:
            raise Rejected(f"--set-id {request.new_id}: a Damiao drive reports four bits of its id, so 1 to 15")
        for name in request.reads:
            if name != "all":
                index_of(name, "--read")
        writes(request)

    def set_up(self, request: Request) -> Dialogue:
        """Dialogue of graph.family.Family.set_up: disables the drive first, and reads everything back."""
        can_id = request.can_id
        if identify(can_id) is None or (yield from value_of(can_id, MST_ID)) is None:
            return None
        self.check(request)
        unit = yield from ranges_of(can_id)
        before = yield from state_of(can_id, unit)
        if before is None:
            raise Rejected(f"id {can_id} returns its registers, but not its state; nothing was changed")
        if before.velocity is None or abs(before.velocity) > MOTION:
            raise Rejected(f"id {can_id} turns, or its ranges are unknown; nothing was changed")
        yield Show((f"id {can_id}, Damiao, {before.position:.3f} rad, fault: {before.fault or 'none'}",))
        names = list(protocol.REGISTERS) if "all" in request.reads else request.reads
        for index in (index_of(name, "--read") for name in names):
            value = yield from value_of(can_id, index)
            yield Show((f"  {protocol.NAMES[index]}: {'no reply' if value is None else f'{value:g}'}",))
        changes = writes(request)
        if not (request.zero or request.new_id or request.save or changes):
            return True
        if request.new_id and (yield from value_of(request.new_id, MST_ID)) is not None:
            raise Rejected(f"id {request.new_id} is on the bus already; nothing was changed")
        for index, value in changes:
            yield Show(("  clear the error" if index is None else f"  {protocol.NAMES[index]} -> {value:g}",))
        yield Show(
            ("  position -> 0 rad",) * request.zero
            + (f"  id -> {request.new_id}",) * bool(request.new_id)
            + ("  store all registers",) * request.save
        )
        if not (yield Confirm("apply these changes")):
            return True
        done = True
        for index, value in changes:
            if index is None:
                yield Send((can_id, False, protocol.CLEAR), "clear the error")
                yield Listen(0.05)
                after = yield from state_of(can_id, unit)
                done &= after is not None and not after.fault
            else:
                done &= yield from written(can_id, index, value)
        if request.zero:
            yield Send((can_id, False, SET_ZERO), "set zero")
            yield Listen(0.05)
        if request.new_id:
            yield Send(protocol.write(ESC_ID, request.new_id, can_id), "set id")
            yield Listen(0.05)
            can_id = request.new_id
            done &= (yield from value_of(can_id, ESC_ID)) == can_id
        if request.save:
            stored = yield from ask(
                protocol.store(can_id), "store", partial(protocol.register, can_id=can_id, index=1, kind=STORE), 0.5
            )
            done &= stored is not None
        after = yield from state_of(can_id, (yield from ranges_of(can_id)))
        if after is None or after.position is None or (request.zero and abs(after.position) >= ZERO_TOLERANCE):
            raise Rejected(f"id {can_id} does not confirm the changes: run `scan`")
        yield Show((f"done: id {can_id}, {after.position:.3f} rad" if done else "NOT done: the drive reads otherwise",))
        return done


def state_of(can_id: int, unit: models.Model | None) -> Dialogue:
    """Dialogue that disables a drive and returns the Answer of its state, None without one."""
    return (yield from ask(disable_in_mit_mode(can_id), "disable", partial(protocol.state, can_id=can_id, model=unit)))


def written(can_id: int, index: int, value: float) -> Dialogue:
    """Dialogue that writes a register and returns whether the drive returns it as written."""
    yield Send(protocol.write(index, value, can_id), "write register")
    yield Listen(0.05)
    after = yield from value_of(can_id, index)
    return after is not None and math.isclose(after, value, rel_tol=1e-6, abs_tol=1e-12)


FAMILY = DamiaoFamily()
