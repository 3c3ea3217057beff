"""RobStride drives and the CyberGear, as a device family."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from blocks.actuators.queries import MIT_PURPOSE, commanded_in_mit_mode, disable_in_mit_mode
from blocks.actuators.ranges import unit_of
from blocks.actuators.robstride import mit, models, queries, set_up
from blocks.actuators.robstride.mit import RobStrideMIT
from blocks.actuators.robstride.private import RobStride
from graph.family import Drive, Family, Query, StopQuery, Table

if TYPE_CHECKING:
    from blocks.actuators.robstride.models import Model
    from graph.dialogue import Dialogue
    from graph.family import Request


class RobStrideFamily(Family):
    """Device family of RobStride and CyberGear drives, with the private and the MIT protocol."""

    name = "RobStride"
    precedence = 1
    drives = (
        Drive(RobStride, models.find),
        Drive(RobStrideMIT, mit.find, "mit", "a RobStride set to its MIT protocol"),
    )
    tables = (
        Table("RobStride and CyberGear", "RobStride, or RobStrideMIT for the vendor's MIT protocol", models.MODELS),
    )
    table_note = "Kt of a RobStride refers to the peak current of a phase."
    queries = (
        Query(queries.question, queries.ID_PURPOSE, queries.drives, queries.details),
        Query(disable_in_mit_mode, MIT_PURPOSE, queries.states_in_mit_mode),
    )
    configure_note = (
        "A RobStride keeps saved settings without power. A CyberGear cannot save: it interprets the frame as a change "
        "of the baud rate, so the frame is never sent to a drive that may be a CyberGear."
    )

    def commanded(self, identifier: int, extended: bool, data: bytes) -> int | None:
        found = queries.commanded(identifier, extended, data)
        return commanded_in_mit_mode(identifier, extended, data) if found is None else found

    def stop_queries(self, can_id: int, model: Model | None = None) -> tuple[StopQuery, StopQuery]:
        return (
            StopQuery(queries.stop(can_id), queries.feedback_of(can_id, model)),
            self.stop_query_in_mit_mode(can_id, model),
        )

    def stop_query_in_mit_mode(self, can_id: int, model: Model | None, host: int | None = None) -> StopQuery:
        """Return the StopQuery of a drive in the MIT protocol. host : id from which it replies, None if unknown"""
        return StopQuery(
            disable_in_mit_mode(can_id), partial(queries.state_in_mit_mode, can_id=can_id, model=model, host=host)
        )

    def stop_query(self, block: RobStride | RobStrideMIT) -> StopQuery:
        can_id, model, host = block.can_id, unit_of(block), block.host_id
        if isinstance(block, RobStride):
            return StopQuery(queries.stop(can_id, host), queries.feedback_of(can_id, model, host))
        return self.stop_query_in_mit_mode(can_id, model, host)

    def identity(self, block: RobStride | RobStrideMIT) -> Dialogue | None:
        return queries.units(block.can_id) if isinstance(block, RobStride) else None

    def check(self, request: Request) -> None:
        set_up.check(request)

    def set_up(self, request: Request) -> Dialogue:
        return set_up.set_up(request)


FAMILY = RobStrideFamily()
