"""`python -m runtime bench clock`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from runtime.cli.bench.options import add_options
from runtime.cli.parsing import Parser
from runtime.host.errors import OK, BadInput
from runtime.host.options import count
from runtime.setup.bench import goals
from runtime.setup.bench.report import Report, machine, machine_lines

if TYPE_CHECKING:
    from argparse import Namespace

    from runtime.setup.bench.report import Report

RATES = (200, 1000, 2000)  # Hz


def main(arguments: Sequence[str]) -> int:
    """Run the command. Returns the exit code."""
    parser = Parser(
        "bench clock",
        "Measure the lateness of the executor, compared with a C loop that only sleeps, and the cost of parts of a "
        "tick.",
    )
    parser.add_argument(
        "--load", action="store_true", help="keep every processor busy with another process; at 1000 Hz only"
    )
    parser.add_argument(
        "--busy-thread", action="store_true", help="keep a Python thread of this process busy; at 1000 Hz only"
    )
    parser.add_argument(
        "--ticks",
        type=count("--ticks"),
        default=10_000_000,
        metavar="N",
        help="ticks before memory is measured (default: 10 million)",
    )
    add_options(parser, seconds=2.0, repeats=4, realtime=True)
    options = parser.parse_args(arguments)
    report = Report(options.json)
    disturbed = options.load or options.busy_thread
    chunks = f"{options.repeats} alternating chunks of {options.seconds:g} s for each row"
    circumstances = [
        f"--realtime {options.realtime}",
        *["all processors loaded"] * options.load,
        *["a busy Python thread"] * options.busy_thread,
    ]
    report.say([f"{chunks}; {', '.join(circumstances)}", *machine_lines()], **machine())
    _keep_part(report, [1000] if disturbed else RATES, options, disturbed)
    if not disturbed:
        _cost_part(report, options.ticks)
    report.finish()
    return OK


def _keep_part(report: Report, rates: Sequence[int], options: Namespace, disturbed: bool) -> None:
    from runtime.host.machine.realtime import RealtimeRefused
    from runtime.setup.bench import clock
    from runtime.setup.bench.c_program import NoCompiler

    try:
        results = clock.measure(
            rates, options.seconds, options.repeats, options.realtime, options.load, options.busy_thread
        )
    except (NoCompiler, RealtimeRefused) as error:
        raise BadInput(str(error)) from None
    title = f"{clock.SIGNALS} signals recorded"
    lines = [
        "",
        f"{title:38}{'late, µs: p50':>16}{'p99':>10}{'|period-T|: p50':>18}{'p99':>10}{'x C':>8}{'missed':>14}",
    ]
    rows = {}
    for rate, contenders in results.items():
        reference = contenders[clock.C]
        for name, kept in contenders.items():
            row = rows[f"{rate} Hz, {name}"] = {
                "late_p50_us": kept.late(0.5) * 1e6,
                "late_p99_us": kept.late(0.99) * 1e6,
                "period_p50_us": kept.off(0.5) * 1e6,
                "period_p99_us": kept.off(0.99) * 1e6,
                "period_p99_times_c": kept.off(0.99) / reference.off(0.99),
                "missed": kept.missed,
                "ticks": kept.ticks,
            }
            lost = f"{row['missed']}/{row['ticks'] + row['missed']}"
            lines.append(
                f"  {f'{rate} Hz, {name}':36}{row['late_p50_us']:16.1f}{row['late_p99_us']:10.1f}"
                f"{row['period_p50_us']:18.1f}{row['period_p99_us']:10.1f}{row['period_p99_times_c']:8.2f}{lost:>14}"
            )
    report.say(lines, clock=rows)
    report.goals += goals.of_clock(results, disturbed)


def _cost_part(report: Report, ticks: int) -> None:
    from runtime.setup.bench import costs, recorder_cost

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
    report.goals += goals.of_costs(results)
