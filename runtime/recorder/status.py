"""The status line: how the run is doing, refreshed in place ten times a second while it runs on a terminal.

    running ━━━━╌╌╌╌ 5.3/10 s · 200.0 Hz · late 61/240 µs · load 3.1 % · legs 21 % full · missed 0 · dropped 0 · left/knee ━━╌╌ −4.5 N·m

What the keys have chosen stands behind the time. A bar is a torque's share of its limit. Lateness is the median and the 99th percentile of the run so far; rate, load and
what is on the buses are those of the last second: of CAN the share of its bits that frames take, of others their frames.
"""

from collections import deque

REFRESH = 0.1                   # s
WINDOW = 10                     # refreshes over which rates are taken
BAR = 8                         # characters
BAR_CHARACTERS = "━╌#."
TORQUE_BAR = 4                  # characters
HIGH_LOAD, HIGH_TORQUE = 0.8, 0.95      # share of the time in ticks; of the limit
COLOURS = {"bold": "\x1b[1m", "green": "\x1b[32m", "yellow": "\x1b[33m", "red": "\x1b[31m"}
RESET = "\x1b[0m"
STATES = {"running": "green", "safe": "green", "init": "yellow", "arming": "yellow", "stopping": "yellow", "ready": "yellow", "waiting": "red"}


class StatusLine:
    def __init__(self, terminal, plan, page, panel=None, recording=None):
        self.terminal, self.plan, self.page, self.panel, self.recording = terminal, plan, page, panel, recording
        self.torques = torques_of(plan)
        self.enabled = plan["status_line"] and terminal.interactive
        self.next = 0.0
        self.history = deque(maxlen=WINDOW + 1)

    def update(self, now):
        """Redraw if it is time. now : s, of any steady clock"""
        if not self.enabled or now < self.next:
            return
        self.next = now + REFRESH
        statistics = self.page.statistics()
        frames = statistics["frames"]["sent"] + statistics["frames"]["received"]
        buses = (*self.recording.traffic, *self.recording.bits) if self.recording is not None else ()
        self.history.append((now, statistics["ticks"], statistics["busy"], frames, *buses))
        parts = describe(self.plan, self.page.state, statistics, rates(self.history), self.terminal.unicode,
                         [] if self.panel is None else self.panel.parts(now))
        if self.recording is not None and self.recording.newest is not None:
            parts += torque_parts(self.torques, self.recording.newest, self.terminal.unicode)
        self.terminal.draw(fit(parts, self.terminal.columns - 1, self.terminal.coloured, self.terminal.unicode))

    def erase(self):
        self.terminal.erase()


def torques_of(plan):
    """[(name of the actuator, place in the recorded row, limit)] of a run whose plan says what their limits are."""
    limits = {path: max(map(abs, ends)) for path, ends in plan.get("limits", {}).items() if path.endswith(".torque")}
    return [(signal["path"].removesuffix(".torque"), 2 + place, limits[signal["path"]]) for place, signal in enumerate(plan["signals"])
            if limits.get(signal["path"])]


def torque_parts(torques, row, unicode):
    """Parts of the line. row : tick, lateness, values"""
    parts = []
    for number, (name, place, limit) in enumerate(torques):
        torque, share = row[place], abs(row[place]) / limit
        if share == share:                      # a NaN is a fault, and told as one
            text = f"{name} {bar(share, unicode, TORQUE_BAR)} {torque:.1f} N·m"
            parts.append((3.5 - 0.01 * number, text.replace("-", "−") if unicode else text, "red" if share > HIGH_TORQUE else None))
    return parts


def rates(history):
    """(ticks/s, share of the time spent in ticks, frames/s, those of each bus, its bits/s) over the window, or None while there is too little of it."""
    (start, *first), (stop, *last) = history[0], history[-1]
    return tuple((b - a) / (stop - start) for a, b in zip(first, last)) if stop > start else None


def describe(plan, state, statistics, speeds, unicode, chosen=()):
    """The parts of the line, in their order: (importance, text, colour). Where the line is narrow, the least important go first.

    chosen : parts of the panel
    """
    seconds = (statistics["last_tick"] + 1) / plan["rate"]
    duration = plan["duration"]
    parts = [(9, state, STATES[state])]
    if duration:
        parts.append((5, bar(seconds / duration, unicode), None))
    parts.append((8, f"{seconds:.1f}/{duration:g} s" if duration else f"{seconds:.1f} s", None))
    parts += chosen
    if speeds is not None:
        ticks, load, frames, *each = speeds
        if plan["virtual"]:
            parts.append((7, f"{ticks / plan['rate']:.0f} times real time", None))
        else:
            parts.append((7, f"{ticks:.1f} Hz", None))
            late = statistics["lateness"]
            if "p99" in late:
                parts.append((4, f"late {both(late['p50'], late['p99'])}", None))
            parts.append((3, f"load {100 * load:.1f} %", "red" if load > HIGH_LOAD else None))
        if plan["buses"]:
            parts += traffic(plan, ticks / plan["rate"] if plan["virtual"] else 1.0, frames, each)
    for word in ("missed", "dropped"):
        count = statistics[word]
        parts.append((7.5 if count else 6, f"{word} {count}", "red" if count else None))
    return parts


def traffic(plan, pace, frames, each):
    """Parts of the line about the buses. pace : s of the run in a second; each : frames/s of every bus, then bits/s"""
    parts = []
    for place, (name, speed) in enumerate(zip(plan["buses"], each)):
        bitrate = plan.get("bitrates", {}).get(name)
        if bitrate is None:
            parts.append((2 - 0.01 * place, f"{name} {speed:.0f} frames/s", None))
        elif pace > 0.0:
            share = each[len(plan["buses"]) + place] / pace / bitrate
            parts.append((2 - 0.01 * place, f"{name} {100 * share:.0f} % full", "red" if share > HIGH_LOAD else None))
    return parts or [(2, f"{frames:.0f} frames/s", None)]


def bar(share, unicode, width=BAR):
    done = min(width, max(0, int(share * width + 0.5)))
    full, rest = BAR_CHARACTERS[:2] if unicode else BAR_CHARACTERS[2:]
    return full * done + rest * (width - done)


def both(median, high):
    return f"{median * 1e6:.0f}/{high * 1e6:.0f} µs" if high < 1e-3 else f"{median * 1e3:.2f}/{high * 1e3:.2f} ms"


def fit(parts, width, coloured, unicode):
    """One line of at most `width` characters."""
    dot = " · " if unicode else " | "
    parts = list(parts)

    def line(paint):
        text = ""
        for index, (_, part, colour) in enumerate(parts):
            beside_bar = index > 0 and {part[0], parts[index - 1][1][0]} & set(BAR_CHARACTERS)
            text += ("" if index == 0 else " " if beside_bar else dot) + (f"{COLOURS[colour]}{part}{RESET}" if paint and colour else part)
        return text if unicode else text.replace("µ", "u").replace("·", "*")

    while len(line(False)) > width and len(parts) > 1:
        parts.remove(min(parts, key=lambda part: part[0]))
    return line(coloured) if len(line(False)) <= width else line(False)[:max(0, width)]
