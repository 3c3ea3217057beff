"""`python -m tests.bench clock`."""

from __future__ import annotations

from collections.abc import Sequence

from runtime.cli.bench import clock
from runtime.host.options import whole_number
from runtime.setup.bench.clock import CONTENDERS
from runtime.setup.bench.report import Report
from tests.bench import c_clock, costs, recorder_cost


def measure_and_print(arguments: Sequence[str]) -> Report:
    """Measure as `runtime bench clock`, beside a loop in C, then the costs of parts of a tick. Returns the Report."""
    parser = clock.parser()
    parser.prog = "python -m tests.bench clock"
    parser.add_argument(
        "--ticks",
        type=whole_number("--ticks"),
        default=10_000_000,
        metavar="N",
        help="ticks before memory is measured (default: 10 million)",
    )
    options = parser.parse_args(arguments)
    report = Report(options.json)
    clock.compare(report, options, {c_clock.C: c_clock.contender(), **CONTENDERS})
    if not (options.load or options.busy_thread):
        _cost_part(report, options.ticks)
    return report


def _cost_part(report: Report, ticks: int) -> None:
    mcap, size = recorder_cost.measure(csv=False)
    busy, waited = costs.knee_minute()
    results = {
        "recorded_signals_us": costs.recording() * 1e6,
        "histogram_add_ns": costs.histogram_add() * 1e9,
        "stamp_ns": costs.stamp() * 1e9,
        "drift_ns": float(costs.drift()) * 1e9,
        "growth_mib": costs.growth(many=ticks) / 2**20,
        "knee_minute_s": busy,
        "knee_waited_s": waited,
        "recorder_us": mcap * 1e6,
        "recorder_csv_us": recorder_cost.measure(csv=True)[0] * 1e6,
        "mcap_mb_an_hour": size * recorder_cost.RATE * 3600e-6,
    }
    report.say(
        [
            "",
            "costs",
            f"  60 recorded signals                 {results['recorded_signals_us'] * 1e3:10.0f} ns per tick",
            f"  adding to a histogram               {results['histogram_add_ns']:10.2f} ns",
            f"  time stamp for overrun reports      {results['stamp_ns']:10.1f} ns, after each Python step and "
            "phase in real time",
            f"  drift over 10^9 grid points         {results['drift_ns']:10.2f} ns",
            f"  growth over {ticks} ticks{'':{max(1, 17 - len(str(ticks)))}}{results['growth_mib']:11.2f} MiB, "
            "compared with 10000 ticks",
            f"  60 s of knee_exo, in virtual time   {busy:10.3f} s in the loop, {waited:.2f} s waiting for the "
            "recorder",
            f"  recorder, 36 signals and 4 frames   {results['recorder_us']:10.2f} µs per tick of its own processor, "
            f"{results['recorder_csv_us']:.2f} µs with CSV; {results['mcap_mb_an_hour']:.0f} MB an hour at 200 Hz",
        ],
        costs=results,
    )
