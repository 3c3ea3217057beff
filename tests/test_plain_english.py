"""Plain English in pages, docstrings, comments and messages: phrases of the old voice do not return."""

import ast
import io
import re
import tokenize
from pathlib import Path

import pytest

from tests.docs.pages import NAMES

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
    r"goes on": "continues",
    r"as good as": "equivalent to, with the same effect as",
    r"for good": "permanently",
    r"left alone": "is not changed, is ignored",
    r"what there is": "name the things",
    r"easily confused": "similar",
    r"whom": "name the component",
    r"taken? away": "remove, subtract",
    r"takes away": "removes, subtracts",
    r"gives? back": "releases, returns, restores",
    r"power goes": "the power is removed, power-off",
    r"look with": "run",
    r"stands? alone": "cannot be combined",
    r"falls? silent|fell silent": "times out, stops replying",
    r"(?:is|are) wanted": "expected, required",
    r"(?:is|are) meant": "is intended",
    r"none of it": "name the things",
    r"(?:µs|ms|ns|numbers?) a (?:tick|block|frame)": "per tick, per block",
    r"ground floor": "name the package",
    r"(?<!there )(?:is|are|was|were) no (?!longer\b)\w+": "is not a ..., is not ..., does not ...",
}
ALLOWED = {  # (file, text of the line): reason
    ("docs/how_to/subjects_data.md", "A recording of a person is personal data"): "the legal term",
    ("docs/how_to/subjects_data.md", "A gait pattern can identify a person"): "the legal term",
}
BANNED_IN_NAMES = re.compile(  # a test's name states the behaviour: its subject is a component
    r"def (test_(?:(?:what|whatever|whoever|it|its|so|those)_\w*"
    r"|(?:\w*_)?(?:tells?|told|hears?|heard|somebody|nobody|says?|comes_back|anew|whoever)(?:_\w*)?))\("
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
    text = path.read_text().lower()
    if path.suffix == ".py":  # without the seams of literals, whose parts are one text to the parser
        text = re.sub(r"""["']\s+[bfru]*["']""", "", text).replace("\\n", " ")
    banned = {phrase: instead for phrase, instead in INSTEAD.items() if re.search(phrase, text)}  # in lower case
    lines = list(lines_of(path)) if banned else []  # only then: the tokenizer is slow
    return [
        f"{name}:{number}: {match[0]!r} in {line.strip()[:80]!r}. Use instead: {instead}"
        for number, line in lines
        if not any(name == file and text in line for file, text in ALLOWED)
        for phrase, instead in banned.items()
        if (match := re.search(rf"\b(?:{phrase})\b", line.lower()))
    ]


def files_of(package):
    paths = [path for suffix in ("py", "pyx", "pxd") for path in (ROOT / package).rglob(f"*.{suffix}")]
    return sorted(paths)


def test_pages_contain_no_banned_phrase():
    banned = [line for page in [*NAMES, "Makefile"] for line in findings(ROOT / page)]
    assert not banned, "\n" + "\n".join(banned)


@pytest.mark.parametrize("package", PACKAGES)
def test_docstrings_comments_and_messages_contain_no_banned_phrase(package):
    banned = [line for path in files_of(package) for line in findings(path)]
    assert not banned, "\n" + "\n".join(banned)


def test_names_of_tests_contain_no_banned_word():
    named = [
        f"{path.relative_to(ROOT)}: {name}"
        for path in sorted((ROOT / "tests").rglob("test_*.py"))
        for name in BANNED_IN_NAMES.findall(path.read_text())
    ]
    assert not named, "\n" + "\n".join(named)


def test_a_banned_phrase_is_reported_with_its_line_and_a_replacement(tmp_path, monkeypatch):
    monkeypatch.setitem(globals(), "ROOT", tmp_path)
    (tmp_path / "module.py").write_text(
        'x = 1\nprint(f"nobody hears {x}")  # told\nprint("a\\nlikewise for "\n    "ever")\n'
    )
    assert [line.split(" in ")[0] for line in findings(tmp_path / "module.py")] == [
        "module.py:2: 'nobody'",
        "module.py:2: 'hears'",
        "module.py:4: 'for ever'",
        "module.py:4: 'likewise'",
    ]
