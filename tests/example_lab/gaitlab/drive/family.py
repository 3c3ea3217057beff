"""The laboratory's drive as a device family: what Tickwork's commands need of it."""

from gaitlab.drive import models, protocol
from gaitlab.drive.block import GaitDrive

from blocks.sources import TimeTable
from graph.dialogue import Confirm, Listen, Rejected, Send, Show, ask
from graph.family import Drive, Family, Query, StopQuery, Table


def disable(can_id):
    return protocol.frame(protocol.DISABLE, can_id)


def reader(can_id):
    return lambda *frame: protocol.state(*frame, can_id)


def answers(received, can_ids, before):
    """Return an Answer for each id that answered."""
    found = []
    for can_id in can_ids:
        states = [answer for frame in received if (answer := protocol.state(*frame, can_id)) is not None]
        found += states[-1:]
    return found


def wire(drive, movement, target, wave):
    drive(torque_command=TimeTable(**wave, unit="N·m", name="target")())


class GaitLab(Family):
    name = "GaitLab"
    drives = (Drive(GaitDrive, models.find, movements=("torque",), bounded=("torque",), wire=wire),)
    tables = (Table("Gait laboratory", "GaitDrive", models.MODELS),)
    queries = (Query(disable, "disable of the gait laboratory's drives", answers),)

    def commanded(self, identifier, extended, data):
        is_command = not extended and protocol.COMMAND < identifier < protocol.REPLY
        return identifier - protocol.COMMAND if is_command and data[:1] != bytes((protocol.QUERY,)) else None

    def stop_queries(self, can_id, model=None):
        return (StopQuery(disable(can_id), reader(can_id)),)

    def stop_query(self, block):
        return StopQuery(disable(block.can_id), reader(block.can_id))

    def check(self, request):
        refused = request.other_than("--zero", "--set-id")
        if refused:
            raise Rejected(f"{refused[0]}: the gait laboratory's drive cannot do that")

    def set_up(self, request):
        can_id = request.can_id
        before = yield from ask(disable(can_id), "disable", reader(can_id))
        if before is None:
            return None
        self.check(request)
        yield Show((f"id {can_id}, {before.family}",))
        yield Show((f"  position: {before.position:.3f} rad -> 0 rad",) * request.zero)
        if request.new_id and (yield from ask(disable(request.new_id), "disable", reader(request.new_id))) is not None:
            raise Rejected(f"id {request.new_id} is on the bus already; nothing was changed")
        if not (yield Confirm("apply these changes")):
            return True
        if request.zero:
            yield Send(protocol.frame(protocol.ZERO, can_id), "set zero")
            yield Listen(0.05)
        if request.new_id:
            yield Send(protocol.frame(protocol.SET_ID, can_id, request.new_id), "set id")
            yield Listen(0.05)
            can_id = request.new_id
        after = yield from ask(disable(can_id), "disable", reader(can_id))
        done = after is not None and (not request.zero or abs(after.position) < 0.01)
        yield Show((f"done: id {can_id}, {after.position:.3f} rad" if done else "NOT done",))
        return done


FAMILY = GaitLab()
