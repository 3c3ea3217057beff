"""Ticks that the loop lost before a fault: a drive that seems silent may have replied to a stalled loop."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cext.clock.stopwatch import MACHINE
from runtime.host.console.styles import count
from runtime.record.report.timing import micro

if TYPE_CHECKING:
    from runtime.record.report.run_result import RunResult

REMEDY = "machine too busy, see --realtime"
LOST_TICKS_MINIMUM = 2  # ticks lost among the newest rows; a single one is common and explains no fault
ARMING_WAIT_MINIMUM = 0.1  # s without a processor; arming may take 1 s
EXPLAINED = ("silent", "no answer", "not following")  # faults that a stalled loop can cause


def before_fault(result: RunResult) -> str:
    """Return text such as '; the loop had lost 20 ticks before that: ...' for a fault that lost ticks may explain.

    The text is empty for any other fault.
    """
    outcome = result.outcome
    if result.failed_in_plant:
        return ""
    if outcome.status == "overrun":
        return f"; {REMEDY}" if outcome.culprit == MACHINE else ""
    if outcome.status == "no answer" and outcome.tick < 0 and result.waited >= ARMING_WAIT_MINIMUM:
        if result.request.fast:  # virtual time does not pass meanwhile
            return ""
        return f"; the loop had waited {micro(result.waited)} for a processor: {REMEDY}"
    if outcome.status not in EXPLAINED or not result.newest:
        return ""
    first = result.newest[0][0]
    lost = round(outcome.tick - first - sum(row[0] < outcome.tick for row in result.newest))
    if lost >= LOST_TICKS_MINIMUM:
        return f"; the loop had lost {count(lost, 'tick')} before that: {cause(result.overruns, first)}"
    stall = stall_before(result, first)
    if stall is not None:
        count_of_stall = round(stall["longest"] * result.schedule.rate)
        return f"; the loop had lost {count(count_of_stall, 'tick')} before that: {blamed_item(stall)}"
    late = max(row[1] for row in result.newest)
    if late * result.schedule.rate >= LOST_TICKS_MINIMUM:
        return f"; the loop was up to {micro(late)} late before that: {cause(result.overruns, first)}"
    return ""


def cause(overruns: list[dict[str, Any]], first: float) -> str:
    """Return the cause of the ticks lost since tick `first`: the path of a block, or the machine.

    overruns : list of runtime.session.result.Result
    """
    recent = [row for row in overruns if row["at_tick"] >= first]
    return blamed_item(max(recent, key=lambda row: row["longest"], default=None))


def blamed_item(row: dict[str, Any] | None) -> str:
    """Return what an overrun row blames: the path of a block, or the machine. row : None where there is none"""
    if row is None or row["name"] == MACHINE:
        return REMEDY
    return f"{row['name']} took {micro(row['longest'])} (tick {row['at_tick']})"


def stall_before(result: RunResult, first: float) -> dict[str, Any] | None:
    """Return the overrun row of the longest stall within the timeout of the device that failed, None for none.

    The newest rows are few: a reply may have been lost with ticks before them. first : tick of the oldest of them
    """
    block = result.diagram.blocks.get(result.outcome.culprit or "")
    since = first - (getattr(block, "timeout", None) or 0.0) * result.schedule.rate
    stalls = [
        row
        for row in result.overruns
        if since <= row["at_tick"] < first and row["longest"] * result.schedule.rate >= LOST_TICKS_MINIMUM
    ]
    return max(stalls, key=lambda row: row["longest"], default=None)
