"""`make` reports missing prerequisites, and never runs what it has not built."""

import os
import re
import shutil
import subprocess
import sys

import pytest

from tests.checkout import ROOT, copy_tracked
from tests.runtime.runs import KNEE_EXO, environment

TOOLS = "bash cat cmp cp env find grep head id mkdir mktemp mv printf rm sed sort tail touch tr true".split()

pytestmark = pytest.mark.skipif(shutil.which("make") is None, reason="needs make")


def make(*arguments, cwd, timeout=60, **environment):
    """Returns the CompletedProcess, with both outputs in stdout."""
    kept = {name: value for name, value in os.environ.items() if name not in ("PYTHON", "CC", "MAKEFLAGS", "MAKELEVEL")}
    return subprocess.run(
        [shutil.which("make"), *arguments],
        cwd=cwd,
        env=kept | environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=timeout,
    )


def told(process):
    """Lines of ours in the output of make."""
    return [line.removeprefix("tickwork: ") for line in process.stdout.splitlines() if line.startswith("tickwork: ")]


@pytest.fixture
def clone(tmp_path):
    for name in ("Makefile", "pyproject.toml", "setup.py"):
        (tmp_path / name).write_text((ROOT / name).read_text())
    (tmp_path / "cext").mkdir()
    return tmp_path


@pytest.fixture
def bare_path(tmp_path_factory):
    """A PATH with the tools of every system, and neither Python nor compiler."""
    folder = tmp_path_factory.mktemp("bin")
    for tool in TOOLS:
        if shutil.which(tool):
            (folder / tool).symlink_to(shutil.which(tool))
    return folder


def test_make_without_python_prints_the_install_command(clone, bare_path):
    process = make("run", cwd=clone, PATH=str(bare_path))
    assert process.returncode != 0
    [line] = told(process)
    assert line.startswith("Python is missing") and "apt install python3 python3-venv" in line


def test_make_without_compiler_prints_the_install_command(clone, bare_path):
    (bare_path / "python3").symlink_to(sys.executable)
    process = make("test", cwd=clone, PATH=str(bare_path))
    assert process.returncode != 0
    [line] = told(process)
    assert (
        line.startswith("missing: ") and "a C compiler" in line and re.search(r"apt install .*\bgcc libc6-dev\b", line)
    )
    assert not (clone / ".venv").exists()


def test_compiler_without_output_is_rejected(clone, bare_path):
    (bare_path / "python3").symlink_to(sys.executable)
    (bare_path / "cc").symlink_to(shutil.which("true"))
    assert "a C compiler" in told(make("run", cwd=clone, PATH=str(bare_path)))[0]
    assert "a C compiler" in told(make("run", cwd=clone, CC="no-such-compiler"))[0]


def test_missing_requested_python_is_named(clone):
    assert told(make("run", cwd=clone, PYTHON="python2.99")) == ["Python 'python2.99' was not found"]


@pytest.mark.soak
def test_old_python_is_reported_with_required_version(clone, bare_path):
    old = next(
        (found for name in ("python3.9", "python3.8", "python3.7", "python3.6") if (found := old_python(name))), None
    )
    if old is None:
        pytest.skip("needs a Python 3.6 to 3.9 on the PATH")
    process = make("run", cwd=clone, PYTHON=old)
    [line] = told(process)
    assert re.search(r"is Python 3\.[6-9]\.\d+, but 3\.10 or newer is required", line) and "PYTHON=" in line


def old_python(name):
    found = shutil.which(name)
    return found if found and subprocess.run([found, "-c", ""], capture_output=True).returncode == 0 else None


def test_help_names_every_command():
    process = make("help", cwd=ROOT)
    assert process.returncode == 0
    phony = re.search(r"^\.PHONY: (.*)", (ROOT / "Makefile").read_text(), re.M)[1].split()
    for command in set(phony) - {"help", "FORCE"}:
        assert f"make {command} " in process.stdout


def test_the_build_tools_are_those_of_pyproject(clone):
    """The recipe reads [build-system] with sed; asked of make, without running it."""
    from tests.test_packaging import PYPROJECT

    expression = re.search(r"sed -n '(.*?)' pyproject\.toml", (ROOT / "Makefile").read_text())[1].replace("$$", "$")
    process = subprocess.run(["sed", "-n", expression, "pyproject.toml"], cwd=ROOT, capture_output=True, text=True)
    assert [word.strip(' "\n') for word in process.stdout.split(",")] == PYPROJECT["build-system"]["requires"]


@pytest.mark.soak
def test_the_bytecode_of_all_libraries_that_a_run_imports_is_made(tmp_path):
    """A second run of the same Python writes no bytecode of a library."""
    imports = re.search(r"^RUN_IMPORTS := (.*)", (ROOT / "Makefile").read_text(), re.M)[1]
    cache = {"PYTHONPYCACHEPREFIX": str(tmp_path / "bytecode"), "PYTHONDONTWRITEBYTECODE": ""}

    def bytecode_after(*words):
        process = subprocess.run(
            [sys.executable, *words], cwd=tmp_path, env=environment(**cache), capture_output=True, text=True, timeout=60
        )
        assert process.returncode == 0, process.stderr
        return {path for path in (tmp_path / "bytecode").rglob("*.pyc") if "site-packages" in path.parts}

    made = bytecode_after("-c", f"import {imports}")
    assert len(made) > 100
    assert bytecode_after("-m", "runtime", KNEE_EXO, "--fast", "--duration", "0.1") == made


@pytest.mark.soak
def test_unreachable_package_index_is_reported(clone):
    process = make(
        "run",
        cwd=clone,
        PYTHON=sys.executable,
        PIP_CONFIG_FILE=os.devnull,
        PIP_INDEX_URL="http://127.0.0.1:9/simple",
        PIP_FIND_LINKS="",
        PIP_NO_CACHE_DIR="1",
        PIP_RETRIES="1",
    )
    assert process.returncode != 0
    assert told(process)[-1].startswith("pip cannot reach the package index")


@pytest.mark.soak
def test_only_changed_modules_are_compiled(tmp_path):
    copy_tracked(tmp_path)
    first = make("build", cwd=tmp_path, timeout=600, PYTHON=sys.executable)
    assert first.returncode == 0, first.stdout
    built = modules(tmp_path)
    sources = {str(path.relative_to(tmp_path).with_suffix("")) for path in (tmp_path / "cext").rglob("*.pyx")}
    assert {name.split(".")[0] for name in built} == sources | {"cext/cython_shared"}

    assert make("build", cwd=tmp_path).stdout == ""
    assert modules(tmp_path) == built

    (tmp_path / "cext" / "kernels" / "limiters.pyx").touch()
    assert told(make("build", cwd=tmp_path, timeout=600)) == ["compiling"]
    assert changed(built, modules(tmp_path)) == {"cext/kernels/limiters"}

    built = modules(tmp_path)
    (tmp_path / "cext" / "memory" / "shared_state.pxd").touch()
    make("build", cwd=tmp_path, timeout=600)
    again = changed(built, modules(tmp_path))
    assert {"cext/memory/shared_state", "cext/schedule/executor"} <= again and "cext/kernels/limiters" not in again

    (tmp_path / "cext" / "kernels" / "limiters.pyx").unlink()
    make("build", cwd=tmp_path, timeout=600)
    assert not [name for name in modules(tmp_path) if "limiters" in name]

    (tmp_path / "cext" / "memory" / "shared_state.pyx").write_text("cdef int 3x\n")
    broken = make("build", cwd=tmp_path, timeout=600)
    assert (
        broken.returncode != 0
        and "cext/memory/shared_state.pyx:1" in broken.stdout
        and told(broken)[-1].startswith("the native code does not compile")
    )


def modules(root):
    return {str(path.relative_to(root)): path.stat().st_mtime_ns for path in (root / "cext").rglob("*.so")}


def changed(before, after):
    return {name.split(".")[0] for name in after if after[name] != before.get(name)}
