"""Type checking of diagrams: fresh stubs, and a user's mistakes reported by pyright and mypy."""

import importlib
import json
import shutil
import sys
from pathlib import Path

import pytest

from graph import stubs
from tests.checkout import PACKAGES, ROOT, assert_one_line, python
from tests.soaking import soaked

USER = ROOT / "tests" / "graph" / "types" / "user_robot.py"
ROBOTS = sorted((ROOT / "diagrams").glob("*.py"))
MODULES = [*stubs.files(ROOT / "blocks"), ROOT / "graph" / "arithmetic.py"]
CHECKERS = {
    "pyright": ["--pythonpath", sys.executable, "--outputjson"],
    "mypy": ["--follow-imports=silent", "--output=json"],
}


def in_tree(path):
    return ".".join(path.relative_to(ROOT).with_suffix("").parts)


@pytest.mark.soak
@pytest.mark.parametrize("path", MODULES, ids=in_tree)
def test_the_stub_of_a_module_is_fresh(path):
    module, target = importlib.import_module(in_tree(path)), path.with_suffix(".pyi")
    expected = stubs.stub(module) if stubs.has_blocks(module) else None
    assert (target.read_text() if target.exists() else None) == expected, "run `make build`"


def test_every_package_is_marked_as_typed():
    assert all((ROOT / room / "py.typed").exists() for room in PACKAGES)


@pytest.fixture(scope="module", params=soaked(CHECKERS, but=[0]))
def errors(request, tmp_path_factory):
    """(path, line) of every error that a type checker reports in a user's folder, with the robots of this tree."""
    pytest.importorskip(request.param)
    folder = tmp_path_factory.mktemp("user")
    for file in (*USER.parent.glob("user_*.py"), *ROBOTS):
        shutil.copy(file, folder)
    made = python("-m", "runtime", "stubs", "user_blocks", cwd=folder)
    assert (made.stdout, made.stderr) == ("user_blocks.pyi\n", "")
    cache = ["--cache-dir", ROOT / "build" / "mypy"] if request.param == "mypy" else []
    command = [
        "-m",
        request.param,
        *CHECKERS[request.param],
        *cache,
        USER.name,
        "user_blocks.pyi",
        *[robot.name for robot in ROBOTS],
    ]
    process = python(*command, cwd=folder, timeout=300)
    assert process.returncode == 1, process.stdout + process.stderr
    if request.param == "pyright":
        reports = json.loads(process.stdout)["generalDiagnostics"]
        return {(Path(r["file"]).name, r["range"]["start"]["line"] + 1): r for r in reports if r["severity"] == "error"}
    reports = [json.loads(line) for line in process.stdout.splitlines() if line.startswith("{")]
    return {(Path(r["file"]).name, r["line"]): r for r in reports if r["severity"] == "error"}


@pytest.mark.soak
def test_type_checkers_report_the_mistakes_of_a_user_in_another_folder_and_nothing_else(errors):
    lines = enumerate(USER.read_text().splitlines(), 1)
    wrong = [(USER.name, number) for number, line in lines if "  # wrong: " in line]
    assert len(wrong) == 35
    assert sorted(errors) == wrong, errors


def test_python_itself_imports_the_packages_from_the_clone_and_nothing_else_of_it(tmp_path):
    code = "import importlib, sys, graph, runtime.cli.main; importlib.invalidate_caches(); import blocks, cext\n"
    code += "print(*[sys.modules[name].__file__ for name in ('graph', 'runtime', 'blocks', 'cext')])\n"
    code += "print(*[importlib.util.find_spec(name) for name in ('tests', 'diagrams', 'docs', 'setup')])"
    process = python("-c", code, cwd=tmp_path)
    places = [str(ROOT / name / "__init__.py") for name in ("graph", "runtime", "blocks", "cext")]
    assert process.stdout.split() == [*places, *["None"] * 4], process.stderr


def test_a_stub_that_was_written_by_hand_is_kept(tmp_path):
    (tmp_path / "own.py").write_text(USER.with_name("user_blocks.py").read_text())
    (tmp_path / "own.pyi").write_text("def spring() -> None: ...\n")
    process = python("-m", "runtime", "stubs", "own.py", cwd=tmp_path)
    assert_one_line(process, "own.pyi is a stub that was not generated: rename it")
    assert (tmp_path / "own.pyi").read_text() == "def spring() -> None: ...\n"
