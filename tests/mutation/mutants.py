"""Mutants of a source file: the same file with one small error in one of its functions. Lexical, so that Cython is no
different from Python.

    comparisons     < and <=, > and >=, == and != change places
    not             is left out;  `and` and `or` change places
    + and -         change places
    constants       one more
    statements      are left out
"""

import difflib
import re
from dataclasses import dataclass

SWAPS = (
    (r" < ", " <= "),
    (r" <= ", " < "),
    (r" > ", " >= "),
    (r" >= ", " > "),
    (r" == ", " != "),
    (r" != ", " == "),
    (r"\bnot (?!in\b)", ""),
    (r" is not None", " is None"),
    (r" and ", " or "),
    (r" or ", " and "),
    (r" \+ ", " - "),
    (r" - ", " + "),
    (r" \+= ", " -= "),
    (r" -= ", " += "),
    (r"\bTrue\b", "False"),
    (r"\bFalse\b", "True"),
    (r"\bmin\(", "max("),
    (r"\bmax\(", "min("),
)
NUMBER = re.compile(r"(?<![\w.\]])(\d+\.\d+|\d[\d_]*)(?![\w.])")
NO_STATEMENT = (
    "def ",
    "cdef ",
    "if ",
    "elif ",
    "else",
    "for ",
    "while ",
    "with ",
    "try",
    "except",
    "finally",
    "return",
    "pass",
    '"""',
    "@",
    "class ",
)
HIDDEN = re.compile(r'"""(?:.|\n)*?"""|"(?:[^"\\\n]|\\.)*"|\'(?:[^\'\\\n]|\\.)*\'|#[^\n]*')


@dataclass(frozen=True)
class Mutant:
    """file : its path from the root; function : where it is; line : from 1; before, after : of the line, without its
    indentation
    """

    file: str
    function: str
    line: int
    before: str
    after: str
    text: str

    @property
    def name(self):
        """What tells it from others, and survives changes elsewhere in its file."""
        return f"{self.file} {self.function}: {self.before} -> {self.after}"

    def diff(self, original):
        return "\n".join(
            difflib.unified_diff(
                original.splitlines(), self.text.splitlines(), f"{self.file}", f"{self.file}, mutant", lineterm="", n=2
            )
        )


def mutants(file, text, functions):
    """All of the named functions of a file. KeyError where one is not there."""
    found = []
    lines = text.split("\n")
    shown = HIDDEN.sub(lambda match: re.sub(r"[^\n]", "\0", match[0]), text).split("\n")
    for function in functions:
        begin, end = extent(shown, function)
        for index in range(begin, end):
            for changed in variants(shown[index], lines[index]):
                found.append(make(file, function, lines, index, index + 1, [changed]))
        for first, last in statements(shown, begin, end):
            indent = lines[first][: len(lines[first]) - len(lines[first].lstrip())]
            found.append(make(file, function, lines, first, last, [indent + "pass"]))
    return found


def extent(shown, function):
    """Lines of a function's body: [begin, end)."""
    for index, line in enumerate(shown):
        if re.search(rf"^\s*(c?p?def\b.*?\b){re.escape(function)}\(", line):
            indent = len(line) - len(line.lstrip())
            begin = (
                next(
                    later for later in range(index, len(shown)) if shown[later].replace("\0", "").rstrip().endswith(":")
                )
                + 1
            )
            end = next(
                (
                    later
                    for later in range(begin, len(shown))
                    if shown[later].strip(" \0") and len(shown[later]) - len(shown[later].lstrip()) <= indent
                ),
                len(shown),
            )
            return begin, end
    raise KeyError(function)


def variants(shown, line):
    """A line with one change each. What is hidden in `shown`, strings and comments, stays."""
    if shown.strip().startswith("cdef ") and "=" not in shown:
        return
    for pattern, replacement in SWAPS:
        for match in re.finditer(pattern, shown):
            yield line[: match.start()] + replacement + line[match.end() :]
    for match in NUMBER.finditer(shown):
        more = str(float(match[0]) + 1.0) if "." in match[0] else str(int(match[0]) + 1)
        yield line[: match.start()] + more + line[match.end() :]


def statements(shown, begin, end):
    """(first line, line behind the last) of each statement that may be left out."""
    index = begin
    while index < end:
        first, depth = index, 0
        while index < end:
            depth += sum(shown[index].count(bracket) for bracket in "([{") - sum(
                shown[index].count(bracket) for bracket in ")]}"
            )
            index += 1
            if depth <= 0:
                break
        words = shown[first].strip(" \0")
        if words and not words.startswith(NO_STATEMENT):
            yield first, index


def make(file, function, lines, first, last, instead):
    before, after = " ".join(line.strip() for line in lines[first:last]), " ".join(line.strip() for line in instead)
    return Mutant(file, function, first + 1, before, after, "\n".join(lines[:first] + instead + lines[last:]))
