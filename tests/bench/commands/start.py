"""`python -m tests.bench start`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from runtime.cli.bench.options import add_options
from runtime.host.errors import BadInput
from runtime.setup.bench.report import Report, machine, machine_lines
from tests.bench import starting
from tests.bench.parsing import parser_of

KNEE_EXO = Path(__file__).parents[3] / "diagrams" / "knee_exo.py"


def measure_and_print(arguments: Sequence[str]) -> Report:
    """Measure, and print the table. Returns the Report."""
    parser = parser_of("start", "Measure the time from the start of a process to its first tick, and its memory.")
    parser.add_argument("file", type=Path, nargs="?", default=KNEE_EXO, help="a diagram file (default: knee_exo.py)")
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
    return report
