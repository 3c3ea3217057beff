"""`set PID PATH=VALUE ...`: change live parameters of a run from another shell, or stop it."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING

from runtime.cli.parsing import Parser
from runtime.host.console.terminal import print_lines, program
from runtime.host.errors import OK, BadInput
from runtime.host.live import table
from runtime.host.live.requests import changes_of
from runtime.host.live.running import runs, shared_state_of
from runtime.host.live.sending import batches, send, stop
from runtime.host.options import settings

if TYPE_CHECKING:
    from cext.memory.shared_state import SharedState
    from runtime.host.live.table import Parameter, Table


def main(arguments: Sequence[str]) -> int:
    """Run the command. Returns the exit code; raises BadInput if nothing was changed."""
    parser = Parser(
        "set", "Change live parameters of a run, list them, or stop the run. The exit code is 0 if the run has done so."
    )
    parser.add_argument("pid", metavar="PID", help="process number of the run")
    parser.add_argument(
        "settings",
        nargs="*",
        metavar="PATH=VALUE",
        help="a live parameter: left/impedance.stiffness=40, wall.angle='60 deg', "
        "'*/profile.scale=0.5' for both legs; @FILE reads such lines",
    )
    parser.add_argument("--stop", action="store_true", help="end the run with its safe stop")
    options = parser.parse_args(arguments)
    if not options.pid.isdecimal():
        raise BadInput(
            f"set {options.pid}: expected the process number of a run, as in {program()} set 1234 "
            "left/impedance.stiffness=40"
        )
    if options.stop:
        if options.settings:
            raise BadInput("--stop and PATH=VALUE exclude each other: the run ends")
        shared = find(int(options.pid))
        earlier = stop(shared, int(options.pid))
        what = "was already being stopped" if earlier else "was stopped"
        print_lines(
            [f"{table.read(shared).name} (process {options.pid}) {what} after tick {shared.statistics()['last_tick']}"]
        )
        return OK
    print_lines(set_live(int(options.pid), settings(options.settings, "")))
    return OK


def set_live(pid: int, settings: Sequence[tuple[str, str]]) -> list[str]:
    """Change or list live parameters. Returns lines for standard output.

    pid : process number of the run
    settings : pairs (path or pattern, text); all parameters that a pattern matches change in one tick, up to
        CHANGE_LIMIT parameters

    Raises BadInput; then no parameter was changed unless the text states otherwise.
    """
    shared = find(pid)
    run_table = table.read(shared)
    if not run_table.parameters:
        raise BadInput(
            f"{run_table.name} (process {pid}) has no live parameters: declare one with Param(..., "
            "live=True) or Live(...)"
        )
    if not settings:
        return listing(pid, shared, run_table)
    changes = batches([changes_of(run_table, name, text) for name, text in settings], run_table.rules)
    return [text for batch in changes for text in send_changes(shared, run_table, pid, batch)]


def find(pid: int) -> SharedState:
    """Return the SharedState of a run. Raises BadInput, with the present runs."""
    try:
        shared = shared_state_of(pid)
        if shared is not None and shared.live and not shared.closed:
            return shared
        problem = "is not a run of a diagram" if os.path.exists(f"/proc/{pid}") else "does not exist"
    except PermissionError:
        problem = "belongs to another user or has more privileges"
    others = [f"{other} ({table.title(shared)})" for other, shared in sorted(runs().items())]
    raise BadInput(
        f"process {pid} {problem}; " + (f"runs are {', '.join(others)}" if others else "no run of this user exists")
    )


def send_changes(
    shared: SharedState, run_table: Table, pid: int, changes: Sequence[tuple[Parameter, float]]
) -> list[str]:
    """Send changes and return their lines. Raises BadInput as `send` does."""
    before = table.values(shared, run_table.parameters)
    tick = send(shared, run_table, pid, changes)
    return [line(parameter, before[parameter.index][0], value, tick, run_table.rate) for parameter, value in changes]


def line(parameter: Parameter, before: float, value: float, tick: int, rate: float) -> str:
    """Return the line of one change. rate : Hz of the run"""
    text = f"{parameter.path}: {parameter.value_text(before)} to {parameter.value_text(value)} from tick {tick} on"
    seconds = abs(value - before) / parameter.slew if parameter.slew > 0.0 else 0.0
    return text + (f", over {seconds:.3g} s" if seconds * rate > 1.0 else "")


def listing(pid: int, shared: SharedState, run_table: Table) -> list[str]:
    """Return lines of the live parameters with values, bounds and units."""
    tick = shared.statistics()["last_tick"]
    when = f", tick {tick}" if tick >= 0 else ""
    lines = [f"{run_table.name} (process {pid}, {shared.state}{when})"]
    width = max(len(parameter.path) for parameter in run_table.parameters)
    for parameter, (value, target) in zip(run_table.parameters, table.values(shared, run_table.parameters)):
        text = parameter.value_text(value) + (f", ramping to {parameter.value_text(target)}" if value != target else "")
        more = [parameter.bounds, f"built as {parameter.value_text(parameter.built)}"]
        if math.isfinite(parameter.slew):
            more.append(f"at most {parameter.slew:g}{parameter.unit_suffix} per second")
        lines.append(f"  {parameter.path:<{width}}  {text}  ({'; '.join(more)})  {parameter.description}".rstrip())
    return lines
