"""Type checking of diagrams: fresh stubs, and a user's mistakes reported by pyright and mypy."""

import importlib
import json
import subprocess
import sys
from pathlib import Path

import pytest

from graph import stubs
from tests.checkout import PACKAGES, ROOT
from tests.soaking import soaked

USER = ROOT / "tests" / "graph" / "types" / "user_robot.py"
ROBOTS = sorted((ROOT / "diagrams").glob("*.py"))
MODULES = dict(stubs.modules([str(ROOT / "blocks"), str(ROOT / "graph" / "arithmetic.py")]))
CHECKERS = {
    "pyright": ["--pythonpath", sys.executable, "--outputjson"],
    "mypy": ["--follow-imports=silent", "--output=json"],
}


def in_tree(path):
    return ".".join(path.relative_to(ROOT).with_suffix("").parts)


@pytest.mark.soak
@pytest.mark.parametrize("path", MODULES.values(), ids=in_tree)
def test_the_stub_of_a_module_is_fresh(path):
    module, target = importlib.import_module(in_tree(path)), path.with_suffix(".pyi")
    expected = stubs.stub(module) if stubs.has_blocks(module) else None
    assert (target.read_text() if target.exists() else None) == expected, "run `make build`"


def test_every_package_is_marked_as_typed():
    assert all((ROOT / room / "py.typed").exists() for room in PACKAGES)


@pytest.fixture(scope="module", params=soaked(CHECKERS, but=[0]))
def errors(request):
    """(path, line) of every error that a type checker reports in the user's file and the robots of this tree."""
    pytest.importorskip(request.param)
    cache = ["--cache-dir", ROOT / "build" / "mypy"] if request.param == "mypy" else []
    command = [sys.executable, "-m", request.param, *CHECKERS[request.param], *cache, USER, *ROBOTS]
    process = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert process.returncode == 1, process.stdout + process.stderr
    if request.param == "pyright":
        reports = json.loads(process.stdout)["generalDiagnostics"]
        return {(Path(r["file"]), r["range"]["start"]["line"] + 1): r for r in reports if r["severity"] == "error"}
    reports = [json.loads(line) for line in process.stdout.splitlines() if line.startswith("{")]
    return {(ROOT / r["file"], r["line"]): r for r in reports if r["severity"] == "error"}


def test_type_checkers_report_the_mistakes_of_a_user_and_nothing_else(errors):
    lines = enumerate(USER.read_text().splitlines(), 1)
    wrong = [(USER, number) for number, line in lines if "  # wrong: " in line]
    assert len(wrong) == 18
    assert sorted(errors) == wrong, errors
