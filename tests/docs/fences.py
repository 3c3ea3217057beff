"""Fenced blocks of a page: files to save, commands, and their output."""

import re
from dataclasses import dataclass

FENCE = re.compile(r"(?P<before>[^\n]*)\n\n```(?P<language>\w*)[^\n]*\n(?P<text>.*?)^```$", re.DOTALL | re.MULTILINE)
SAVED = re.compile(r"Save\s+this\s+as\s+`([\w.]+)`[^`]*:$")


@dataclass(frozen=True)
class Fence:
    """One fenced block.

    language : of its first line, "" if it has none
    text : with a newline at its end
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
    return [
        re.sub(r"\s+", " ", re.sub(r"[-−+]?\d+(?:[.\d]|e[+-]\d)*", "#", line)).replace("µs", "s").replace("ms", "s")
        for line in lines
    ]


def texts(picture):
    """Return the texts of an SVG, without numbers. Matplotlib writes them as text, or as comments beside outlines."""
    content = re.sub(r"<(style|title|metadata)\b.*?</\1>", "", picture.read_text(), flags=re.DOTALL)
    found = re.findall(r"<!-- (.*?) -->|<text\b[^>]*>(.*?)</text>", content, re.DOTALL)
    return set(without_numbers(re.sub(r"<[^>]*>", "", comment or text) for comment, text in found))
