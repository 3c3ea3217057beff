"""`python -m runtime doctor`: check this machine and print the findings."""

from __future__ import annotations

import json
import os
import re
import textwrap
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from runtime.cli.parsing import Parser
from runtime.host.console.confirm import confirm
from runtime.host.console.terminal import print_lines, program
from runtime.host.errors import CHECK_FAILED, BadInput
from runtime.host.errors import OK as FIT
from runtime.host.machine.finding import BAD, OK, SEVERITY, UNKNOWN, Wants
from runtime.host.machine.probe import PI, Machine
from runtime.host.options import number, whole_number
from runtime.robot.rig.bus import BITRATE_MAXIMUM, DATA_BITRATE_MAXIMUM
from runtime.setup.doctor import examine
from runtime.setup.doctor.script import script

if TYPE_CHECKING:
    from runtime.host.machine.finding import Finding

WRAP_WIDTH = 110  # characters
MARKS = {UNKNOWN: "?"}


def main(arguments: Sequence[str]) -> int:
    """Run the command. Returns the exit code: 1 if a finding is bad, else 0."""
    parser = Parser(
        "doctor",
        "Check whether this machine is fit to run a robot, and list what to change. Nothing is changed.",
        "Verdicts:\n"
        "  ok     no change needed\n"
        "  worse  a robot runs, with degraded performance\n"
        "  bad    a robot does not run, or must not be run\n"
        "  ?      cannot be determined\n\n"
        "The exit code is 1 if a finding is bad. Run this command as the user that runs the robot.",
    )
    how = parser.add_mutually_exclusive_group()
    how.add_argument("--json", action="store_true", help="print one JSON object with the findings")
    how.add_argument(
        "--script",
        action="store_true",
        help="print a shell script with the changes that can be scripted; read it, then run it with sudo",
    )
    how.add_argument(
        "--bundle",
        type=Path,
        metavar="RECORDING",
        help="write an archive for a bug report: the end of this recording and this computer, without data about "
        "persons; lists everything first",
    )
    parser.add_argument(
        "--last",
        type=number("--last", "seconds"),
        metavar="S",
        help="with --bundle: seconds of signals and frames (default: 10)",
    )
    parser.add_argument("-y", "--yes", action="store_true", help="with --bundle: write without asking")
    parser.add_argument(
        "--bitrate",
        type=whole_number("--bitrate", BITRATE_MAXIMUM),
        default=BITRATE_MAXIMUM,
        metavar="BPS",
        help="bitrate of the CAN buses in bit/s (default: 1000000)",
    )
    parser.add_argument(
        "--data-bitrate",
        type=whole_number("--data-bitrate", DATA_BITRATE_MAXIMUM),
        default=0,
        metavar="BPS",
        help="the buses have CAN FD, with this bitrate of its data; equal to --bitrate without a rate switch",
    )
    parser.add_argument(
        "--overlay",
        type=_overlay,
        action="append",
        default=[],
        dest="overlays",
        metavar="TEXT",
        help="overlay for a Raspberry Pi's config.txt, such as mcp251xfd,spi0-0,interrupt=25",
    )
    parser.add_argument(
        "--hotspot",
        type=_network,
        metavar="NAME",
        help="let the script configure an access point of this name on wlan0; it asks for the password",
    )
    parser.add_argument("--remote-desktop", action="store_true", help="let the script enable a remote desktop")
    parser.add_argument(
        "--user", type=_name, help="user that runs the robot, for the script (default: the present user)"
    )
    parser.add_argument(
        "--record",
        default="recordings",
        dest="folder",
        metavar="DIR",
        help="folder of the recordings (default: recordings)",
    )
    parser.add_argument(
        "--root",
        type=_folder,
        default="/",
        metavar="DIR",
        help="check another machine: a folder with its files, and the outputs of its commands in DIR/commands",
    )
    options = parser.parse_args(arguments)
    if (options.overlays or options.hotspot or options.remote_desktop) and not options.script:
        raise BadInput("--overlay, --hotspot and --remote-desktop are parts of the script: add --script")
    if options.bundle is None and (options.last is not None or options.yes):
        raise BadInput("--last and --yes are options of --bundle RECORDING")
    if 0 < options.data_bitrate < options.bitrate:
        raise BadInput(f"--data-bitrate {options.data_bitrate}: at least that of --bitrate, {options.bitrate}")
    machine = Machine(options.root)
    if options.bundle is not None:
        return bundle(options.bundle, options.last, options.yes, machine)
    if options.overlays and machine.kind != PI:
        raise BadInput(f"--overlay is for a Raspberry Pi, and this machine is {machine.model or 'none'}")
    user = options.user or (os.environ.get("SUDO_USER") if machine.here else None)
    wants = Wants(
        bitrate=options.bitrate,
        data_bitrate=options.data_bitrate,
        user=user,
        folder=options.folder,
        overlays=options.overlays,
        hotspot=options.hotspot or "",
        remote_desktop=options.remote_desktop,
    )
    findings = examine(machine, wants)
    if options.script:
        print_lines(script(machine, wants, findings, program()))
        return FIT
    print_lines([_for_machines(machine, findings)] if options.json else report(machine, findings))
    return CHECK_FAILED if any(finding.verdict == BAD for finding in findings) else FIT


def bundle(path: Path, seconds: float | None, yes: bool, machine: Machine) -> int:
    """List the archive of a recording, and write it into the working folder once confirmed. Returns the exit code."""
    from runtime.setup.doctor.bundle import LAST, Bundle  # imports NumPy

    made = Bundle(path, seconds or LAST, machine)
    target = Path(made.name())
    print_lines([f"{target} will contain:", *made.listing()])
    if not confirm("write it", yes):
        return FIT
    print_lines([f"written: {made.write(target)}"])
    return FIT


def report(machine: Machine, findings: Sequence[Finding]) -> list[str]:
    """Return the lines of a report: findings that need attention first, with reason and remedy."""
    width = max(len(finding.name) for finding in findings)
    lines = [_about(machine), ""]
    for verdict in SEVERITY:
        chosen = [finding for finding in findings if finding.verdict == verdict]
        for finding in chosen:
            lines.append(f"{MARKS.get(verdict, verdict):<6} {finding.name:<{width}}  {finding.found}")
            if verdict != OK:
                indent = " " * (9 + width)
                lines += [f"{indent}{line}" for line in textwrap.wrap(finding.why, WRAP_WIDTH - len(indent))]
                # not wrapped: it may be a command to copy
                lines += [f"{indent}→ {finding.cure}"] if finding.cure else []
        if chosen and verdict != OK:
            lines.append("")
    return [*lines, "", _summary(findings)]


def _about(machine: Machine) -> str:
    user = f"user {machine.user}" + (": run this command as the user that runs the robot" if machine.root_user else "")
    return ", ".join(part for part in (machine.model, machine.system, f"Linux {machine.kernel}", user) if part)


def _summary(findings: Sequence[Finding]) -> str:
    counts = {verdict: sum(finding.verdict == verdict for finding in findings) for verdict in SEVERITY}
    words = ", ".join(f"{number} {MARKS.get(verdict, verdict)}" for verdict, number in counts.items() if number)
    if any(finding.part for finding in findings if finding.verdict != OK):
        return f"{words}; print a script with most of the changes: {program()} doctor --script"
    return words


def _for_machines(machine: Machine, findings: Sequence[Finding]) -> str:
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


def _overlay(text: str):
    if not re.fullmatch(r"[\w.-]+(,[\w.-]+(=[\w.-]+)?)*", text):
        raise BadInput(
            f"--overlay {text}: expected the value of dtoverlay=, as in mcp2515-can0,oscillator=12000000,interrupt=25"
        )
    return text


def _name(text: str) -> str:
    if not re.fullmatch(r"[A-Za-z_][\w.-]*\$?", text):
        raise BadInput(f"--user {text}: expected a user name")
    return text


def _network(text: str) -> str:
    if not re.fullmatch(r"[A-Za-z0-9_.-]{1,32}", text):
        raise BadInput(f"--hotspot {text}: expected 1 to 32 letters, digits, dots, hyphens and underscores")
    return text


def _folder(text: str) -> Path:
    if not Path(text).is_dir():
        raise BadInput(f"--root {text}: no such folder")
    return Path(text)
