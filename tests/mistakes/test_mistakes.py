"""Mistakes of a diagram's author: each message names the line and the remedy, and the remedy works."""

import re
import sys

import pytest

from graph import DiagramError
from graph.signal_misuse import NUMPY, OPERATORS
from runtime import run
from runtime.base.errors import BadInput
from tests.mistakes.table import MISTAKES

DURATION = 0.02  # s


@pytest.fixture
def diagram_file(tmp_path, monkeypatch):
    """Function that writes a diagram file and returns its path; its modules are forgotten after the test."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.delitem(sys.modules, "knee", raising=False)

    def write(text):
        path = tmp_path / "knee.py"
        path.write_text(text)
        return path

    yield write
    sys.modules.pop("knee", None)


def report(path):
    """Return what is reported of a diagram file that does not run to its end."""
    try:
        trial = run(path, DURATION)
    except (BadInput, DiagramError) as error:
        return str(error)
    assert trial.fault is not None, "the file runs"
    return "\n".join(trial.fault["report"])


@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda mistake: mistake.name)
def test_mistake_is_reported_with_its_line_and_a_remedy_that_works(mistake, diagram_file):
    said = report(diagram_file(mistake.wrong))
    position = 0
    for part in mistake.message:
        assert part in said[position:], said
        position = said.index(part, position)
    marked = [number for number, line in enumerate(mistake.wrong.splitlines(), 1) if line.endswith("# !")]
    assert all(f"knee.py:{number}" in said for number in marked), said
    assert run(diagram_file(mistake.right), DURATION).fault is None


def test_every_block_that_a_message_names_exists():
    remedies = [*(remedy for _, remedy in OPERATORS.values()), *NUMPY.values()]
    named = [
        (name, module)
        for remedy in remedies
        for names, module in re.findall(
            r"((?:[A-Z]\w+(?:\(\S+\))?(?:, | and | or |\b)?)+) \((?:both )?from (\S+?)\)", remedy
        )
        for name in re.findall(r"\b[A-Z]\w+", names)
    ]
    assert len(set(named)) > 15
    for name, module in named:
        __import__(module)
        assert hasattr(sys.modules[module], name), (name, module)
