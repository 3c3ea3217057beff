"""`python -m runtime bench bus`."""

import math

import numpy as np

from runtime.base.errors import OK, BadInput
from runtime.base.options import count
from runtime.bench import goals
from runtime.bench.report import Report, machine, words
from runtime.cli.bench.options import add_options
from runtime.cli.parsing import Parser


def main(arguments):
    """Run the command. Returns the exit code."""
    parser = Parser(
        "bench bus",
        "Measure what a bus costs a tick, what the guardian adds to it, and how soon the motors stop after kill -9.",
    )
    parser.add_argument(
        "--rounds", type=count("--rounds"), default=20_000, metavar="N", help="ticks on the native bus (default 20000)"
    )
    parser.add_argument(
        "--trips",
        type=count("--trips"),
        default=200,
        metavar="N",
        help="round trips of each of ten chunks (default 200)",
    )
    parser.add_argument(
        "--kills", type=count("--kills"), default=100, metavar="N", help="runs that are killed (default 100)"
    )
    add_options(parser)
    options = parser.parse_args(arguments)
    from runtime.bench import bus, guardian_death

    report = Report(options.json)
    report.say(["over sockets of this machine; what is compared is taken in turn", *words()], **machine())
    found = {}
    try:
        through, alone = (np.array(times) * 1e-3 for times in bus.host_cost(rounds=options.rounds))
        found["host_us"], found["calls_us"], found["beyond_us"] = (
            spread(through),
            spread(alone),
            spread(through - alone),
        )
        direct, carried = (np.array(times) * 1e6 for times in bus.round_trips(trips=options.trips))
        found["direct_us"], found["guardian_us"] = spread(direct), spread(carried)
        found["added_p99_us"] = found["guardian_us"]["p99"] - found["direct_us"]["p99"]
        stops = np.array(bus.kills(options.kills)) * 1e3
        deaths = {name: np.array(guardian_death.deaths(name, options.kills)) * 1e3 for name in guardian_death.RIGS}
    except OSError as error:
        raise BadInput(str(error)) from None
    found["stop_ms"], found["missed"] = spread(stops[np.isfinite(stops)]), int((~np.isfinite(stops)).sum())
    found["guardian_deaths_ms"] = {name: spread(times[np.isfinite(times)]) for name, times in deaths.items()}
    found["guardian_deaths_missed"] = int(sum((~np.isfinite(times)).sum() for times in deaths.values()))
    report.say(
        [
            "",
            f"{'':46}{'p50':>9}{'p99':>9}{'max':>9}",
            row("8 frames in and out through a bus, µs", found["host_us"]),
            row("the two system calls alone, µs", found["calls_us"]),
            row("the difference, µs", found["beyond_us"]),
            row("round trip by python-can, µs", found["direct_us"]),
            row("the same through the guardian, µs", found["guardian_us"]),
            row(f"{len(stops)} times kill -9, to the last first stop, ms", found["stop_ms"]),
            *(row(f"the same of the guardian, {name}, ms", each) for name, each in found["guardian_deaths_ms"].items()),
        ],
        bus=found,
    )
    report.goals += goals.of_bus(found)
    report.finish()
    return OK


def spread(values):
    if not len(values):
        return dict.fromkeys(("p50", "p99", "max"), math.inf)
    return {
        "p50": float(np.percentile(values, 50)),
        "p99": float(np.percentile(values, 99)),
        "max": float(values.max()),
    }


def row(name, found):
    return f"  {name:44}{found['p50']:9.2f}{found['p99']:9.2f}{found['max']:9.2f}"
