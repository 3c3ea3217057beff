"""`python -m runtime bench clock`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from runtime.cli.bench.options import add_options
from runtime.cli.parsing import Parser
from runtime.host.errors import BadInput
from runtime.setup.bench.report import Report, machine, machine_lines

if TYPE_CHECKING:
    from argparse import Namespace

    from runtime.setup.bench.clock import Contender

RATES = (200, 1000, 2000)  # Hz


def measure_and_print(arguments: Sequence[str]) -> Report:
    """Measure, and print the table. Returns the Report."""
    options = parser().parse_args(arguments)
    from runtime.setup.bench.clock import CONTENDERS

    report = Report(options.json)
    compare(report, options, CONTENDERS)
    return report


def parser() -> Parser:
    """Return the parser of the options."""
    parser = Parser("bench clock", "Measure the lateness of the executor, with native blocks and with Python blocks.")
    parser.add_argument(
        "--load", action="store_true", help="keep every processor busy with another process; at 1000 Hz only"
    )
    parser.add_argument(
        "--busy-thread", action="store_true", help="keep a Python thread of this process busy; at 1000 Hz only"
    )
    add_options(parser, seconds=2.0, repeats=4, realtime=True)
    return parser


def compare(report: Report, options: Namespace, contenders: Mapping[str, Contender]) -> None:
    """Measure the lateness of contenders, and add it to a report. options : as `parser` returns them"""
    from runtime.host.machine.realtime import RealtimeRefused
    from runtime.setup.bench import clock

    circumstances = [
        f"--realtime {options.realtime}",
        *["all processors loaded"] * options.load,
        *["a busy Python thread"] * options.busy_thread,
    ]
    chunks = f"{options.repeats} alternating chunks of {options.seconds:g} s for each row"
    report.say([f"{chunks}; {', '.join(circumstances)}", *machine_lines()], **machine())
    rates = [1000] if options.load or options.busy_thread else RATES
    try:
        results = clock.measure(
            contenders, rates, options.seconds, options.repeats, options.realtime, options.load, options.busy_thread
        )
    except RealtimeRefused as error:
        raise BadInput(str(error)) from None
    title = f"{clock.SIGNALS} signals recorded"
    lines = ["", f"{title:38}{'late, µs: p50':>16}{'p99':>10}{'|period-T|: p50':>18}{'p99':>10}{'missed':>14}"]
    rows = {}
    for rate, each in results.items():
        for name, kept in each.items():
            row = rows[f"{rate} Hz, {name}"] = {
                "late_p50_us": kept.late(0.5) * 1e6,
                "late_p99_us": kept.late(0.99) * 1e6,
                "period_p50_us": kept.off(0.5) * 1e6,
                "period_p99_us": kept.off(0.99) * 1e6,
                "missed": kept.missed,
                "ticks": kept.ticks,
            }
            lost = f"{row['missed']}/{row['ticks'] + row['missed']}"
            lines.append(
                f"  {f'{rate} Hz, {name}':36}{row['late_p50_us']:16.1f}{row['late_p99_us']:10.1f}"
                f"{row['period_p50_us']:18.1f}{row['period_p99_us']:10.1f}{lost:>14}"
            )
    report.say(lines, clock=rows)
