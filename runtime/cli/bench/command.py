"""`python -m runtime bench`: blocks and compiles."""

from __future__ import annotations

from collections.abc import Sequence

from runtime.cli.bench import bus, clock, gait
from runtime.cli.bench.options import add_options
from runtime.cli.parsing import Parser
from runtime.host.errors import OK
from runtime.setup.bench.measure import interleave, table
from runtime.setup.bench.report import Report, machine, machine_lines

COMMANDS = {"bus": bus, "clock": clock, "gait": gait}


def main(arguments: Sequence[str]) -> int:
    """Run the command. Returns the exit code."""
    name, *rest = arguments or [""]
    report = COMMANDS[name].measure_and_print(rest) if name in COMMANDS else measure_and_print(arguments)
    report.finish()
    return OK


def measure_and_print(arguments: Sequence[str]) -> Report:
    """Measure blocks and compiles, and print their tables. Returns the Report."""
    parser = Parser(
        "bench",
        "Measure the cost of native and Python blocks per tick, and the time of a compile, on this machine.",
        "bench clock         lateness of the loop\n"
        "bench bus           cost of a bus and of the guardian\n"
        "bench gait          errors of the gait estimators on recorded walking",
    )
    add_options(parser, seconds=0.05, repeats=15)
    options = parser.parse_args(arguments)
    report = Report(options.json)
    what = f"processor time of one thread; {options.repeats} measurements of {options.seconds:g} s for each row"
    report.say([f"{what}, alternating", *machine_lines()], **machine())
    _tick_part(report, options.seconds, options.repeats)
    _compile_part(report)
    return report


def _tick_part(report: Report, seconds: float, repeats: int) -> None:
    from runtime.setup.bench import blocks

    kinds = {"native blocks": blocks.NATIVE, "Python blocks": blocks.PYTHON}
    contenders = [blocks.Ticks(name, blocks.chain(kind)) for name, kind in kinds.items()]
    times = interleave(contenders, seconds, repeats)
    sizes = {contender.name: contender.blocks for contender in contenders}
    heading, lines, rows = table(times, sizes, "native blocks")
    count = sizes["native blocks"]
    report.say(["", f"{f'a chain of {count} blocks':38}{heading}", *lines], chain={"blocks": count, "us_a_tick": rows})


def _compile_part(report: Report) -> None:
    from runtime.setup.bench import blocks

    sizes = blocks.compiles()
    exponent, n_log_n = blocks.exponent(*sizes[-2:]), blocks.n_log_n(*sizes[-2:])
    lines, rows = ["", f"{'compile':38}{'ms: min':>16}{'median':>12}{'max':>12}{'µs per block':>13}"], []
    for size in sizes:
        rows.append({"blocks": size.blocks})
        for label, name in ((f"{size.blocks} blocks", "compile"), ("  construction and wiring", "build")):
            times = getattr(size, name)
            rows[-1][f"{name}_ms"] = {"min": times.least, "median": times.median, "max": times.most}
            lines.append(
                f"  {label:36}{times.least:16.4g}{times.median:12.4g}{times.most:12.4g}"
                f"{times.median * 1e3 / size.blocks:13.3g}"
            )
    lines.append(f"  growth: blocks^{exponent:.2f}; n log n would be blocks^{n_log_n:.2f}")
    report.say(lines, compile={"rows": rows, "exponent": exponent, "n_log_n": n_log_n})
