"""How the clock was kept, in words; and the words in which a person asks for it."""

import re

from runtime.base.errors import BadInput

UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
LONGEST_SPIN = 1.0  # s


def timing(result, passed):
    """(label, text) of how the clock was kept, or in virtual time how fast it went. passed : grid points"""
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
                f"{micro(statistics['busy'] / statistics['ticks'])} a tick"
                + (f", {waited:.1f} s of waiting for the recorder" if waited > 0.05 else "")
            ),
        )
        return
    yield "rate", f"{rate * statistics['ticks'] / passed:.2f} Hz held"
    yield "late by", spread(late)
    share, long = statistics["busy"] * rate / passed, statistics["execution"]["p99"]
    yield "load", f"{100 * share:.2f} % of the time inside ticks, {micro(long)} a tick at p99"
    if statistics["caught_up"]:
        yield "caught up", f"{statistics['caught_up']} ticks ran late"
    for index, row in enumerate(result.overruns[:5]):
        yield "" if index else "overruns", overrun_text(row)


def details(statistics):
    """(label, text) of what else is counted in real time."""
    if statistics["period"]["count"]:
        yield "period", f"off by {spread(statistics['period'])}"
    if statistics["gil"]["count"]:
        yield (
            "GIL",
            (
                f"taken {statistics['gil_taken'] / statistics['ticks']:.3g} times a tick; waits "
                f"{spread(statistics['gil'])}"
            ),
        )
    if statistics["bus"]["count"]:
        yield "on buses", spread(statistics["bus"])
    if statistics["spins"]:
        yield "spinning", f"before {statistics['spins']} of {statistics['ticks']} ticks, {statistics['sleeps']} sleeps"


def spread(found):
    """The percentiles of a histogram."""
    return (
        f"{micro(found['p50'])} median, {micro(found['p99'])} p99, {micro(found['p99.9'])} p99.9, "
        f"{micro(found['max'])} at most (tick {found['max_at_tick']})"
    )


def overrun_text(row):
    """row : of cext.schedule.executor.Executor.overruns"""
    points = f"{row['missed']} grid point{'s' * (row['missed'] > 1)}"
    times = f", {row['times']} times" if row["times"] > 1 else ""
    return f"{points} lost to {row['name']}{times}: {micro(row['longest'])} at most (tick {row['at_tick']})"


def micro(seconds):
    if seconds < 1e-5:
        return f"{seconds * 1e6:.1f} µs"
    if seconds < 1e-3:
        return f"{seconds * 1e6:.0f} µs"
    return f"{seconds * 1e3:.1f} ms"


def overrun_policy(text):
    """The words of --overrun, as they are. BadInput where there is no such policy."""
    from cext.clock.overrun import Overrun

    try:
        Overrun(text)
    except ValueError as error:
        raise BadInput(f"--overrun {text}: {error}") from None
    return text


def spin_window(text):
    """'50us' to 5e-5 s."""
    found = re.fullmatch(r"([0-9]*\.?[0-9]+)\s*(s|ms|us|µs|ns)", text)
    if not found:
        raise BadInput(f"--spin {text}: expected a duration with its unit, as in 50us or 0.1ms")
    seconds = float(found[1]) * UNITS[found[2]]
    if seconds > LONGEST_SPIN:
        raise BadInput(f"--spin {text}: at most {LONGEST_SPIN:g} s")
    return seconds
