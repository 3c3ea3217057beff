"""`python -m tests.bench deaths`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from runtime.cli.bench.options import add_options
from runtime.host.errors import BadInput
from runtime.host.options import whole_number
from runtime.setup.bench.report import Report, machine, machine_lines, spread
from tests.bench.parsing import parser_of


def measure_and_print(arguments: Sequence[str]) -> Report:
    """Measure, and print the tables. Returns the Report."""
    parser = parser_of(
        "deaths",
        "Measure the time from the death of the control process or of the guardian to the first stop frame of the "
        "later of two drives.",
    )
    parser.add_argument(
        "--kills", type=whole_number("--kills"), default=200, metavar="N", help="runs of each case (default: 200)"
    )
    add_options(parser)
    options = parser.parse_args(arguments)
    from tests.bench import deaths

    report = Report(options.json)
    report.say(["emulated drives on udp_multicast; the cases take turns", *machine_lines()], **machine())
    try:
        times, loads = deaths.deaths(options.kills)
    except OSError as error:
        raise BadInput(str(error)) from None
    results = {}
    for name, seconds in times.items():
        milliseconds = np.array(seconds) * 1e3
        stopped = milliseconds[np.isfinite(milliseconds)]
        results[name] = {"n": len(stopped), "missed": len(seconds) - len(stopped), **spread(stopped)}
    report.say(
        [
            "",
            f"{'ms from the signal to the stop':46}{'n':>6}{'median':>9}{'p99':>9}{'max':>9}",
            *(f"  {name:44}{each['n']:6}" + _figures(each) for name, each in results.items()),
            f"load average: {np.median(loads):.1f}, {min(loads):.1f} to {max(loads):.1f}",
        ],
        deaths=results,
        load={"median": float(np.median(loads)), "min": min(loads), "max": max(loads)},
    )
    return report


def _figures(results: dict[str, float]) -> str:
    if not results["n"]:
        return "  none measured: " + ("no stop frame" if results["missed"] else "no real-time priority, see `doctor`")
    return "".join(f"{results[name]:9.2f}" for name in ("p50", "p99", "max"))
