"""`python -m runtime bench`: blocks and compiles, and `bench start`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from runtime.cli.bench import bus, can, clock, deaths, gait, sensors, views
from runtime.cli.bench.options import add_options
from runtime.cli.parsing import Parser
from runtime.host.errors import OK, BadInput
from runtime.setup.bench import goals
from runtime.setup.bench.measure import interleave, table
from runtime.setup.bench.report import Report, machine, machine_lines

COMMANDS = {"bus": bus, "can": can, "clock": clock, "deaths": deaths, "gait": gait, "sensors": sensors, "views": views}
KNEE_EXO = Path(__file__).parents[3] / "diagrams" / "knee_exo.py"


def main(arguments: Sequence[str]) -> int:
    """Run the command. Returns the exit code."""
    if arguments[:1] == ["start"]:
        return _start_command(arguments[1:])
    if arguments and arguments[0] in COMMANDS:
        return COMMANDS[arguments[0]].main(arguments[1:])
    parser = Parser(
        "bench",
        "Measure the cost of native and Python blocks per tick, and the time of a compile, on this machine.",
        "bench start [FILE]  start-up time and memory\n"
        "bench clock         lateness of the loop, compared with a C loop\n"
        "bench bus           cost of a bus and of the guardian\n"
        "bench deaths        time to the stop after the death of each process of a run\n"
        "bench can           cost of eight drives per tick, and replies lost at 1000 Hz\n"
        "bench gait          errors of the gait estimators on recorded walking\n"
        "bench sensors       cost of eight inertial sensors on serial lines\n"
        "bench views         lateness of the loop with every recorder and viewer on",
    )
    add_options(parser, seconds=0.05, repeats=15)
    options = parser.parse_args(arguments)
    report = Report(options.json)
    what = f"processor time of one thread; {options.repeats} measurements of {options.seconds:g} s for each row"
    report.say([f"{what}, alternating", *machine_lines()], **machine())
    _tick_part(report, options.seconds, options.repeats)
    _compile_part(report)
    report.finish()
    return OK


def _tick_part(report: Report, seconds: float, repeats: int) -> None:
    from runtime.setup.bench import blocks

    kinds = {"native blocks": blocks.NATIVE, "Python blocks": blocks.PYTHON}
    contenders = [blocks.Ticks(name, blocks.chain(kind)) for name, kind in kinds.items()]
    times = interleave(contenders, seconds, repeats)
    sizes = {contender.name: contender.blocks for contender in contenders}
    heading, lines, rows = table(times, sizes, "native blocks")
    count = sizes["native blocks"]
    report.say(["", f"{f'a chain of {count} blocks':38}{heading}", *lines], chain={"blocks": count, "us_a_tick": rows})
    report.goals += goals.of_blocks(rows)


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
    report.goals += goals.of_compiles(sizes, exponent, n_log_n)


def _start_command(arguments: Sequence[str]) -> int:
    from runtime.setup.bench import starting

    parser = Parser("bench start", "Measure the time from the start of a process to its first tick, and its memory.")
    parser.add_argument(
        "file", type=Path, nargs="?", default=KNEE_EXO, help="a diagram file (default: diagrams/knee_exo.py of a clone)"
    )
    add_options(parser, repeats=7)
    options = parser.parse_args(arguments)
    if not options.file.exists():
        raise BadInput(f"file {options.file} does not exist")
    report = Report(options.json)
    report.say([f"{options.repeats} starts of each kind, alternating", *machine_lines()], **machine())
    starts = starting.measure(options.file.resolve(), options.repeats)
    lines, rows = ["", f"{'start':38}{'ms: min':>16}{'median':>12}{'max':>12}{'MB':>13}"], {}
    for what, (times, memory) in starts.items():
        name = f"{options.file.name}, to the first tick" if what == "run" else what
        lines.append(f"  {name:36}{times.least:16.4g}{times.median:12.4g}{times.most:12.4g}{memory.median:13.3g}")
        rows[what] = {
            "ms": {"min": times.least, "median": times.median, "max": times.most},
            "resident_mb": memory.median,
        }
    report.say(lines, start=rows)
    report.goals += goals.of_start(starts)
    report.finish()
    return OK
