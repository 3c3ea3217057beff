"""The status line of a run on a terminal, refreshed ten times a second.

    running ━━━━╌╌╌╌ 5.3/10 s · 200.0 Hz · late 61/240 µs · load 3.1 % · legs 21 % full · missed 0 · dropped 0 ·
    left/knee ━━╌╌  −4.5 N·m

    running 5.3/10 s  200.0 Hz  late 61/240 µs  load 3.1 %  legs 21 %  lost 0  τ ▃▁

The second form fits 80 columns. The parameter selected with the keys follows the time. A bar is the share of the torque
limit. Lateness is the median and the 99th percentile since the start; rate, load and bus load are averages over the
last second: for CAN the share of the bitrate, for other buses frames per second.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

from runtime.host.console.status_layout import Step, bar, fit, part

if TYPE_CHECKING:
    from runtime.record.recorder.plan_types import Plan

REFRESH_PERIOD = 0.1  # s
RATE_WINDOW = 10  # refreshes
WIDENING_DELAY = 30  # refreshes with room for a longer form before it is shown, against flicker
OPERATOR_IMPORTANCE = 8.0  # least importance of the parts that answer a key, which are shown as soon as they fit
TORQUE_BAR = 4  # characters
LEVELS = ".:-=+*#@", "▁▂▃▄▅▆▇█"  # torque bars of one character
HIGH_LOAD, HIGH_TORQUE = 0.8, 0.95  # share of the time in ticks; of the limit
STATES = {
    "running": "green",
    "safe": "green",
    "init": "yellow",
    "arming": "yellow",
    "stopping": "yellow",
    "ready": "yellow",
    "waiting": "red",
}


class StatusLine:
    """The status line of one run."""

    def __init__(self, terminal, plan: Plan, shared, panel=None, recording=None):
        self.terminal, self.plan, self.shared = terminal, plan, shared
        self.panel, self.recording = panel, recording
        self.torques = torques_of(plan)
        self.enabled = plan["status_line"] and terminal.interactive
        self.next = 0.0
        self.history, self.state = deque(maxlen=RATE_WINDOW + 1), None  # of the present state alone
        # shortening of the newest lines; width of the terminal
        self.narrowed, self.columns = deque(maxlen=WIDENING_DELAY), None

    def update(self, now: float) -> None:
        """Redraw if due. now : s, of any monotonic clock"""
        if not self.enabled or now < self.next:
            return
        self.next = now + REFRESH_PERIOD
        statistics = self.shared.statistics()
        frames = statistics["frames"]["sent"] + statistics["frames"]["received"]
        if self.shared.state != self.state:  # arming has other rates than running
            self.state = self.shared.state
            self.history.clear()
        buses = (*self.recording.traffic, *self.recording.bits) if self.recording is not None else ()
        self.history.append((now, statistics["ticks"], statistics["busy"], frames, *buses))
        parts = describe(
            self.plan,
            self.shared.state,
            statistics,
            rates(self.history),
            self.terminal.unicode,
            [] if self.panel is None else self.panel.parts(now),
        )
        if self.recording is not None and self.recording.newest is not None:
            parts += torque_part(self.torques, self.recording.newest, self.terminal.unicode)
        columns = self.terminal.columns
        if columns != self.columns:
            self.columns = columns
            self.narrowed.clear()
        line = parts, columns - 1, self.terminal.coloured, self.terminal.unicode
        _, steps = fit(*line)
        self.narrowed.append(
            steps - {Step("without", part.importance) for part in parts if part.importance >= OPERATOR_IMPORTANCE}
        )
        self.terminal.draw(fit(*line, kept=frozenset().union(*self.narrowed))[0])

    def erase(self) -> None:
        """Remove the line from the terminal."""
        self.terminal.erase()


def torques_of(plan: Plan) -> list[tuple[str, int, float]]:
    """Return [(name of the actuator, index in the recorded row, limit)] of the actuators with known limits."""
    limits = {path: max(map(abs, ends)) for path, ends in plan.get("limits", {}).items() if path.endswith(".torque")}
    return [
        (signal["path"].removesuffix(".torque"), 2 + place, limits[signal["path"]])
        for place, signal in enumerate(plan["signals"])
        if limits.get(signal["path"])
    ]


def torque_part(torques: list[tuple[str, int, float]], row: Sequence[float], unicode: bool) -> list[Any]:
    """Return a list with the part of the torques, empty without torques. row : tick, lateness, values"""
    long, middle, shares = [], [], []
    for name, place, limit in torques:
        torque, share = row[place], abs(row[place]) / limit
        colour = "red" if share > HIGH_TORQUE else None
        if share != share:  # NaN, which ends the run with a fault
            shares.append(("!", "red"))
            continue
        text = f"{torque:{len(f'{-limit:.1f}')}.1f} N·m"
        short = f"{name} {bar(share, unicode, TORQUE_BAR)}"
        long += [
            (" · " if unicode else " | ", None),
            (f"{short} {text.replace('-', '−') if unicode else text}", colour),
        ]
        middle += [(" ", None), (short, colour)]
        levels = LEVELS[unicode]
        shares.append((levels[min(len(levels) - 1, int(share * len(levels)))], colour))
    if not torques:
        return []
    return [part(3.5, long[1:], middle[1:], [("τ " if unicode else "tau ", None), *shares])]


def rates(history: Sequence[tuple[float, ...]]) -> tuple[float, ...] | None:
    """Return (ticks/s, share of time in ticks, frames/s, frames/s of each bus, bits/s of each bus) over the window.

    None with fewer than two samples.
    """
    (start, *first), (stop, *last) = history[0], history[-1]
    return tuple((b - a) / (stop - start) for a, b in zip(first, last)) if stop > start else None


def describe(
    plan: Plan,
    state: str,
    statistics: dict[str, Any],
    speeds: tuple[float, ...] | None,
    unicode: bool,
    chosen: Iterable[Any] = (),
) -> list[Any]:
    """Return the parts of the line in order.

    speeds : as `rates` returns it
    chosen : parts of the panel
    """
    seconds = (statistics["last_tick"] + 1) / plan["rate"]
    duration = plan["duration"]
    parts = [part(9, state, colour=STATES[state])]
    if duration:
        parts.append(part(3.2, bar(seconds / duration, unicode), "", joined=True))
    parts.append(part(8, f"{seconds:.1f}/{duration:g} s" if duration else f"{seconds:.1f} s", joined=True))
    parts += chosen
    if speeds is not None:
        ticks, load, frames, *each = speeds
        if plan["virtual"]:
            times = f"{ticks / plan['rate']:.0f}"
            parts.append(part(7, f"{times} times real time", f"{times}×"))
        else:
            parts.append(part(7, f"{ticks:.1f} Hz", f"{ticks:.0f} Hz"))
            late = statistics["lateness"]
            if "p99" in late:
                parts.append(
                    part(4, f"late {both(late['p50'], late['p99'])}", f"late {both(late['p50'], late['p99'], 1)}")
                )
            high = load > HIGH_LOAD
            parts.append(
                part(
                    7.4 if high else 3,
                    f"load {100 * load:.1f} %",
                    f"load {100 * load:.0f} %",
                    colour="red" if high else None,
                )
            )
        if plan["buses"]:
            parts += traffic(plan, ticks / plan["rate"] if plan["virtual"] else 1.0, frames, each)
    lost = [(word, statistics[word]) for word in ("missed", "dropped")]
    if not any(count for _, count in lost):
        return [*parts, part(6, "missed 0", "lost 0"), part(6, "dropped 0", "")]
    return parts + [
        part(7.5, f"{word} {count}", colour="red") if count else part(6, f"{word} 0", "") for word, count in lost
    ]


def traffic(plan: Plan, pace: float, frames: float, each: Sequence[float]) -> list[Any]:
    """Return the parts of the buses. pace : s of the run per second; each : frames/s of every bus, then bits/s"""
    parts = []
    for place, (name, speed) in enumerate(zip(plan["buses"], each)):
        bitrate = plan.get("bitrates", {}).get(name)
        if bitrate is None:
            parts.append(part(2 - 0.01 * place, f"{name} {speed:.0f} frames/s", f"{name} {speed:.0f}/s"))
        elif pace > 0.0:
            share = each[len(plan["buses"]) + place] / pace / bitrate
            high = share > HIGH_LOAD
            parts.append(
                part(
                    (7.3 if high else 2) - 0.01 * place,
                    f"{name} {100 * share:.0f} % full",
                    f"{name} {100 * share:.0f} %",
                    colour="red" if high else None,
                )
            )
    return parts or [part(2, f"{frames:.0f} frames/s", f"{frames:.0f}/s")]


def both(median: float, high: float, digits: int = 2) -> str:
    """Return two durations in s as text in µs or ms. digits : decimal places of the value in ms"""
    return (
        f"{median * 1e6:.0f}/{high * 1e6:.0f} µs" if high < 1e-3 else f"{median * 1e3:.2f}/{high * 1e3:.{digits}f} ms"
    )
