"""`soak RIG`: run a rig at zero torque for hours, and write a report that can be sent back."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

from runtime.cli.parsing import Parser
from runtime.cli.rate import maker
from runtime.host.console.terminal import print_lines, print_to_stderr
from runtime.host.ending import Interrupted
from runtime.host.errors import CHECK_FAILED, OK, BadInput
from runtime.host.options import folder, number, whole_number

HOURS, MINUTES, RATE = 8.0, 10.0, 200.0  # of all spells; of one; Hz
ACTUATORS_LIMIT = 8


def main(arguments: Sequence[str]) -> int:
    """Run the command. Returns the exit code: 1 if a spell had a fault or lost a reply, a tick or a record."""
    from blocks.families import benchmark

    typical = benchmark("can").parameters["model"]
    parser = Parser(
        "soak",
        "Run the actuators of a rig at zero torque for hours, in spells of some minutes, every second one with every "
        "processor busy. Writes what was lost, late, hot or throttled, and jumps of the clock, after each spell.",
    )
    parser.add_argument("rig", type=Path, metavar="RIG", help="rig file with one bus, which may be emulated")
    parser.add_argument("--model", default=typical, metavar="M", help=f"actuator model (default: {typical})")
    parser.add_argument(
        "--actuators",
        type=whole_number("--actuators", ACTUATORS_LIMIT),
        default=1,
        metavar="N",
        help="number of actuators, with the ids 1 to N (default: 1)",
    )
    parser.add_argument("--hours", type=number("--hours", "hours"), default=HOURS, help=f"(default: {HOURS:g})")
    parser.add_argument(
        "--minutes", type=number("--minutes", "minutes"), default=MINUTES, help=f"of a spell (default: {MINUTES:g})"
    )
    parser.add_argument("--rate", type=number("--rate", "Hz"), default=RATE, help=f"in Hz (default: {RATE:g})")
    parser.add_argument(
        "--full-card", action="store_true", help="fill the card in the last spell: the run must continue"
    )
    parser.add_argument(
        "--record",
        type=folder,
        default=Path("soak"),
        metavar="DIR",
        help="new folder of the recordings; only those of spells that lost something stay (default: soak)",
    )
    parser.add_argument("--yes", action="store_true", help="arm without waiting for Enter")
    options = parser.parse_args(arguments)
    if options.record.exists():
        raise BadInput(f"--record {options.record} exists already: name a new folder")
    from runtime.host.machine.probe import Machine
    from runtime.robot.rig.file import read
    from runtime.setup.bench.rate.steps import OnRig
    from runtime.setup.bench.soak import Soak

    rig = read(options.rig)
    if len(rig.buses) != 1:
        raise BadInput(f"{options.rig}: expected one bus, with the actuators, got {len(rig.buses)}")
    make, ids = maker(options, next(iter(rig.buses))), list(range(1, options.actuators + 1))
    path = Path(time.strftime("soak_%Y-%m-%d_%H-%M-%S.json"))
    attempt = OnRig(make, ids, rig, 60.0 * options.minutes, options.yes, "try", print_to_stderr, options.record)
    soak = Soak(attempt, options.rate, path, Machine())
    print_lines([f"{len(ids)} × {options.model} at {options.rate:g} Hz for {options.hours:g} h; report: {path}"])
    try:
        passed = soak.run(3600.0 * options.hours, lambda line: print_lines([line]), options.full_card)
    except Interrupted:
        if soak.report["spells"]:
            print_lines([f"report until then: {path}"])
        raise
    print_lines([f"{'nothing was lost' if passed else 'something was lost: see above'}; report: {path}"])
    return OK if passed else CHECK_FAILED
