"""Plain English in pages, docstrings, comments and messages: phrases of the old voice do not return."""

import ast
import io
import re
import tokenize
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("blocks", "cext", "diagrams", "graph", "runtime")

INSTEAD = {  # banned phrase: wording to use instead
    r"(?:is|are|was|were) told": "receives, is set to, is reported",
    r"(?<!tt)tells": "reports, returns, lists, prints",
    r"(?:some|no)body(?:'s)?": "the operator, another process, another controller; or the passive voice",
    r"stands? behind": "name the component: is connected to, is defined in, implements",
    r"what stands": "name the component",
    r"hears?|heard": "receives, listens on, detects",
    r"comes? back": "reconnects, returns, resumes, is enabled again",
    r"for ever": "continuously, indefinitely, in steady state",
    r"a person": "the operator, the wearer, the subject",
    r"likewise": "repeat the noun",
    r"let go of": "release, close",
    r"out of the ordinary": "problems",
    r"it is said": "name the source",
    r"the house": "the architecture, the packages",
    r"says? (?:so|that|what|which|how)": "reports, states, contains",
    r"is not there": "does not exist, is missing, is emulated",
    r"as it is sold": "as delivered",
    r"plays the": "emulates the",
    r"the way the (?:joint|motor) turns": "in the direction of the joint",
    r"anew": "again",
}
BANNED = {re.compile(rf"\b(?:{phrase})\b", re.IGNORECASE): words for phrase, words in INSTEAD.items()}
ALLOWED = {  # (file, text of the line): reason
    ("docs/subjects_data.md", "A recording of a person is personal data"): "the legal term",
    ("docs/subjects_data.md", "A gait pattern can identify a person"): "the legal term",
    ("docs/rigs.md", "bus that somebody else"): "titles of the codes in runtime/rig/errors.py",
}
OLD_VOICE = (  # folders and files that are not rewritten yet: remove them as soon as they pass
    "runtime/recording/",
)


def lines_of_code(path):
    """Return (line, text) of each string literal and comment of a Python module."""
    text = path.read_text()
    strings = [
        (node.lineno + number, line)
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
        for number, line in enumerate(node.value.split("\n"))
    ]
    comments = [
        (token.start[0], token.string)
        for token in tokenize.generate_tokens(io.StringIO(text).readline)
        if token.type == tokenize.COMMENT
    ]
    return sorted(strings + comments)


def lines_of(path):
    """Return (line, text) of all text for readers in a page or module."""
    return lines_of_code(path) if path.suffix == ".py" else enumerate(path.read_text().splitlines(), 1)


def findings(path):
    """Return `file:line: phrase` with the words to use instead, for each banned phrase in a file."""
    name = path.relative_to(ROOT).as_posix()
    return [
        f"{name}:{number}: {match[0]!r} in {line.strip()[:80]!r}. Use instead: {instead}"
        for number, line in lines_of(path)
        if not any(name == file and text in line for file, text in ALLOWED)
        for pattern, instead in BANNED.items()
        if (match := pattern.search(line))
    ]


def files_of(package):
    paths = [path for suffix in ("py", "pyx", "pxd") for path in (ROOT / package).rglob(f"*.{suffix}")]
    return sorted(path for path in paths if not path.relative_to(ROOT).as_posix().startswith(OLD_VOICE or ("\0",)))


@pytest.mark.parametrize("page", ["README.md", *sorted(f"docs/{path.name}" for path in (ROOT / "docs").glob("*.md"))])
def test_pages_contain_no_banned_phrase(page):
    banned = findings(ROOT / page)
    assert not banned, "\n" + "\n".join(banned)


@pytest.mark.parametrize("package", PACKAGES)
def test_docstrings_comments_and_messages_contain_no_banned_phrase(package):
    banned = [line for path in files_of(package) for line in findings(path)]
    assert not banned, "\n" + "\n".join(banned)


def test_a_banned_phrase_is_reported_with_its_line_and_a_replacement(tmp_path, monkeypatch):
    monkeypatch.setitem(globals(), "ROOT", tmp_path)
    (tmp_path / "module.py").write_text('x = 1\nprint(f"nobody hears {x}")  # told\n')
    assert [line.split(" in ")[0] for line in findings(tmp_path / "module.py")] == [
        "module.py:2: 'nobody'",
        "module.py:2: 'hears'",
    ]
