"""The status line: how the run is doing, refreshed in place ten times a second while it runs on a terminal.

    running ━━━━━━━━╸─────── 5.3/10 s · 200.0 Hz · late 61 µs, p99 240 µs · load 3 % · 1600 frames/s · missed 0 · dropped 0
"""

from collections import deque

REFRESH = 0.1                   # s
WINDOW = 10                     # refreshes over which rates are taken
BAR = 16                        # characters
COLOURS = {"green": "\x1b[32m", "yellow": "\x1b[33m", "red": "\x1b[31m", "dim": "\x1b[2m", None: ""}
STATES = {"running": "green", "safe": "green", "init": "yellow", "arming": "yellow", "stopping": "yellow"}


class StatusLine:
    def __init__(self, terminal, plan, page):
        self.terminal, self.plan, self.page = terminal, plan, page
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
        self.history.append((now, statistics["ticks"], statistics["busy"], frames))
        parts = describe(self.plan, self.page.state, statistics, rates(self.history), self.terminal.unicode)
        self.terminal.draw(fit(parts, self.terminal.columns - 1, self.terminal.coloured, self.terminal.unicode))

    def erase(self):
        self.terminal.erase()


def rates(history):
    """(ticks/s, share of the time spent in ticks, frames/s) over the window, or None while there is too little of it."""
    (start, *first), (stop, *last) = history[0], history[-1]
    return tuple((b - a) / (stop - start) for a, b in zip(first, last)) if stop > start else None


def describe(plan, state, statistics, speeds, unicode):
    """The parts of the line, in their order: (importance, text, colour). Where the line is narrow, the least important go first."""
    seconds = (statistics["last_tick"] + 1) / plan["rate"]
    duration = plan["duration"]
    parts = [(9, state, STATES[state])]
    if duration:
        parts.append((4, bar(seconds / duration, unicode), None))
        parts.append((8, f"{seconds:.1f}/{duration:g} s", None))
    else:
        parts.append((8, f"{seconds:.1f} s", None))
    if speeds is not None:
        ticks, load, frames = speeds
        if plan["virtual"]:
            parts.append((7, f"{ticks / plan['rate']:.0f} times real time", None))
        else:
            parts.append((7, f"{ticks:.1f} Hz", None))
            late = statistics["lateness"]
            if "p99" in late:
                parts.append((5, f"late {short(late['p50'])}, p99 {short(late['p99'])}", None))
            parts.append((3, f"load {100 * load:.1f} %", "red" if load > 0.8 else None))
        if plan["buses"]:
            parts.append((2, f"{frames:.0f} frames/s", None))
    for word, importance in (("missed", 6), ("dropped", 6)):
        count = statistics[word]
        parts.append((importance + (count > 0), f"{word} {count}", "red" if count else None))
    return parts


def bar(share, unicode):
    done = min(BAR, max(0, int(share * BAR + 0.5)))
    return "━" * done + "╌" * (BAR - done) if unicode else "#" * done + "." * (BAR - done)


def short(seconds):
    return f"{seconds * 1e6:.0f} µs" if seconds < 1e-3 else f"{seconds * 1e3:.1f} ms"


def fit(parts, width, coloured, unicode):
    """One line of at most `width` characters."""
    separator = " · " if unicode else " | "
    parts = list(parts)
    while len(parts) > 1 and sum(len(text) + len(separator) for _, text, _ in parts) - len(separator) > width:
        parts.remove(min(parts, key=lambda part: part[0]))
    texts = [f"{COLOURS[colour]}{text}\x1b[0m" if coloured and colour else text for _, text, colour in parts]
    if len(parts) == 1:
        return parts[0][1][:max(0, width)]
    line = separator.join(texts)
    return line if unicode else line.replace("µ", "u")
