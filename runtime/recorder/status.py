"""The status line: how the run is doing, refreshed in place ten times a second while it runs on a terminal.

    running ━━━━╌╌╌╌ 5.3/10 s · 200.0 Hz · late 61/240 µs · load 3.1 % · legs 21 % full · missed 0 · dropped 0 ·
    left/knee ━━╌╌  −4.5 N·m running 5.3/10 s  200.0 Hz  late 61/240 µs  load 3.1 %  legs 21 %  lost 0  τ ▃▁

The second is what 80 columns have room for. What the keys have chosen stands behind the time. A bar is a torque's share
of its limit. Lateness is the median and the 99th percentile of the run so far; rate, load and what is on the buses are
those of the last second: of CAN the share of its bits that frames take, of others their frames.
"""

from collections import deque

from runtime.console.status_layout import bar, fit, part

REFRESH = 0.1  # s
WINDOW = 10  # refreshes over which rates are taken
STEADY = 30  # refreshes for which there was more room before the line takes it, so that it does not flicker
TORQUE_BAR = 4  # characters
LEVELS = ".:-=+*#@", "▁▂▃▄▅▆▇█"  # of a torque where there is room for one character
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
    def __init__(self, terminal, plan, page, panel=None, recording=None):
        self.terminal, self.plan, self.page, self.panel, self.recording = terminal, plan, page, panel, recording
        self.torques = torques_of(plan)
        self.enabled = plan["status_line"] and terminal.interactive
        self.next = 0.0
        self.history, self.state = deque(maxlen=WINDOW + 1), None  # of the present state alone
        # by which steps the newest lines were; on how many columns
        self.narrowed, self.columns = deque(maxlen=STEADY), None

    def update(self, now):
        """Redraw if it is time. now : s, of any steady clock"""
        if not self.enabled or now < self.next:
            return
        self.next = now + REFRESH
        statistics = self.page.statistics()
        frames = statistics["frames"]["sent"] + statistics["frames"]["received"]
        if self.page.state != self.state:  # arming has other rates than running
            self.state = self.page.state
            self.history.clear()
        buses = (*self.recording.traffic, *self.recording.bits) if self.recording is not None else ()
        self.history.append((now, statistics["ticks"], statistics["busy"], frames, *buses))
        parts = describe(
            self.plan,
            self.page.state,
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
        self.narrowed.append(fit(*line)[1])
        self.terminal.draw(fit(*line, kept=frozenset().union(*self.narrowed))[0])

    def erase(self):
        self.terminal.erase()


def torques_of(plan):
    """[(name of the actuator, place in the recorded row, limit)] of a run whose plan says what their limits are."""
    limits = {path: max(map(abs, ends)) for path, ends in plan.get("limits", {}).items() if path.endswith(".torque")}
    return [
        (signal["path"].removesuffix(".torque"), 2 + place, limits[signal["path"]])
        for place, signal in enumerate(plan["signals"])
        if limits.get(signal["path"])
    ]


def torque_part(torques, row, unicode):
    """The part of the line about the torques, in a list; none where there are none. row : tick, lateness, values"""
    long, middle, shares = [], [], []
    for name, place, limit in torques:
        torque, share = row[place], abs(row[place]) / limit
        colour = "red" if share > HIGH_TORQUE else None
        if share != share:  # a NaN is a fault, and told as one
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


def rates(history):
    """(ticks/s, share of the time spent in ticks, frames/s, those of each bus, its bits/s) over the window, or None
    while there is too little of it.
    """
    (start, *first), (stop, *last) = history[0], history[-1]
    return tuple((b - a) / (stop - start) for a, b in zip(first, last)) if stop > start else None


def describe(plan, state, statistics, speeds, unicode, chosen=()):
    """The parts of the line, in their order.

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


def traffic(plan, pace, frames, each):
    """Parts of the line about the buses. pace : s of the run in a second; each : frames/s of every bus, then bits/s"""
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


def both(median, high, digits=2):
    return (
        f"{median * 1e6:.0f}/{high * 1e6:.0f} µs" if high < 1e-3 else f"{median * 1e3:.2f}/{high * 1e3:.{digits}f} ms"
    )
