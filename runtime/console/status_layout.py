"""One line of a terminal, made of parts. Where it is narrow they are shortened, then set closer, then left out, the
least important first.
"""

from dataclasses import dataclass

from runtime.console.terminal import IN_ASCII

COLOURS = {"bold": "\x1b[1m", "green": "\x1b[32m", "yellow": "\x1b[33m", "red": "\x1b[31m"}
RESET = "\x1b[0m"
DOTS, CLOSE = (" | ", " · "), "  "  # between parts: in ASCII, in Unicode; where there is little room
BAR = 8  # characters
BAR_CHARACTERS = "━╌#."


@dataclass(frozen=True)
class Part:
    """
    importance : parts with the same one are shortened and left out together
    forms : from the longest to the shortest, each a text, or (text, colour) of each of its pieces; an empty one is not
        there
    colour : of what has none of its own
    joined : to the part before, by a space
    """

    importance: float
    forms: tuple
    colour: str | None = None
    joined: bool = False

    def pieces(self, form):
        chosen = self.forms[min(form, len(self.forms) - 1)]
        return ((chosen, self.colour),) if isinstance(chosen, str) else chosen


def part(importance, *forms, colour=None, joined=False):
    return Part(importance, forms, colour, joined)


def fit(parts, width, coloured, unicode, kept=frozenset()):
    """(one line of at most `width` characters, the steps of narrowing that it took). kept : steps that are taken
    anyhow
    """
    stages = narrowing(parts)
    taken = {stage for stage in stages if stage in kept}

    def line(steps):
        return compose(parts, steps, unicode)

    for stage in stages:
        if length(line(taken)) <= width:
            break
        taken.add(stage)
    for stage in reversed(stages):  # what a later step has made room for stays, the most important first
        if stage in taken and stage not in kept and length(line(taken - {stage})) <= width:
            taken.discard(stage)
    pieces = line(taken)
    text = "".join(piece for piece, _ in pieces)
    if coloured and len(text) <= width:
        text = "".join(f"{COLOURS[colour]}{piece}{RESET}" if colour else piece for piece, colour in pieces)
        return text, taken
    return text[: max(0, width)], taken


def length(line):
    return sum(len(text) for text, _ in line)


def narrowing(parts):
    """The steps, in their order: ("form", importance, number of the form), ("close",), ("without", importance)."""
    levels = sorted({part.importance for part in parts})
    longest = max((len(part.forms) for part in parts), default=1)
    shorter = [
        ("form", level, form)
        for form in range(1, longest)
        for level in levels
        if any(part.importance == level and len(part.forms) > form for part in parts)
    ]
    return [*shorter, ("close",), *(("without", level) for level in levels[:-1])]


def compose(parts, steps, unicode):
    """[(text, colour)] of a line after these steps."""
    forms = {}
    for _, level, form in (step for step in steps if step[0] == "form"):
        forms[level] = max(form, forms.get(level, 0))
    without = {step[1] for step in steps if step[0] == "without"}
    gap = CLOSE if ("close",) in steps else DOTS[unicode]
    line = []
    for part in parts:
        pieces = part.pieces(forms.get(part.importance, 0))
        if part.importance in without or not any(text for text, _ in pieces):
            continue
        if line:
            line.append((" " if part.joined else gap, None))
        line += pieces
    # here, as it may get longer by that
    return line if unicode else [(text.translate(IN_ASCII), colour) for text, colour in line]


def bar(share, unicode, width=BAR):
    done = min(width, max(0, int(share * width + 0.5)))
    full, rest = BAR_CHARACTERS[:2] if unicode else BAR_CHARACTERS[2:]
    return full * done + rest * (width - done)
