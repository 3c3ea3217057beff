"""`python -m runtime bench bus`."""

from __future__ import annotations

import math
import signal
from collections.abc import Sequence

import numpy as np

from runtime.cli.bench.options import add_options
from runtime.cli.parsing import Parser
from runtime.host.errors import OK, BadInput
from runtime.host.options import count
from runtime.setup.bench import goals
from runtime.setup.bench.report import Report, machine, machine_lines


def main(arguments: Sequence[str]) -> int:
    """Run the command. Returns the exit code."""
    parser = Parser(
        "bench bus",
        "Measure the cost of a bus per tick, the latency that the guardian adds, and the stop time after kill -9.",
    )
    parser.add_argument(
        "--rounds", type=count("--rounds"), default=20_000, metavar="N", help="ticks on the native bus (default: 20000)"
    )
    parser.add_argument(
        "--trips",
        type=count("--trips"),
        default=200,
        metavar="N",
        help="round trips in each of ten chunks (default: 200)",
    )
    parser.add_argument("--kills", type=count("--kills"), default=100, metavar="N", help="runs to kill (default: 100)")
    add_options(parser)
    options = parser.parse_args(arguments)
    from runtime.setup.bench import bus, guardian_death

    report = Report(options.json)
    report.say(["over sockets of this machine; compared measurements alternate", *machine_lines()], **machine())
    results = {}
    try:
        through, alone = (np.array(times) * 1e-3 for times in bus.host_cost(rounds=options.rounds))
        results["host_us"], results["calls_us"], results["beyond_us"] = (
            spread(through),
            spread(alone),
            spread(through - alone),
        )
        direct, carried = (np.array(times) * 1e6 for times in bus.round_trips(trips=options.trips))
        results["direct_us"], results["guardian_us"] = spread(direct), spread(carried)
        results["added_p99_us"] = results["guardian_us"]["p99"] - results["direct_us"]["p99"]
        stops = np.array(bus.kills(options.kills)) * 1e3
        deaths = {name: np.array(guardian_death.deaths(name, options.kills)) * 1e3 for name in guardian_death.RIGS}
        halts = np.array(guardian_death.deaths("udp_multicast", options.kills, signal.SIGSTOP)) * 1e3
    except OSError as error:
        raise BadInput(str(error)) from None
    results["stop_ms"], results["missed"] = spread(stops[np.isfinite(stops)]), int((~np.isfinite(stops)).sum())
    results["guardian_deaths_ms"] = {name: spread(times[np.isfinite(times)]) for name, times in deaths.items()}
    results["guardian_halts_ms"] = spread(halts[np.isfinite(halts)])
    results["guardian_deaths_missed"] = int(sum((~np.isfinite(times)).sum() for times in [*deaths.values(), halts]))
    report.say(
        [
            "",
            f"{'':46}{'p50':>9}{'p99':>9}{'max':>9}",
            row("8 frames received and sent through a bus, µs", results["host_us"]),
            row("the two system calls alone, µs", results["calls_us"]),
            row("the difference, µs", results["beyond_us"]),
            row("round trip through python-can, µs", results["direct_us"]),
            row("the same through the guardian, µs", results["guardian_us"]),
            row(f"{len(stops)} kills of the run to the last stop frame, ms", results["stop_ms"]),
            *(row(f"kills of the guardian, {name}, ms", each) for name, each in results["guardian_deaths_ms"].items()),
            row("kill -STOP of the guardian, udp_multicast, ms", results["guardian_halts_ms"]),
        ],
        bus=results,
    )
    report.goals += goals.of_bus(results)
    report.finish()
    return OK


def spread(values: np.ndarray) -> dict[str, float]:
    """Return {"p50", "p99", "max"} of values, infinite where there are none."""
    if not len(values):
        return dict.fromkeys(("p50", "p99", "max"), math.inf)
    return {
        "p50": float(np.percentile(values, 50)),
        "p99": float(np.percentile(values, 99)),
        "max": float(values.max()),
    }


def row(name: str, results: dict[str, float]) -> str:
    """Return a line of the table. results : as returned by `spread`"""
    return f"  {name:44}{results['p50']:9.2f}{results['p99']:9.2f}{results['max']:9.2f}"
