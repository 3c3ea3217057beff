"""Device family of moteus controllers, by which the commands of Tickwork work with them."""

from __future__ import annotations

from functools import partial

from blocks.actuators.queries import same_id
from graph.dialogue import Confirm, Dialogue, Frame, Listen, Rejected, Send, Show, ask
from graph.family import Answer, Drive, Family, Query, Request, StopQuery, Table
from tickwork_moteus import models, protocol
from tickwork_moteus.block import Moteus

ZERO_TOLERANCE = 0.01  # rad
TOOL = "use the vendor's moteus_tool: ids, gains and limits are settings that its diagnostic channel changes"


def identify(can_id: int) -> Frame | None:
    """Return the frame that requests the state, None for an id outside the range of this family."""
    return protocol.query(can_id) if 1 <= can_id <= 127 else None


def answers(received: list[Frame], can_ids: list[int], before: list[Frame]) -> list[Answer]:
    """Return an Answer for each id that replied."""
    found: list[Answer] = []
    for can_id in can_ids:
        states = [answer for frame in received if (answer := protocol.state(*frame, can_id=can_id)) is not None]
        if len(states) > 1:
            states[0].remarks.append(same_id(len(states), can_id))
        found += states[:1]
    return found


class MoteusFamily(Family):
    """Device family of moteus controllers."""

    name = protocol.FAMILY
    drives = (Drive(Moteus, models.find),)
    tables = (Table("moteus", "Moteus", models.MODELS),)
    queries = (Query(identify, "query of moteus controllers", answers),)
    configure_note = "A moteus keeps its zero until power-off. For id, gains and limits, " + TOOL

    def commanded(self, identifier: int, extended: bool, data: bytes) -> int | None:
        return identifier & 0x7F if 0x8000 < identifier <= 0xFFFF and extended and data[:2] == b"\x01\x00" else None

    def stop_queries(self, can_id: int, model: models.Model | None = None) -> tuple[StopQuery, ...]:
        if identify(can_id) is None:
            return ()
        return (StopQuery(protocol.stop(can_id), partial(protocol.state, can_id=can_id)),)

    def stop_query(self, block: Moteus) -> StopQuery:
        return self.stop_queries(block.can_id)[0]

    def check(self, request: Request) -> None:
        if request.protocol is not None:
            raise Rejected("--protocol is not supported by moteus controllers")
        if request.new_id is not None or request.save or request.writes or request.reads:
            raise Rejected(f"--set-id, --save, --read and --write are not supported by moteus controllers: {TOOL}")

    def set_up(self, request: Request) -> Dialogue:
        """Dialogue of graph.family.Family.set_up: shows the state, and sets the zero of a stopped drive."""
        can_id = request.can_id
        read = partial(protocol.state, can_id=can_id)
        if identify(can_id) is None or (yield from ask(protocol.query(can_id), "request state", read)) is None:
            return None
        self.check(request)
        before = yield from ask(protocol.stop(can_id), "stop", read)
        if before is None or before.enabled:
            raise Rejected(f"id {can_id} does not stop; nothing was changed")
        yield Show(
            (f"id {can_id}, moteus, {before.position:.3f} rad, {before.voltage:g} V, fault: {before.fault or 'none'}",)
        )
        if not request.zero:
            return True
        yield Show(("  position -> 0 rad, until power-off",))
        if not (yield Confirm("apply this change")):
            return True
        yield Send(protocol.set_zero(can_id), "set zero")
        yield Listen(0.05)
        after = yield from ask(protocol.query(can_id), "request state", read)
        if after is None or abs(after.position) >= ZERO_TOLERANCE:
            raise Rejected(f"id {can_id} does not confirm the zero: run `scan`")
        yield Show((f"done: id {can_id}, {after.position:.3f} rad",))
        return True


FAMILY = MoteusFamily()
