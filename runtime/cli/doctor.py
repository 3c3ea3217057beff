"""`python -m runtime doctor`: the command line, and what it prints."""

import json
import os
import re
import textwrap
from dataclasses import asdict
from pathlib import Path

from runtime.base.errors import CHECK_FAILED, BadInput
from runtime.base.errors import OK as FIT
from runtime.base.options import count
from runtime.cli.parsing import Parser
from runtime.console.terminal import program, tell
from runtime.doctor import examine
from runtime.doctor.script import script
from runtime.machine.finding import BAD, OK, SEVERITY, UNKNOWN, Wants
from runtime.machine.probe import Machine

WIDTH = 110  # characters of a line of reasons
MARKS = {UNKNOWN: "?"}
FASTEST_CAN = 1_000_000  # bit/s, without a second, faster bitrate


def main(arguments):
    """Returns the exit code: 0, or 1 where something is bad."""
    parser = Parser(
        "doctor",
        "Look whether this machine is fit to run a robot, and what to change. Nothing is changed.",
        "ok; worse: a robot runs, but less well; bad: it does not run, or must not; ?: cannot be told.\n"
        "The exit code is 1 where something is bad. Ask as the user who runs the robot.",
    )
    how = parser.add_mutually_exclusive_group()
    how.add_argument("--json", action="store_true", help="for machines: one JSON object with the findings")
    how.add_argument(
        "--script",
        action="store_true",
        help="print a shell script that sets right what a script can; read it, then run it with sudo",
    )
    parser.add_argument(
        "--bitrate",
        type=count("--bitrate", FASTEST_CAN),
        default=FASTEST_CAN,
        metavar="BPS",
        help="of the CAN buses, in bit/s (default: 1000000)",
    )
    parser.add_argument(
        "--overlay",
        type=overlay,
        action="append",
        default=[],
        dest="overlays",
        metavar="TEXT",
        help="what the script puts into a Raspberry Pi's config.txt: mcp251xfd,spi0-0,interrupt=25",
    )
    parser.add_argument("--user", type=name, help="who runs the robot, for the script (default: who asks)")
    parser.add_argument(
        "--record",
        default="recordings",
        dest="folder",
        metavar="DIR",
        help="folder of the recordings (default: recordings)",
    )
    parser.add_argument(
        "--root",
        type=folder,
        default="/",
        metavar="DIR",
        help="look at another machine: a folder with its files, and the outputs of its commands in DIR/commands",
    )
    options = parser.parse_args(arguments)
    machine = Machine(options.root)
    user = options.user or (os.environ.get("SUDO_USER") if machine.here else None)
    wants = Wants(bitrate=options.bitrate, user=user, folder=options.folder, overlays=options.overlays)
    findings = examine(machine, wants)
    if options.script:
        tell(script(machine, wants, findings, program()))
        return FIT
    tell([for_machines(machine, findings)] if options.json else report(machine, findings))
    return CHECK_FAILED if any(finding.verdict == BAD for finding in findings) else FIT


def report(machine, findings):
    """Lines for a person: what needs attention first, with why and what to do; then what is well."""
    width = max(len(finding.name) for finding in findings)
    lines = [about(machine), ""]
    for verdict in SEVERITY:
        chosen = [finding for finding in findings if finding.verdict == verdict]
        for finding in chosen:
            lines.append(f"{MARKS.get(verdict, verdict):<6} {finding.name:<{width}}  {finding.found}")
            if verdict != OK:
                indent = " " * (9 + width)
                lines += [f"{indent}{line}" for line in textwrap.wrap(finding.why, WIDTH - len(indent))]
                # not wrapped: it may be a command to copy
                lines += [f"{indent}→ {finding.cure}"] if finding.cure else []
        if chosen and verdict != OK:
            lines.append("")
    return [*lines, "", summary(findings)]


def about(machine):
    person = f"user {machine.user}" + (": ask as the one who runs the robot" if machine.root_user else "")
    return ", ".join(part for part in (machine.model, machine.system, f"Linux {machine.kernel}", person) if part)


def summary(findings):
    counts = {verdict: sum(finding.verdict == verdict for finding in findings) for verdict in SEVERITY}
    words = ", ".join(f"{number} {MARKS.get(verdict, verdict)}" for verdict, number in counts.items() if number)
    if any(finding.part for finding in findings if finding.verdict != OK):
        return f"{words}; what sets most of it right, to be read and run: {program()} doctor --script"
    return words


def for_machines(machine, findings):
    return json.dumps(
        {
            "ok": not any(finding.verdict == BAD for finding in findings),
            "machine": machine.model,
            "kind": machine.kind,
            "system": machine.system,
            "kernel": machine.kernel,
            "user": machine.user,
            "findings": [asdict(finding) for finding in findings],
        },
        indent=2,
        ensure_ascii=False,
    )


def overlay(text):
    if not re.fullmatch(r"[\w.-]+(,[\w.-]+(=[\w.-]+)?)*", text):
        raise BadInput(
            f"--overlay {text}: expected what stands behind dtoverlay=, as in "
            "mcp2515-can0,oscillator=12000000,interrupt=25"
        )
    return text


def name(text):
    if not re.fullmatch(r"[A-Za-z_][\w.-]*\$?", text):
        raise BadInput(f"--user {text}: expected the name of a user")
    return text


def folder(text):
    if not Path(text).is_dir():
        raise BadInput(f"--root {text}: there is no such folder")
    return Path(text)
