"""`python -m runtime bench gait`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

from runtime.cli.bench.options import add_options
from runtime.cli.parsing import Parser, add_number
from runtime.host.errors import BadInput
from runtime.setup.bench.report import Report

FIGURES = ("missed", "invented", "median_ms", "p95_ms", "phase_rms_percent")


def measure_and_print(arguments: Sequence[str]) -> Report:
    """Measure, and print the tables. Returns the Report."""
    parser = Parser(
        "bench gait",
        "Measure the gait estimators on recorded walking: heel strikes missed and invented, their timing error, and "
        "the RMS error of the phase; at steady speed, with a sine of 0.8 to 1.4 times the speed over 15 s, in steps of "
        "speed every 5 s, and with stops.",
    )
    parser.add_argument(
        "recordings",
        type=Path,
        nargs="*",
        metavar="RECORDING",
        help="CSV files with columns such as time, contact_lt and thigh_pitch_lt_deg, or recordings with --signal; a "
        "built-in walk by default",
    )
    parser.add_argument(
        "--signal",
        action="append",
        default=[],
        metavar="LEG.KIND=NAME",
        help="name of a signal, such as left.thigh=left/hip.position; kinds: thigh, shank, knee, contact",
    )
    add_number(parser, "--rate", "Hz", "HZ", "ticks per second", default=200.0, maximum=2000.0)
    add_number(
        parser,
        "--noise",
        "rad",
        "RAD",
        "standard deviation of white noise of angles; ten times as much per second for velocities",
        default=0.0,
        maximum=1.0,
    )
    add_options(parser)
    options = parser.parse_args(arguments)
    from runtime.setup.bench import gait, gait_recordings

    names = dict(text.split("=", 1) if "=" in text else (text, "") for text in options.signal)
    wrong = next((name for name in names if name not in _signal_kinds(gait_recordings)), None)
    if wrong is not None:
        raise BadInput(f"--signal {wrong}: expected {', '.join(_signal_kinds(gait_recordings))}, then = and a name")
    report = Report(options.json)
    report.say([f"{options.rate:g} Hz; errors from the tenth strike on: before, the estimators learn the wearer"])
    walks = {str(path): gait_recordings.legs(path, names) for path in options.recordings}
    results = []
    for recording, legs in (walks or {"built-in walk": gait_recordings.built_in()}).items():
        for leg in legs:
            rows = {}
            for condition in gait.CONDITIONS:
                try:
                    for name, row in gait.measure(leg, condition, options.rate, options.noise).items():
                        rows.setdefault(name, {})[condition] = row
                except ValueError as error:
                    raise BadInput(f"{recording}, {leg.name} leg: {error}") from None
            results.append({"recording": recording, "leg": leg.name, "estimators": rows})
            report.say(table(f"{Path(recording).name}, {leg.name} leg", rows))
    report.say([], gait=results, rate=options.rate, noise=options.noise)
    return report


def _signal_kinds(recordings: ModuleType) -> list[str]:
    return [f"{side}.{kind}" for side in recordings.SIDES for kind in recordings.COLUMNS]


def table(title: str, rows: dict[str, dict[str, dict[str, float]]]) -> list[str]:
    """Lay out the rows of one leg, condition by condition."""
    lines = []
    for condition in next(iter(rows.values())):
        heading = f"{title}, {condition}"
        lines += ["", f"{heading:46}{'missed':>8}{'invented':>10}{'ms: median':>12}{'95 %':>8}{'phase RMS %':>14}"]
        for name, row in rows.items():
            missed, invented, median, p95, phase = (row[condition][figure] for figure in FIGURES)
            lines.append(f"  {name:44}{missed:8}{invented:10}{median:12.1f}{p95:8.1f}{phase:14.2f}")
    return lines
