"""`set PID PATH=VALUE ...`: change live parameters of a run from another shell."""

import math
import os
import time

from cext.schedule.mailbox_writer import CHANGE_LIMIT, Writer
from graph import Param
from runtime.base.errors import OK, BadInput
from runtime.base.options import settings
from runtime.cli.parsing import Parser
from runtime.console.terminal import program, tell
from runtime.live import patterns, table
from runtime.live.running import page_of, runs

TAKE_TIMEOUT = 2.0  # s, and TAKE_TICKS, until a change counts as not taken
TAKE_TICKS = 4
POLL_PERIOD = 0.001  # s


def main(arguments):
    parser = Parser(
        "set", "Change live parameters of a run, or list them. The exit code is 0 once the run has taken them."
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
    tell(set_live(int(options.pid), settings(options.settings, "")))
    return OK


def set_live(pid, settings):
    """Lines to tell. BadInput, and then nothing was changed unless it says so.

    pid : of the run
    settings : pairs (path or pattern, text); what one pattern matches changes in one tick, up to CHANGE_LIMIT
        parameters
    """
    page = find(pid)
    told = table.read(page)
    if not told.parameters:
        raise BadInput(
            f"{told.name} (process {pid}) has no live parameters: a diagram marks one with Param(..., "
            "live=True) or Live(...)"
        )
    if not settings:
        return listing(pid, page, told)
    changes = letters([wanted(told, name, text) for name, text in settings])
    return [line for letter in changes for line in send(page, told, pid, letter)]


def letters(groups):
    """Lists of at most CHANGE_LIMIT changes, each taken in one tick. A group that fits into one is not divided."""
    found = [[]]
    for group in groups:
        if len(found[-1]) + len(group) > CHANGE_LIMIT:
            found.append([])
        found[-1] += group
    return [letter[first : first + CHANGE_LIMIT] for letter in found for first in range(0, len(letter), CHANGE_LIMIT)]


def find(pid):
    """The page of a run. BadInput that tells which runs there are."""
    try:
        page = page_of(pid)
        if page is not None and not page.closed:
            return page
        trouble = "is no run of a diagram" if os.path.exists(f"/proc/{pid}") else "does not exist"
    except PermissionError:
        trouble = "may not be looked at: it belongs to another user, or has more privileges than you"
    others = [f"{other} ({table.read(page).name})" for other, page in sorted(runs().items())]
    raise BadInput(
        f"process {pid} {trouble}; " + (f"runs are {', '.join(others)}" if others else "nothing of yours runs now")
    )


def wanted(told, name, text):
    """[(Parameter, value)] of one setting: of every parameter that its name, or pattern, matches. BadInput where one of
    them cannot have it.
    """
    known = {parameter.path: parameter for parameter in told.parameters}
    found = patterns.matching(name, known)
    if not found:
        hint = patterns.hint(name, known) or "live are " + ", ".join(known)
        raise BadInput(f"{name}={text}: {told.name} has no live parameter {name!r}; {hint}")
    return [(known[path], value_of(known[path], name, text)) for path in found]


def value_of(parameter, name, text):
    types = {"float": float, "int": int, "bool": bool}
    bounds = (
        {}
        if parameter.dtype == "bool"
        else {"min": parameter.plain(parameter.low), "max": parameter.plain(parameter.high)}
    )
    try:
        return float(
            Param(parameter.plain(parameter.built), parameter.unit, dtype=types[parameter.dtype], **bounds).parse(text)
        )
    except ValueError as error:
        which = "" if parameter.path == name else f"{parameter.path} "
        raise BadInput(f"{name}={text}: {which}{error}") from None


def send(page, told, pid, changes):
    """Put changes into the mailbox and wait until the loop has taken them. Lines; BadInput if it does not."""
    before = table.values(page, told.parameters)
    writer = Writer(page)
    until = time.monotonic() + TAKE_TIMEOUT + TAKE_TICKS / told.rate
    ticket = None
    while ticket is None:
        ticket = writer.set([(parameter.index, value) for parameter, value in changes])
        if ticket is None:
            wait(page, pid, until, "its mailbox is full")
    while (answer := writer.answer(ticket)) is None:
        try:
            wait(page, pid, until, "it did not take the change")
        except BadInput:
            if writer.withdraw(ticket):
                raise
            until = math.inf  # it has it just now
    verdict, tick, _ = answer
    if verdict == "over":
        raise BadInput(f"the run of process {pid} has ended; nothing was changed")
    if verdict != "taken":
        raise BadInput(
            f"process {pid} refuses {', '.join(parameter.path for parameter, _ in changes)} ({verdict}); "
            "nothing was changed"
        )
    return [line(parameter, before[parameter.index][0], value, tick, told.rate) for parameter, value in changes]


def wait(page, pid, until, trouble):
    """A moment. BadInput once that is no use any more."""
    if page.closed or page.state in ("stopping", "safe"):
        raise BadInput(f"the run of process {pid} has ended; nothing was changed")
    if not os.path.exists(f"/proc/{pid}"):
        raise BadInput(f"process {pid} has died; nothing was changed")
    if time.monotonic() > until:
        raise BadInput(
            f"process {pid}: {trouble} within {TAKE_TIMEOUT:g} s (is it stopped, or its recorder's disk "
            "full?); nothing was changed"
        )
    time.sleep(POLL_PERIOD)


def line(parameter, before, value, tick, rate):
    """What one change did."""
    text = f"{parameter.path}: {parameter.shown(before)} to {parameter.shown(value)} from tick {tick} on"
    seconds = abs(value - before) / parameter.slew if parameter.slew > 0.0 else 0.0
    return text + (f", over {seconds:.3g} s" if seconds * rate > 1.0 else "")


def listing(pid, page, told):
    """The live parameters with their values, bounds and units."""
    tick = page.statistics()["last_tick"]
    when = f", tick {tick}" if tick >= 0 else ""
    lines = [f"{told.name} (process {pid}, {page.state}{when})"]
    width = max(len(parameter.path) for parameter in told.parameters)
    for parameter, (value, target) in zip(told.parameters, table.values(page, told.parameters)):
        text = parameter.shown(value) + (f", on the way to {parameter.shown(target)}" if value != target else "")
        more = [parameter.bounds, f"built as {parameter.shown(parameter.built)}"]
        if math.isfinite(parameter.slew):
            more.append(f"by {parameter.slew:g}{parameter.behind} a second at most")
        lines.append(f"  {parameter.path:<{width}}  {text}  ({'; '.join(more)})  {parameter.description}".rstrip())
    return lines
