"""Configuration of one drive by its device family, for the command `configure`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.families import families
from graph.dialogue import Rejected
from runtime.host.errors import BadInput
from runtime.setup.commissioning.scan import refuse_company

if TYPE_CHECKING:
    from graph.family import Request
    from runtime.robot.rig.tool_bus import ToolBus


def check(request: Request) -> None:
    """Raise BadInput if no family can carry out a graph.family.Request."""
    causes = []
    for family in families():
        if family.drives:
            try:
                family.check(request)
            except Rejected as rejected:
                causes.append(rejected)
            else:
                return
    raise BadInput(str(causes[0]))


def carry_out(bus: ToolBus, request: Request, yes: bool) -> bool:
    """Carry out a request. Returns whether the drive confirmed every change. Raises BadInput if it fails.

    bus : ToolBus; request : graph.family.Request; yes : whether to skip the questions
    """
    refuse_company(bus)
    for family in families():
        if (done := bus.converse(family.set_up(request), yes)) is not None:
            return done
    raise BadInput(f"no drive responds as id {request.can_id}; `scan` lists the drives on the bus")
