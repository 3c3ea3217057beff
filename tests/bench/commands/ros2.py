"""`python -m tests.bench ros2`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from runtime.cli.bench.options import add_options
from runtime.cli.parsing import add_count
from runtime.setup.bench.report import Report, machine, machine_lines
from tests.bench.parsing import parser_of

SHARES = (50, 90, 99)  # percentiles


def measure_and_print(arguments: Sequence[str]) -> Report:
    """Measure, and print the table. Returns the Report."""
    parser = parser_of(
        "ros2",
        "Measure the time from the tick of a run to a subscriber of ROS 2 behind a router, and that of a bare "
        "publisher of Zenoh with messages of the same size.",
    )
    add_options(parser, seconds=4.0, repeats=6)
    add_count(parser, "--joints", "actuators of the run", default=4)
    add_count(parser, "--sensors", "inertial sensors of the run", default=3)
    options = parser.parse_args(arguments)
    from tests.bench import ros2

    report = Report(options.json)
    what = f"{options.repeats} alternating chunks of {options.seconds:g} s for each, at {ros2.RATE} Hz"
    report.say([what, *machine_lines()], **machine())
    results, sizes = ros2.measure(options.seconds, options.repeats, options.joints, options.sensors)
    rows: dict[str, dict[str, Any]] = {}
    for name, times in results.items():
        for part, label in (
            ("before", "grid time to put"),
            ("late", "of it, lateness of the tick"),
            ("added", "of it, tick and bridge"),
            ("after", "put to subscriber"),
        ):
            if values := getattr(times, part):
                rows[f"{name}: {label}"] = figures(values)
        rows[f"{name}: total"] = figures(np.add(times.before, times.after))
    loads = [load for times in results.values() for load in times.loads]
    report.say(
        [
            f"messages of {', '.join(map(str, sizes))} bytes per tick",
            "",
            f"{'ms':40}{'n':>8}" + "".join(f"{f'p{share}':>9}" for share in SHARES) + f"{'max':>9}",
            *(
                f"  {name:38}{each['n']:8}" + "".join(f"{each[f'p{share}_ms']:9.2f}" for share in (*SHARES, 100))
                for name, each in rows.items()
            ),
            f"load average: {np.median(loads):.1f}, {min(loads):.1f} to {max(loads):.1f}",
        ],
        ros2=rows,
        sizes=sizes,
        load={"median": float(np.median(loads)), "min": min(loads), "max": max(loads)},
    )
    return report


def figures(seconds: Sequence[float] | np.ndarray) -> dict[str, float]:
    """Return the number of times and their percentiles in ms."""
    values = np.asarray(seconds) * 1e3
    return {"n": len(values), **{f"p{share}_ms": float(np.percentile(values, share)) for share in (*SHARES, 100)}}
