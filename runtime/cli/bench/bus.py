"""`python -m runtime bench bus`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from runtime.cli.bench.options import add_options
from runtime.cli.parsing import Parser, add_count
from runtime.host.errors import BadInput
from runtime.setup.bench.report import Report, machine, machine_lines, row, spread


def measure_and_print(arguments: Sequence[str]) -> Report:
    """Measure, and print the table. Returns the Report."""
    parser = Parser("bench bus", "Measure the cost of a bus per tick, and the latency that the guardian adds.")
    add_count(parser, "--rounds", "ticks on the native bus", default=20_000)
    add_count(parser, "--trips", "round trips in each of ten chunks", default=200)
    add_options(parser)
    options = parser.parse_args(arguments)
    from runtime.setup.bench import bus

    report = Report(options.json)
    report.say(["over sockets of this machine; compared measurements alternate", *machine_lines()], **machine())
    try:
        through, alone = (np.array(times) * 1e-3 for times in bus.host_cost(rounds=options.rounds))
        direct, carried = (np.array(times) * 1e6 for times in bus.round_trips(trips=options.trips))
    except OSError as error:
        raise BadInput(str(error)) from None
    results = {
        "host_us": spread(through),
        "calls_us": spread(alone),
        "beyond_us": spread(through - alone),
        "direct_us": spread(direct),
        "guardian_us": spread(carried),
    }
    report.say(
        [
            "",
            f"{'':46}{'p50':>9}{'p99':>9}{'max':>9}",
            row("8 frames received and sent through a bus, µs", results["host_us"]),
            row("the two system calls alone, µs", results["calls_us"]),
            row("the difference, µs", results["beyond_us"]),
            row("round trip through python-can, µs", results["direct_us"]),
            row("the same through the guardian, µs", results["guardian_us"]),
        ],
        bus={**results, "added_p99_us": results["guardian_us"]["p99"] - results["direct_us"]["p99"]},
    )
    return report
