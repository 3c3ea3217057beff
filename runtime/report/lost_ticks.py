"""Ticks that the loop lost before a fault: a drive that seems silent may have replied to a stalled loop."""

from cext.clock.stopwatch import MACHINE
from runtime.console.styles import count
from runtime.report.timing import micro

REMEDY = "machine too busy, see --realtime"
LOST_TICKS_MINIMUM = 2  # ticks lost among the newest rows; a single one is common and explains no fault
EXPLAINED = ("silent", "no answer", "not following")  # faults that a stalled loop can cause


def before_fault(result):
    """Return text such as '; the loop had lost 20 ticks before that: ...' for a fault that lost ticks may explain.

    result : runtime.session.result.Result
    """
    outcome = result.outcome
    if result.failed_in_plant:
        return ""
    if outcome.status == "overrun":
        return f"; {REMEDY}" if outcome.culprit == MACHINE else ""
    if outcome.status not in EXPLAINED or not result.newest:
        return ""
    first = result.newest[0][0]
    lost = round(outcome.tick - first - sum(row[0] < outcome.tick for row in result.newest))
    if lost >= LOST_TICKS_MINIMUM:
        return f"; the loop had lost {count(lost, 'tick')} before that: {cause(result.overruns, first)}"
    late = max(row[1] for row in result.newest)
    if late * result.schedule.rate >= LOST_TICKS_MINIMUM:
        return f"; the loop was up to {micro(late)} late before that: {cause(result.overruns, first)}"
    return ""


def cause(overruns, first):
    """Return what took the time of the ticks lost since tick `first`: the path of a block, or the machine.

    overruns : list of runtime.session.result.Result
    """
    recent = [row for row in overruns if row["at_tick"] >= first]
    worst = max(recent, key=lambda row: row["longest"], default=None)
    return (
        REMEDY
        if worst is None or worst["name"] == MACHINE
        else (f"{worst['name']} took {micro(worst['longest'])} (tick {worst['at_tick']})")
    )
