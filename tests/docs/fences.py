"""Fenced blocks of a page: files to save, commands, and their output."""

import math
import re
from dataclasses import dataclass

FENCE = re.compile(r"(?P<before>[^\n]*)\n\n```(?P<language>\w*)[^\n]*\n(?P<text>.*?)^```$", re.DOTALL | re.MULTILINE)
NUMBER = re.compile(r"[-−+]?\d+(?:[.\d]|e[+-]\d)*")
DATE = re.compile(r"\d{4}-\d\d-\d\d(?:_\d\d-\d\d-\d\d)?")
MACHINE = re.compile(r"\s*(?:speed|fused|rate|late by|load)\b")  # first words of lines about the machine
SAVED = re.compile(r"Save\s+this\s+as\s+`([\w.]+)`[^`]*:$")


@dataclass(frozen=True)
class Fence:
    """One fenced block.

    language : language in the first line, "" if it has none
    text : content, with a newline at its end
    file : name under which the page asks to save it, or ""
    """

    language: str
    text: str
    file: str

    def commands(self):
        """Return [(words of a command, lines of its output)] of a console block."""
        parts = [part.splitlines() for part in ("\n" + self.text).split("\n$ ")[1:]]
        return [(line.split("#")[0].split(), output) for line, *output in parts]


def fences(path):
    """Return the fenced blocks of a page, in order."""
    page, found = path.read_text(), []
    for match in FENCE.finditer(page):
        saved = SAVED.search(page[: match.end("before")].rpartition("\n\n")[2])
        found.append(Fence(match["language"], match["text"], saved[1] if saved else ""))
    return found


def without_numbers(lines):
    """Return lines with numbers, their units of time and the width they take left open."""
    return [re.sub(r"\s+", " ", NUMBER.sub("#", line)).replace("µs", "s").replace("ms", "s") for line in lines]


def same_text(shown, printed):
    """Return whether two lines have one text without numbers. "..." at the end of the shown one is any text."""
    shown, printed = without_numbers([shown, printed])
    start = shown.removesuffix(" ...")
    return shown == printed or start != shown and printed.startswith(start)


def agree(shown, printed):
    """Return whether a printed line is the shown one: integers exactly, other numbers within 2 % or their last digit.

    Dates are left open, and so are all numbers of lines about the speed of the machine.
    """
    if not same_text(shown, printed):
        return False
    texts = [[] if MACHINE.match(line) else NUMBER.findall(DATE.sub("", line)) for line in (shown, printed)]
    for pair in zip(*texts):
        value, other = (float(text.replace("−", "-")) for text in pair)
        digits = max(len(text.partition(".")[2]) for text in pair)
        near = math.isclose(value, other, rel_tol=0.02, abs_tol=1.01 * 10**-digits)
        if not near or digits == 0 and value != other:
            return False
    return True


def texts(picture):
    """Return the texts of an SVG, without numbers. Matplotlib writes them as text, or as comments beside outlines."""
    content = re.sub(r"<(style|title|metadata)\b.*?</\1>", "", picture.read_text(), flags=re.DOTALL)
    found = re.findall(r"<!-- (.*?) -->|<text\b[^>]*>(.*?)</text>", content, re.DOTALL)
    return set(without_numbers(re.sub(r"<[^>]*>", "", comment or text) for comment, text in found))
