"""`python -m tests.bench can`."""

from collections.abc import Sequence

import numpy as np

from runtime.cli.bench.options import add_options
from runtime.host.errors import BadInput
from runtime.host.options import whole_number
from runtime.setup.bench.report import Report, machine, machine_lines, row, spread
from tests.bench.parsing import parser_of


def measure_and_print(arguments: Sequence[str]) -> Report:
    """Measure, and print the tables. Returns the Report."""
    parser = parser_of("can", "Measure the cost of eight drives per tick, and the replies lost from motors at 1000 Hz.")
    parser.add_argument(
        "--rounds",
        type=whole_number("--rounds"),
        default=4000,
        metavar="N",
        help="ticks in each of five chunks (default: 4000)",
    )
    add_options(parser, seconds=2.0, repeats=5, seconds_limit=600.0)
    options = parser.parse_args(arguments)
    from tests.bench import can_cost
    from tests.bench.c_program import NoCompiler

    report = Report(options.json)
    report.say(["over sockets of this machine; compared measurements alternate", *machine_lines()], **machine())
    alone, through, calls = [], [], []
    try:
        can_cost.native(max(1, options.rounds // 10))  # warm
        for _ in range(options.repeats):
            for pool, times in zip((alone, through, calls), can_cost.native(options.rounds)):
                pool += times
        ours, theirs = can_cost.fast_motors(options.seconds, options.repeats)
    except (OSError, NoCompiler) as error:
        raise BadInput(str(error)) from None
    results = {
        "native_us": spread(np.array(alone) * 1e-3),
        "socket_us": spread(np.array(through) * 1e-3),
        "calls_us": spread(np.array(calls) * 1e-3),
        "motors": {
            name: dict(zip(("unanswered", "lost", "commands"), values))
            for name, values in (("tickwork", ours), ("c", theirs))
        },
    }
    title = f"{can_cost.DRIVES} motors at {can_cost.RATE:g} Hz on {can_cost.BUSES} buses"
    report.say(
        [
            "",
            f"{f'{can_cost.DRIVES} drives, µs per tick':46}{'p50':>9}{'p99':>9}{'max':>9}",
            row("native, without the system calls of a bus", results["native_us"]),
            row("native, over a socket", results["socket_us"]),
            row("the two system calls alone", results["calls_us"]),
            "",
            f"{title:46}{'commands':>9}{'unanswered':>12}{'ticks lost':>12}",
            *(
                f"  {name:44}{commands:9}{missed:12}{lost:12}"
                for name, (missed, lost, commands) in (("Tickwork", ours), ("a loop in C", theirs))
            ),
        ],
        can=results,
    )
    return report
