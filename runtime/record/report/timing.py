"""Text of a run's timing statistics, and parsing of the timing options."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from runtime.host.console.styles import count
from runtime.host.errors import BadInput

if TYPE_CHECKING:
    from runtime.record.report.run_result import RunResult

UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
SPIN_LIMIT = 1.0  # s


def timing(result: RunResult, passed: int) -> Iterator[tuple[str, str]]:
    """Yield (label, text) of the timing, or of the speed in virtual time. passed : grid points of the run"""
    statistics, rate = result.statistics, result.schedule.rate
    late = statistics["lateness"]
    if not late["count"]:
        return
    if result.request.fast:
        waited = statistics["waited_for_recorder"]
        yield (
            "speed",
            (
                f"{passed / rate / result.seconds:.0f} times real time: "
                f"{micro(statistics['busy'] / statistics['ticks'])} per tick"
                + (f", {waited:.1f} s waiting for the recorder" if waited > 0.05 else "")
            ),
        )
        return
    passed += result.stalled  # in real time
    yield "rate", f"{rate * statistics['ticks'] / passed:.2f} Hz held"
    yield "late by", spread(late)
    share, long = statistics["busy"] * rate / passed, statistics["execution"]["p99"]
    yield "load", f"{100 * share:.2f} % of the time inside ticks, {micro(long)} per tick at p99"
    if statistics["caught_up"]:
        yield "caught up", f"{statistics['caught_up']} ticks ran late"
    if result.stalled:
        points = count(result.stalled, "grid point")
        yield "stalls", f"simulated time stood still for {points} while the computer stalled"
    for index, row in enumerate(result.overruns[:5]):
        yield "" if index else "overruns", overrun_text(row)


def details(statistics: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield (label, text) of the other statistics in real time."""
    if statistics["period"]["count"]:
        yield "period", f"off by {spread(statistics['period'])}"
    if statistics["gil"]["count"]:
        yield (
            "GIL",
            (
                f"acquired {statistics['gil_taken'] / statistics['ticks']:.3g} times per tick; waits "
                f"{spread(statistics['gil'])}"
            ),
        )
    if statistics["bus"]["count"]:
        yield "on buses", spread(statistics["bus"])
    if statistics["spins"]:
        yield "spinning", f"before {statistics['spins']} of {statistics['ticks']} ticks, {statistics['sleeps']} sleeps"


def spread(histogram: dict[str, float]) -> str:
    """Return the percentiles of a histogram as text."""
    return (
        f"{micro(histogram['p50'])} median, {micro(histogram['p99'])} p99, {micro(histogram['p99.9'])} p99.9, "
        f"{micro(histogram['max'])} max (tick {histogram['max_at_tick']})"
    )


def overrun_text(row: Mapping[str, Any]) -> str:
    """Return a row of cext.schedule.executor.Executor.overruns as text."""
    points = f"{row['missed']} grid point{'s' * (row['missed'] > 1)}"
    times = f", {row['times']} times" if row["times"] > 1 else ""
    return f"{points} lost to {row['name']}{times}: {micro(row['longest'])} max (tick {row['at_tick']})"


def micro(seconds: float) -> str:
    """Return a duration as text, such as '1.5 µs', '120 µs' or '12.0 ms'."""
    if seconds < 1e-5:
        return f"{seconds * 1e6:.1f} µs"
    if seconds < 1e-3:
        return f"{seconds * 1e6:.0f} µs"
    return f"{seconds * 1e3:.1f} ms"


def overrun_policy(text: str) -> str:
    """Return the argument of --overrun unchanged. Raises BadInput if there is no such policy."""
    from cext.clock.overrun import Overrun

    try:
        Overrun(text)
    except ValueError as error:
        raise BadInput(f"--overrun {text}: {error}") from None
    return text


def spin_window(text: str) -> float:
    """Convert a duration with its unit to seconds, such as '50us' to 5e-5. Raises BadInput."""
    match = re.fullmatch(r"([0-9]*\.?[0-9]+)\s*(s|ms|us|µs|ns)", text)
    if not match:
        raise BadInput(f"--spin {text}: expected a duration with its unit, as in 50us or 0.1ms")
    seconds = float(match[1]) * UNITS[match[2]]
    if seconds > SPIN_LIMIT:
        raise BadInput(f"--spin {text}: maximum is {SPIN_LIMIT:g} s")
    return seconds
