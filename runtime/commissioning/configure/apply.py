"""What `configure` does with one drive: the family that it belongs to carries the request out."""

from blocks.families import families
from graph.dialogue import Rejected
from runtime.base.errors import BadInput
from runtime.commissioning.scan import refuse_company


def check(request):
    """BadInput where no family can carry a graph.family.Request out."""
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


def carry_out(bus, request, yes):
    """Return whether everything was confirmed. BadInput

    bus : ToolBus; request : graph.family.Request; yes : whether the operator is not asked
    """
    refuse_company(bus)
    for family in families():
        if (done := bus.converse(family.set_up(request), yes)) is not None:
            return done
    raise BadInput(f"no drive answers as id {request.can_id}; `scan` lists the drives on the bus")
