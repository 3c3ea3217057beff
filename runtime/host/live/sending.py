"""Delivery of changes of live parameters, and of a stop, to a run of another process."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from cext.schedule.mailbox_writer import CHANGE_LIMIT, Writer
from runtime.host.errors import BadInput

if TYPE_CHECKING:
    from cext.memory.shared_state import SharedState
    from cext.rules import LiveRule
    from runtime.host.live.table import Parameter, Table

TAKE_TIMEOUT = 2.0  # s, to which TAKE_TICKS are added, for the run to take a change
TAKE_TICKS = 4
STOP_TIMEOUT = 5.0  # s for the run to end in its safe stop
ENDED = ("stopping", "safe")
POLL_PERIOD = 0.001  # s


Changes = list["tuple[Parameter, float]"]


def batches(groups: Iterable[Changes], rules: Iterable[LiveRule] = ()) -> list[Changes]:
    """Return batches of at most CHANGE_LIMIT changes, each taken in one tick.

    groups : changes that belong together; a group is divided only if it exceeds the limit
    rules : rules of the run; changes of parameters that a rule relates also belong together
    """
    collected: list[Changes] = [[]]
    for group in join_related(groups, rules):
        if len(collected[-1]) + len(group) > CHANGE_LIMIT:
            collected.append([])
        collected[-1] += group
    return [batch[first : first + CHANGE_LIMIT] for batch in collected for first in range(0, len(batch), CHANGE_LIMIT)]


def join_related(groups: Iterable[Changes], rules: Iterable[LiveRule]) -> list[Changes]:
    """Return groups of changes, those joined whose parameters a rule relates."""
    found = list(groups)
    for entry in rules:
        related = [group for group in found if any(parameter.index in entry.rule.keys for parameter, _ in group)]
        if len(related) > 1:
            found = [group for group in found if all(group is not other for other in related[1:])]
            related[0][:] = [change for group in related for change in group]
    return found


def send(shared: SharedState, table: Table, pid: int, changes: Sequence[tuple[Parameter, float]]) -> int:
    """Send changes to a run and wait until it has taken them.

    table : table of the run
    pid : process number of the run, for messages
    changes : (parameter, value), at most CHANGE_LIMIT

    Returns the tick from which they are in effect. Raises BadInput if the run does not take them: nothing was changed.
    """
    writer = Writer(shared)
    until = time.monotonic() + TAKE_TIMEOUT + TAKE_TICKS / table.rate
    ticket = None
    while ticket is None:
        ticket = writer.set([(parameter.index, value) for parameter, value in changes])
        if ticket is None:
            wait(shared, pid, until, "its mailbox was full")
    while (answer := writer.answer(ticket)) is None:
        try:
            wait(shared, pid, until, "it did not apply the change")
        except BadInput:
            if writer.withdraw(ticket):
                raise
            until = math.inf  # it is taking the change
    verdict, tick, _ = answer
    if verdict == "over":
        raise BadInput(f"the run of process {pid} has ended; nothing was changed")
    if verdict != "taken":
        broken = table.broken(shared, {parameter.index: value for parameter, value in changes})
        raise BadInput(
            f"process {pid} rejected {', '.join(parameter.path for parameter, _ in changes)} "
            f"({'; '.join(broken) or verdict}); nothing was changed"
        )
    return tick


def stop(shared: SharedState, pid: int) -> bool:
    """Request the end of a run, and wait for its safe stop. Returns whether another request had come before.

    Raises BadInput if the run has ended already, or has not begun its safe stop within STOP_TIMEOUT.
    """
    if shared.closed or shared.state in ENDED:
        raise BadInput(f"the run of process {pid} has ended")
    first = Writer(shared).stop()
    until = time.monotonic() + STOP_TIMEOUT
    while not (shared.closed or shared.state in ENDED):
        if not os.path.exists(f"/proc/{pid}"):
            raise BadInput(f"process {pid} has died")
        if time.monotonic() > until:
            raise BadInput(
                f"process {pid} has not begun its safe stop within {STOP_TIMEOUT:g} s; the request remains. "
                "Press Ctrl-C in its terminal, or cut the power"
            )
        time.sleep(POLL_PERIOD)
    return not first


def wait(shared: SharedState, pid: int, until: float, problem: str) -> None:
    """Sleep for one poll period. Raises BadInput if the run has ended or `until` has passed."""
    if shared.closed or shared.state in ENDED:
        raise BadInput(f"the run of process {pid} has ended; nothing was changed")
    if not os.path.exists(f"/proc/{pid}"):
        raise BadInput(f"process {pid} has died; nothing was changed")
    if time.monotonic() > until:
        raise BadInput(
            f"process {pid}: {problem} within {TAKE_TIMEOUT:g} s (check whether it is stopped, or "
            "its disk full); nothing was changed"
        )
    time.sleep(POLL_PERIOD)
