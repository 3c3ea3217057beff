"""Execution time of each block in a tick: a table with bars, and a plot."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, BinaryIO

from runtime.record.report.timing import details

if TYPE_CHECKING:
    from runtime.record.report.run_result import RunResult

TABLE_ROW_LIMIT = 40
BAR = 24  # characters
PLOT_BAR_LIMIT = 30
COLOURS = {"native": "#2a78b8", "Python": "#e08a1e", "device": "#3a9b5c", "phase": "#8a8f98", "plant": "#b7a4d6"}


def rows_of(result: RunResult) -> tuple[list[dict[str, Any]], ...]:
    """Return (rows of the robot, rows of its plant) with `share`, the fraction of all time in ticks.

    The other keys are those of cext.schedule.executor.Executor.profile.
    """
    busy = result.statistics["busy"] or 1.0
    return tuple([row | {"share": row["total"] / busy} for row in rows] for rows in result.profile)


def table(result: RunResult, stamp: float) -> list[str]:
    """Return the lines of the table. stamp : s that a clock reading takes, one of which is in every row"""
    robot, plant = rows_of(result)
    statistics = result.statistics
    ticks = statistics["ticks"]
    if not ticks:
        return ["profile: no tick was completed"]
    a_tick = statistics["busy"] / ticks
    lines = [
        f"profile: {ticks} ticks of {short(a_tick)} on average, {100 * a_tick * result.schedule.rate:.3g} % of the "
        f"period; each call includes {short(stamp)} for reading the clock",
        *(f"  {label:<12}{text}" for label, text in details(statistics)),
        "",
        *_table_lines(robot, "where"),
    ]
    if plant:
        lines += ["", *_table_lines(plant, "inside the plant")]
    return lines


def _table_lines(rows: Sequence[Mapping[str, Any]], title: str) -> list[str]:
    width = max([len(title), *(len(row["name"]) for row in rows[:TABLE_ROW_LIMIT])])
    full = "█" if "utf" in (getattr(sys.stdout, "encoding", None) or "").lower() else "#"
    longest = max([row["share"] for row in rows], default=1.0)
    lines = [f"  {title:<{width}}  {'kind':<14}{'calls':>9}{'p50':>9}{'p99':>9}{'max':>9}{'(tick)':>10}{'share':>9}"]
    for row in rows[:TABLE_ROW_LIMIT]:
        bar = full * round(BAR * row["share"] / longest)
        durations = "".join(f"{short(row[name]):>9}" for name in ("p50", "p99", "max"))
        lines.append(
            (
                f"  {row['name']:<{width}}  "
                f"{row['kind']:<14}{row['count']:>9}{durations}{row['max_at_tick']:>10}{100 * row['share']:>7.1f} %  "
                f"{bar}"
            ).rstrip()
        )
    rest = rows[TABLE_ROW_LIMIT:]
    if rest:
        lines.append(f"  and {len(rest)} more, {100 * sum(row['share'] for row in rest):.1f} % together")
    return lines


def short(seconds: float) -> str:
    """Return a duration with three digits, such as '45 ns', '1.25 µs' or '32 ms'."""
    for unit, size in (("ns", 1e-9), ("µs", 1e-6), ("ms", 1e-3)):
        if seconds < 999.5 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.3g} s"


def picture(result: RunResult, file: BinaryIO, kind: str) -> None:
    """Draw each block's share of the tick and its median, p99 and maximum time per call.

    kind : "png" or "svg"
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    robot, plant = rows_of(result)
    rows: list[dict[str, Any]] = sorted(
        [*robot, *(row | {"kind": "plant", "name": f"{row['name']} (plant)"} for row in plant)],
        key=lambda row: -row["share"],
    )
    rows = [row for row in rows if not (plant and row["name"] == "the plant")][:PLOT_BAR_LIMIT]
    figure = Figure(figsize=(10.0, 1.6 + 0.24 * len(rows)), layout="constrained")
    FigureCanvasAgg(figure)
    shares, calls = figure.subplots(1, 2, sharey=True, gridspec_kw={"width_ratios": (3, 2)})
    places = range(len(rows))
    kinds = [_kind_of(row) for row in rows]
    shares.barh(places, [100 * row["share"] for row in rows], color=[COLOURS[kind] for kind in kinds], height=0.72)
    shares.set_yticks(places, [row["name"] for row in rows], fontsize=8)
    shares.set_ylim(len(rows) - 0.4, -0.6)
    shares.set_xlabel("share of the tick [%]")
    for group in dict.fromkeys(kinds):
        shares.barh(0, 0, color=COLOURS[group], label=group)
    shares.legend(loc="lower right", fontsize=8)
    calls.hlines(
        places, [1e6 * row["p50"] for row in rows], [1e6 * row["max"] for row in rows], color="#c5c9cf", linewidth=1.2
    )
    for name, marker, size in (("p50", "o", 18), ("p99", "|", 60), ("max", ".", 14)):
        calls.scatter(
            [1e6 * row[name] for row in rows], places, marker=marker, s=size, label=name, color="#30343a", zorder=3
        )
    calls.set_xscale("log")
    calls.set_xlabel("time per call [µs]")
    calls.legend(loc="lower right", fontsize=8)
    for axes in (shares, calls):
        axes.grid(axis="x", alpha=0.25)
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
    ticks = max(1, result.statistics["ticks"])
    a_tick = short(result.statistics["busy"] / ticks)
    figure.suptitle(f"{result.schedule.name}: {ticks} ticks of {a_tick} at {result.schedule.rate:g} Hz", fontsize=11)
    figure.savefig(file, format=kind, dpi=120)


def _kind_of(row: Mapping[str, Any]) -> str:
    return row["kind"].partition(" ")[0]
