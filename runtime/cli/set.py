"""`set PID PATH=VALUE ...`: change live parameters of a run from another shell."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from cext.schedule.mailbox_writer import CHANGE_LIMIT, Writer
from runtime.base.errors import OK, BadInput
from runtime.base.options import settings
from runtime.cli.parsing import Parser
from runtime.console.terminal import print_lines, program
from runtime.live import table
from runtime.live.requests import changes_of
from runtime.live.running import page_of, runs

if TYPE_CHECKING:
    from cext.safety.shared_state import SharedState
    from runtime.live.table import Parameter, Table

TAKE_TIMEOUT = 2.0  # s, to which TAKE_TICKS are added, for the run to take a change
TAKE_TICKS = 4
POLL_PERIOD = 0.001  # s


def main(arguments: Sequence[str]) -> int:
    """Run the command. Returns the exit code; raises BadInput if nothing was changed."""
    parser = Parser(
        "set", "Change live parameters of a run, or list them. The exit code is 0 if the run has applied them."
    )
    parser.add_argument("pid", metavar="PID", help="process number of the run")
    parser.add_argument(
        "settings",
        nargs="*",
        metavar="PATH=VALUE",
        help="a live parameter: left/impedance.stiffness=40, wall.angle='60 deg', "
        "'*/profile.scale=0.5' for both legs; @FILE reads such lines",
    )
    options = parser.parse_args(arguments)
    if not options.pid.isdecimal():
        raise BadInput(
            f"set {options.pid}: expected the process number of a run, as in {program()} set 1234 "
            "left/impedance.stiffness=40"
        )
    print_lines(set_live(int(options.pid), settings(options.settings, "")))
    return OK


def set_live(pid: int, settings: Sequence[tuple[str, str]]) -> list[str]:
    """Change or list live parameters. Returns lines for standard output.

    pid : of the run
    settings : pairs (path or pattern, text); all parameters that a pattern matches change in one tick, up to
        CHANGE_LIMIT parameters

    Raises BadInput; then no parameter was changed unless the text states otherwise.
    """
    page = find(pid)
    run_table = table.read(page)
    if not run_table.parameters:
        raise BadInput(
            f"{run_table.name} (process {pid}) has no live parameters: declare one with Param(..., "
            "live=True) or Live(...)"
        )
    if not settings:
        return listing(pid, page, run_table)
    changes = batches([changes_of(run_table, name, text) for name, text in settings])
    return [line for batch in changes for line in send(page, run_table, pid, batch)]


def batches(groups: Iterable[list[tuple[Parameter, float]]]) -> list[list[tuple[Parameter, float]]]:
    """Return batches of at most CHANGE_LIMIT changes, each taken in one tick.

    groups : changes that belong together; a group is divided only if it exceeds the limit
    """
    collected = [[]]
    for group in groups:
        if len(collected[-1]) + len(group) > CHANGE_LIMIT:
            collected.append([])
        collected[-1] += group
    return [batch[first : first + CHANGE_LIMIT] for batch in collected for first in range(0, len(batch), CHANGE_LIMIT)]


def find(pid: int) -> SharedState:
    """Return the SharedState of a run. Raises BadInput, with the present runs."""
    try:
        page = page_of(pid)
        if page is not None and not page.closed:
            return page
        problem = "is not a run of a diagram" if os.path.exists(f"/proc/{pid}") else "does not exist"
    except PermissionError:
        problem = "belongs to another user or has more privileges"
    others = [f"{other} ({table.read(page).name})" for other, page in sorted(runs().items())]
    raise BadInput(
        f"process {pid} {problem}; " + (f"runs are {', '.join(others)}" if others else "no run of this user exists")
    )


def send(page: SharedState, run_table: Table, pid: int, changes: Sequence[tuple[Parameter, float]]) -> list[str]:
    """Send changes to a run and wait until it has taken them. Returns lines. Raises BadInput if it does not."""
    before = table.values(page, run_table.parameters)
    writer = Writer(page)
    until = time.monotonic() + TAKE_TIMEOUT + TAKE_TICKS / run_table.rate
    ticket = None
    while ticket is None:
        ticket = writer.set([(parameter.index, value) for parameter, value in changes])
        if ticket is None:
            wait(page, pid, until, "its mailbox was full")
    while (answer := writer.answer(ticket)) is None:
        try:
            wait(page, pid, until, "it did not apply the change")
        except BadInput:
            if writer.withdraw(ticket):
                raise
            until = math.inf  # it is taking the change
    verdict, tick, _ = answer
    if verdict == "over":
        raise BadInput(f"the run of process {pid} has ended; nothing was changed")
    if verdict != "taken":
        raise BadInput(
            f"process {pid} rejected {', '.join(parameter.path for parameter, _ in changes)} ({verdict}); "
            "nothing was changed"
        )
    return [line(parameter, before[parameter.index][0], value, tick, run_table.rate) for parameter, value in changes]


def wait(page: SharedState, pid: int, until: float, problem: str) -> None:
    """Sleep for one poll period. Raises BadInput if the run has ended or `until` has passed."""
    if page.closed or page.state in ("stopping", "safe"):
        raise BadInput(f"the run of process {pid} has ended; nothing was changed")
    if not os.path.exists(f"/proc/{pid}"):
        raise BadInput(f"process {pid} has died; nothing was changed")
    if time.monotonic() > until:
        raise BadInput(
            f"process {pid}: {problem} within {TAKE_TIMEOUT:g} s (check whether it is stopped, or "
            "its disk full); nothing was changed"
        )
    time.sleep(POLL_PERIOD)


def line(parameter: Parameter, before: float, value: float, tick: int, rate: float) -> str:
    """Return the line of one change. rate : Hz of the run"""
    text = f"{parameter.path}: {parameter.shown(before)} to {parameter.shown(value)} from tick {tick} on"
    seconds = abs(value - before) / parameter.slew if parameter.slew > 0.0 else 0.0
    return text + (f", over {seconds:.3g} s" if seconds * rate > 1.0 else "")


def listing(pid: int, page: SharedState, run_table: Table) -> list[str]:
    """Return lines of the live parameters with values, bounds and units."""
    tick = page.statistics()["last_tick"]
    when = f", tick {tick}" if tick >= 0 else ""
    lines = [f"{run_table.name} (process {pid}, {page.state}{when})"]
    width = max(len(parameter.path) for parameter in run_table.parameters)
    for parameter, (value, target) in zip(run_table.parameters, table.values(page, run_table.parameters)):
        text = parameter.shown(value) + (f", ramping to {parameter.shown(target)}" if value != target else "")
        more = [parameter.bounds, f"built as {parameter.shown(parameter.built)}"]
        if math.isfinite(parameter.slew):
            more.append(f"at most {parameter.slew:g}{parameter.unit_suffix} per second")
        lines.append(f"  {parameter.path:<{width}}  {text}  ({'; '.join(more)})  {parameter.description}".rstrip())
    return lines
