"""`python -m tests.bench views`."""

from collections.abc import Sequence
from typing import Any

from runtime.cli.bench.options import add_options
from runtime.setup.bench.report import Report, machine, machine_lines
from tests.bench.parsing import parser_of


def measure_and_print(arguments: Sequence[str]) -> Report:
    """Measure, and print the tables. Returns the Report."""
    parser = parser_of("views", "Measure the lateness of the loop with all recorders and viewers, and with none.")
    add_options(parser, seconds=5.0, repeats=6, realtime=True)
    options = parser.parse_args(arguments)
    from tests.bench import views, views_process

    report = Report(options.json)
    what = (
        f"{options.repeats} alternating chunks of {options.seconds:g} s for each row, each in a separate "
        f"process; --realtime {options.realtime}"
    )
    report.say([what, *machine_lines()], **machine())
    results, problems, dropped = views.measure(options.seconds, options.repeats, options.realtime)
    title = f"{views_process.SIGNALS} signals, {views_process.RATE} Hz"
    lines, rows = ["", f"{title:38}{'late, µs: p50':>16}{'p99':>10}{'chunks':>14}{'p99.9':>10}{'missed':>14}"], {}
    for name, kept in results.items():
        label = "no recorder, no viewer" if name == views.NONE else ", ".join(views.viewers())
        row: dict[str, Any] = {
            f"late_p{share}_us": kept.late(float(share) / 100) * 1e6 for share in ("50", "99", "99.9")
        }
        row |= {"missed": kept.missed, "ticks": kept.ticks, "late_p99_of_chunks_us": [late * 1e6 for late in kept.each]}
        rows[name] = row
        spread = f"{min(row['late_p99_of_chunks_us']):.0f} to {max(row['late_p99_of_chunks_us']):.0f}"
        lost = f"{kept.missed}/{kept.ticks + kept.missed}"
        late = f"{row['late_p50_us']:16.1f}{row['late_p99_us']:10.1f}{spread:>14}{row['late_p99.9_us']:10.1f}{lost:>14}"
        lines += [f"  {label:36}{late}"] if len(label) <= 36 else [f"  {label}", f"{'':38}{late}"]
    report.say(
        [*lines, *(f"  {problem}" for problem in problems)],
        views=rows,
        on=views.viewers(),
        problems=problems,
        dropped=dropped,
    )
    return report
