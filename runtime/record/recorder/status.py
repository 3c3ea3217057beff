"""The status line of a run on a terminal, refreshed ten times a second.

    running ━━━━╌╌╌╌ 5.3/10 s · space stops · REC exo.mcap · 200.0 Hz · late 61/240 µs · load 3.1 % · legs 21 % full ·
    missed 0 · dropped 0 · strides 4/5 · 41 °C · left/knee ━━╌╌  −4.5 N·m  31°

    running 5.3/10 s  space stops  REC  200 Hz  legs 21 %  lost 0  41 °C  τ −4.5 N·m

The second form fits 80 columns. The parameter selected with the keys follows the time. A bar is the share of the torque
limit; strides are counted for each leg; the temperature is that of the hottest drive. Lateness is the median and the
99th percentile since the start; rate, load and bus load are averages over the last second: for CAN the share of the
bitrate, for other buses frames per second.
"""

from __future__ import annotations

import math
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
        self.temperatures = [2 + place for place, signal in enumerate(plan["signals"]) if signal["unit"] == "°C"]
        self.strides = strides_of(plan)
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
            [*([] if self.panel is None else self.panel.parts(now)), recording_part(self.plan)],
        )
        if self.recording is not None and self.recording.newest is not None:
            parts += strides_part(self.strides, self.recording.newest)
            parts += temperature_part(self.temperatures, self.recording.newest)
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

    def complete(self, end: dict[str, Any] | None) -> None:
        """Draw how the run ended, until its summary follows: a picture of the strides takes a second or more.

        end : the last event of the run; None if its process has died
        """
        if not self.enabled or end is None:
            return
        unconfirmed = end.get("unconfirmed")
        if unconfirmed:
            stop = part(9.0, f"NOT STOPPED, as far as known: {', '.join(unconfirmed)}", "NOT STOPPED")
        elif unconfirmed is not None and self.torques:
            stop = part(9.0, "safe, stop confirmed", "safe")
        else:
            stop = part(9.0, "ended")
        saving = "completing the files" if self.plan["folder"] is not None else "ending"
        line = fit([stop, part(5, saving)], self.terminal.columns - 1, self.terminal.coloured, self.terminal.unicode)[0]
        self.terminal.draw(line)

    def erase(self) -> None:
        """Remove the line from the terminal."""
        self.terminal.erase()


def torques_of(plan: Plan) -> list[tuple[str, int, float, int | None]]:
    """Return [(name of the actuator, index of its torque in the recorded row, limit, index of its position)] of the
    actuators with known limits; None for a position that is not recorded or not an angle.
    """
    limits = {path: max(map(abs, ends)) for path, ends in plan.get("limits", {}).items() if path.endswith(".torque")}
    angles = {signal["path"]: 2 + place for place, signal in enumerate(plan["signals"]) if signal["unit"] == "rad"}
    names = [signal["path"].removesuffix(".torque") for signal in plan["signals"]]
    return [
        (name, 2 + place, limits[f"{name}.torque"], angles.get(f"{name}.position"))
        for place, name in enumerate(names)
        if limits.get(f"{name}.torque")
    ]


def strides_of(plan: Plan) -> list[int]:
    """Return the index of the number of strides in the recorded row: of the first one of each side."""
    first: dict[str, int] = {}
    for place, signal in enumerate(plan["signals"]):
        side, _, name = signal["path"].rpartition("/")
        if name.endswith(".strides"):
            first.setdefault(side.partition("/")[0], 2 + place)
    return list(first.values())


def strides_part(places: list[int], row: Sequence[float]) -> list[Any]:
    """Return a list with the part of the strides, empty without any. places : indices in the row"""
    return [part(4.9, f"strides {'/'.join(f'{row[place]:.0f}' for place in places)}")] if places else []


def temperature_part(places: list[int], row: Sequence[float]) -> list[Any]:
    """Return a list with the part of the highest temperature, empty without any. places : indices in the row"""
    values = [row[place] for place in places if row[place] == row[place]]
    return [part(5, f"{max(values):.0f} °C")] if values else []


def recording_part(plan: Plan) -> Any:
    """Return the part that shows whether, and in which file, the run is recorded."""
    return part(7.7, f"REC {plan['stem']}.mcap", "REC") if plan["folder"] is not None else part(7.7, "not recorded")


def torque_part(torques: list[tuple[str, int, float, int | None]], row: Sequence[float], unicode: bool) -> list[Any]:
    """Return a list with the part of the torques, empty without torques. row : tick, lateness, values"""
    long, named, short = [], [], []
    for name, place, limit, angle in torques:
        torque, share = row[place], abs(row[place]) / limit
        is_known = share == share  # NaN ends the run with a fault
        colour = None if share <= HIGH_TORQUE else "red"
        number = f"{round(torque, 1) + 0.0:{len(f'{-limit:.1f}')}.1f}".replace("-", "−" if unicode else "-")
        number, level = (number, bar(share, unicode, TORQUE_BAR)) if is_known else ("!", "!" * TORQUE_BAR)
        degrees = (
            "" if angle is None or row[angle] != row[angle] else f" {round(math.degrees(row[angle]), 0) + 0.0:.0f}°"
        )
        long += [(" · " if unicode else " | ", None), (f"{name} {level} {number} N·m{degrees}", colour)]
        named += [(", ", None), (f"{name} {number.strip()}", colour)]
        short += [(" ", None), (number.strip(), colour)]
    if not torques:
        return []
    unit = (" N·m", None)
    return [part(8.1, long[1:], [*named[1:], unit], [("τ" if unicode else "tau", None), *short, unit])]


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
    chosen : parts that follow the time
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
