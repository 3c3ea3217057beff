"""Layout of a one-line status from parts of different importance.

A narrow line first shortens its parts, then reduces the gaps, then drops parts, the least important first.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

from runtime.host.console.terminal import IN_ASCII

COLOURS = {"bold": "\x1b[1m", "green": "\x1b[32m", "yellow": "\x1b[33m", "red": "\x1b[31m"}
RESET = "\x1b[0m"
DOTS, CLOSE = (" | ", " · "), "  "  # gap between parts: in ASCII and Unicode; in a narrow line
BAR = 8  # characters
BAR_CHARACTERS = "━╌#."

Piece: TypeAlias = "tuple[str, str | None]"  # text and colour


class Step(NamedTuple):
    """Narrowing step. kind : "form" for a shorter form, "close" for closer parts, "without" for omitted parts"""

    kind: str
    importance: float = 0.0
    form: int = 0


@dataclass(frozen=True)
class Part:
    """Part of a status line.

    importance : parts of the same importance are shortened and dropped together
    forms : forms from the longest to the shortest, each a text or a tuple of (text, colour); an empty form is not shown
    colour : default colour of its texts
    joined : separated from the part before by a space only
    """

    importance: float
    forms: tuple[str | Sequence[Piece], ...]
    colour: str | None = None
    joined: bool = False

    def pieces(self, form: int) -> Sequence[Piece]:
        """Return a form as pairs (text, colour), with the colour None for the terminal's own.

        form : number of the form; the shortest for a number that is too large
        """
        pieces = self.forms[min(form, len(self.forms) - 1)]
        return ((pieces, self.colour),) if isinstance(pieces, str) else pieces


def part(importance: float, *forms: str | Sequence[Piece], colour: str | None = None, joined: bool = False) -> Part:
    """Return a Part. forms : forms from the longest to the shortest"""
    return Part(importance, forms, colour, joined)


def fit(
    parts: Sequence[Part], width: int, coloured: bool, unicode: bool, kept: frozenset[Step] = frozenset()
) -> tuple[str, set[Step]]:
    """Return (line of at most `width` characters, set of the narrowing steps applied).

    coloured, unicode : use colours, characters beyond ASCII
    kept : steps to apply in any case
    """
    stages = narrowing(parts)
    taken = {stage for stage in stages if stage in kept}

    def line(steps: Collection[Step]) -> list[Piece]:
        return compose(parts, steps, unicode)

    for stage in stages:
        if length(line(taken)) <= width:
            break
        taken.add(stage)
    for stage in reversed(stages):  # undo steps that a later one has made unnecessary, the most important first
        if stage in taken and stage not in kept and length(line(taken - {stage})) <= width:
            taken.discard(stage)
    pieces = line(taken)
    text = "".join(piece for piece, _ in pieces)
    if coloured and len(text) <= width:
        text = "".join(f"{COLOURS[colour]}{piece}{RESET}" if colour else piece for piece, colour in pieces)
        return text, taken
    return text[: max(0, width)], taken


def length(line: Sequence[Piece]) -> int:
    """Return the characters in a line."""
    return sum(len(text) for text, _ in line)


def narrowing(parts: Sequence[Part]) -> list[Step]:
    """Return all narrowing steps in order."""
    levels = sorted({part.importance for part in parts})
    longest = max((len(part.forms) for part in parts), default=1)
    shorter = [
        Step("form", level, form)
        for form in range(1, longest)
        for level in levels
        if any(part.importance == level and len(part.forms) > form for part in parts)
    ]
    return [*shorter, Step("close"), *(Step("without", level) for level in levels[:-1])]


def compose(parts: Sequence[Part], steps: Collection[Step], unicode: bool) -> list[Piece]:
    """Return a line after narrowing steps, as a list of (text, colour)."""
    forms: dict[float, int] = {}
    for step in steps:
        if step.kind == "form":
            forms[step.importance] = max(step.form, forms.get(step.importance, 0))
    without = {step.importance for step in steps if step.kind == "without"}
    gap = CLOSE if Step("close") in steps else DOTS[unicode]
    line: list[Piece] = []
    for part in parts:
        pieces = part.pieces(forms.get(part.importance, 0))
        if part.importance in without or not any(text for text, _ in pieces):
            continue
        if line:
            line.append((" " if part.joined else gap, None))
        line += pieces
    # before the length is measured, as ASCII replacements may be longer
    return line if unicode else [(text.translate(IN_ASCII), colour) for text, colour in line]


def bar(share: float, unicode: bool, width: int = BAR) -> str:
    """Return a progress bar. share : 0 to 1; width : characters"""
    done = min(width, max(0, int(share * width + 0.5)))
    full, rest = BAR_CHARACTERS[:2] if unicode else BAR_CHARACTERS[2:]
    return full * done + rest * (width - done)
