"""Check of the installation before any import: packages from one place, compiled modules, libraries."""

import ast
import os
import shutil
import subprocess
import sys
from importlib import import_module
from importlib.metadata import files
from itertools import product
from pathlib import Path

import pytest

from runtime.host import installation_check
from tests.checkout import ROOT, RUN, assert_one_line, copy_packages, python
from tests.soaking import soaked
from tests.test_packaging import PYPROJECT, canonical


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A folder on the path that holds all four packages, as site-packages does, and the console script beside it."""
    folder = copy_packages(tmp_path_factory.mktemp("site"))
    shutil.copy(ROOT / "tickwork_command.py", folder)
    module, function = PYPROJECT["project"]["scripts"]["tickwork"].split(":")
    (folder / "bin").mkdir()
    (folder / "bin" / "tickwork").write_text(f"import sys\nfrom {module} import {function}\nsys.exit({function}())\n")
    return folder


@pytest.fixture
def lab(tmp_path):
    """The working folder of a lab."""
    folder = tmp_path / "lab"
    folder.mkdir()
    return folder


def test_installation_check_passes_in_checkout():
    assert installation_check.problem() is None


@pytest.mark.parametrize("name", soaked(["blocks", "graph", "cext"], but=[0]))
def test_working_folder_that_shadows_package_is_reported_in_one_line(name, installed, lab):
    (lab / name).mkdir()
    (lab / name / "__init__.py").write_text("raise SystemExit('imported')\n")
    process = python(*RUN, "--help", cwd=lab, path=installed)
    assert_one_line(process, f"`{name}` comes from {lab}", f"`runtime` from {installed}", "start with `tickwork`")


def test_file_that_shadows_package_is_reported(installed, lab):
    (lab / "graph.py").write_text("raise SystemExit('imported')\n")
    assert_one_line(python(*RUN, "--help", cwd=lab, path=installed), f"`graph` comes from {lab}", "`tickwork`")


WAVE = """
from blocks.recorders import CsvRecorder
from blocks.sources import Sine
from graph import Diagram

with Diagram("wave", rate=100) as diagram:
    Sine()
    CsvRecorder()
"""


@pytest.mark.parametrize("name", soaked(["json", "signal", "typing", "struct", "numpy", "can"], but=[0, 4]))
def test_a_file_beside_the_diagram_with_the_name_of_a_library_is_named(name, installed, lab):
    (lab / "wave.py").write_text(WAVE)
    (lab / f"{name}.py").write_text("raise SystemExit(0)\n")
    process = python(*RUN, "wave.py", "--fast", "--duration", "1", cwd=lab, path=installed)
    assert_one_line(process, f" {name}.py has the name of a library", "rename it, or start with `tickwork`")
    assert not (lab / "recordings").exists()


def test_a_package_beside_the_diagram_with_the_name_of_a_library_is_named(installed, lab):
    (lab / "wave.py").write_text(WAVE)
    (lab / "json").mkdir()
    (lab / "json" / "__init__.py").write_text("raise SystemExit(0)\n")
    assert_one_line(python(*RUN, "wave.py", cwd=lab, path=installed), " json/__init__.py has the name")


@pytest.mark.soak
def test_a_diagram_may_have_the_name_of_an_unused_module(installed, lab):
    (lab / "wave.py").write_text(WAVE)
    (lab / "sunau.py").write_text("raise SystemExit(0)\n")
    process = python(*RUN, "wave.py", "--fast", "--duration", "1", "--no-record", cwd=lab, path=installed)
    assert process.returncode == 0, process.stderr


def test_a_diagram_imports_a_module_of_the_working_folder(installed, lab):
    (lab / "gains.py").write_text("RATE = 100\n")
    (lab / "deeper").mkdir()
    (lab / "deeper" / "wave.py").write_text(WAVE.replace("100", "gains.RATE").replace("\n", "\nimport gains\n", 1))
    process = python(*RUN, "deeper/wave.py", "--fast", "--duration", "1", "--no-record", cwd=lab, path=installed)
    assert process.returncode == 0, process.stderr


def test_a_file_in_the_clone_shadows_no_standard_module(tmp_path):
    copy_packages(tmp_path)
    (tmp_path / "signal.py").write_text("raise SystemExit(0)\n")
    assert_one_line(python(*RUN, "diagrams/knee_exo.py", cwd=tmp_path), " signal.py has the name")


@pytest.mark.soak
def test_the_console_script_runs_beside_files_with_the_names_of_libraries(installed, lab):
    (lab / "wave.py").write_text(WAVE)
    for name in ("runtime", "json", "signal", "numpy"):
        (lab / f"{name}.py").write_text("raise SystemExit(0)\n")
    process = python(installed / "bin" / "tickwork", "wave.py", "--fast", "--duration", "1", cwd=lab, path=installed)
    assert process.returncode == 0, process.stderr
    [recording] = (lab / "recordings").glob("*.csv")
    assert len(recording.read_text().splitlines()) == 101


def test_the_console_script_works_beside_folders_of_the_same_names(installed, lab):
    for name in ("blocks", "graph", "cext", "runtime"):
        (lab / name).mkdir()
        (lab / name / "__init__.py").write_text("raise SystemExit('imported')\n")
    process = python(installed / "bin" / "tickwork", "--help", cwd=lab, path=installed)
    assert process.returncode == 0, process.stderr
    assert "diagrams/knee_exo.py" in process.stdout


def test_a_diagram_runs_and_is_recorded_beside_folders_of_the_same_names(installed, lab):
    for name in ("blocks", "graph", "cext", "runtime"):
        (lab / name).mkdir()
        (lab / name / "__init__.py").write_text("raise SystemExit('imported')\n")
    (lab / "wave.py").write_text(
        "from blocks.recorders import CsvRecorder\nfrom blocks.sources import Sine\nfrom graph import Diagram\n\n"
        "with Diagram('wave', rate=100) as diagram:\n    Sine()\n    CsvRecorder()\n"
    )
    process = python(installed / "bin" / "tickwork", "wave.py", "--fast", "--duration", "1", cwd=lab, path=installed)
    assert process.returncode == 0, process.stderr
    [recording] = (lab / "recordings").glob("*.csv")
    assert len(recording.read_text().splitlines()) == 101  # a header and a row a tick


@pytest.mark.parametrize("name, place", [("blocks", "comes from {}"), ("runtime", "is {}/runtime")])
def test_console_script_reports_foreign_package_on_path(name, place, installed, lab):
    (lab / name).mkdir()
    (lab / name / "__init__.py").write_text("")
    process = python(installed / "bin" / "tickwork", "--help", cwd=lab, path=f"{lab}{os.pathsep}{installed}")
    assert_one_line(process, f"`{name}` {place.format(lab)}", str(installed), "PYTHONPATH")
    assert "start with `tickwork`" not in process.stderr


def test_a_folder_without_modules_does_no_harm_where_a_real_package_follows(installed, lab):
    (lab / "blocks").mkdir()
    process = python(*RUN, "--help", cwd=lab, path=installed)
    assert process.returncode == 0, process.stderr


def test_missing_package_is_reported(tmp_path):
    copy_packages(tmp_path, packages=("cext", "graph", "runtime"))
    assert_one_line(python("-S", *RUN, cwd=tmp_path), "`blocks` is missing")


def test_a_clone_that_was_not_built_names_make_run(tmp_path):
    copy_packages(tmp_path, built=False)
    (tmp_path / "Makefile").touch()
    assert_one_line(python(*RUN, "diagrams/knee_exo.py", cwd=tmp_path), "not built", "`make run`")


def test_importing_from_a_clone_that_was_not_built_names_make_run(tmp_path):
    copy_packages(tmp_path, built=False)
    for name in ("cext", "blocks.limiters"):
        process = python("-c", f"import {name}", cwd=tmp_path)
        assert process.returncode == 1
        last = process.stderr.splitlines()[-1]
        assert last.startswith("ImportError: Tickwork is not built") and "`make run`" in last


def test_build_for_another_python_is_reported(tmp_path):
    copy_packages(tmp_path)
    (tmp_path / "Makefile").touch()
    for module in (tmp_path / "cext").rglob("*.so"):
        module.rename(module.with_name(module.name.split(".")[0] + ".cpython-27-riscv.so"))
    assert_one_line(
        python(*RUN, cwd=tmp_path), f"not built for Python {sys.version_info[0]}.{sys.version_info[1]}", "`make run`"
    )


def test_one_missing_compiled_module_is_reported(tmp_path):
    copy_packages(tmp_path)
    (tmp_path / "Makefile").touch()
    (tmp_path / "cext" / "kernels" / "new.pyx").touch()
    assert_one_line(python(*RUN, cwd=tmp_path), "not built", "`make run`")


def test_missing_dependencies_are_reported_with_the_environment(tmp_path):
    copy_packages(tmp_path)
    for name in ("Makefile", "pyproject.toml"):
        shutil.copy(ROOT / name, tmp_path)
    assert_one_line(python("-S", *RUN, cwd=tmp_path), "numpy", "networkx", "are missing", "`make run`")
    (tmp_path / ".venv" / "bin").mkdir(parents=True)
    (tmp_path / ".venv" / "bin" / "activate").touch()
    assert_one_line(python("-S", *RUN, cwd=tmp_path), "activate the environment (`. .venv/bin/activate`)", "`make run`")


def test_native_code_older_than_the_python_beside_it_names_make_build(tmp_path):
    copy_packages(tmp_path)
    (tmp_path / "Makefile").touch()
    (tmp_path / "runtime" / "cli" / "main.py").write_text("from cext.schedule.program import a_name_that_is_newer\n")
    assert_one_line(python(*RUN, cwd=tmp_path), "do not match", "a_name_that_is_newer", "`make build`")


def test_dependency_that_does_not_load_is_reported_in_one_line(tmp_path):
    copy_packages(tmp_path)
    (tmp_path / "msgspec.py").write_text(
        "raise ImportError('libfoo.so.1: cannot open shared object file\\nand more', name=__name__)\n"
    )
    (tmp_path / "runtime" / "cli" / "main.py").write_text("import msgspec\n")
    assert_one_line(
        python(*RUN, cwd=tmp_path), "msgspec cannot be imported (libfoo.so.1: cannot open shared object file)"
    )


def test_internal_error_is_not_hidden(tmp_path):
    copy_packages(tmp_path)
    (tmp_path / "runtime" / "cli" / "main.py").write_text("from runtime.host.errors import no_such_name\n")
    process = python(*RUN, cwd=tmp_path)
    assert process.returncode == 1 and "Traceback" in process.stderr and "no_such_name" in process.stderr


def test_checked_packages_are_the_declared_dependencies():
    requirements = [requirement.partition(";") for requirement in PYPROJECT["project"]["dependencies"]]
    assert {marker.strip() for _, _, marker in requirements} == {"", "python_version < '3.11'"}
    declared = {canonical(name) for name, _, marker in requirements if not marker or sys.version_info < (3, 11)}
    assert set(installation_check.required_packages()) == declared
    for distribution in declared:
        module = installation_check.MODULES.get(distribution, distribution)
        parts = tuple(module.split("."))
        assert any(
            file.parts[: len(parts)] == parts or file.parts[0] == module + ".py" for file in files(distribution)
        ), f"{distribution} does not bring {module}"
    assert PYPROJECT["project"]["requires-python"] == ">=%d.%d" % installation_check.OLDEST_PYTHON


def test_a_requirement_of_older_pythons_is_required_on_them(monkeypatch):
    monkeypatch.setattr(sys, "version_info", (3, 10, 0, "final", 0))
    assert "tomli" in installation_check.required_packages()
    monkeypatch.setattr(sys, "version_info", (3, 11, 0, "final", 0))
    assert "tomli" not in installation_check.required_packages() and "numpy" in installation_check.required_packages()


def test_old_python_parses_entry_files_and_reports_required_version(monkeypatch):
    for name in (
        "__init__.py",
        "__main__.py",
        "host/__init__.py",
        "host/installation_check.py",
        "host/ending.py",
        "host/working_folder.py",
    ):
        ast.parse((ROOT / "runtime" / name).read_text(), feature_version=(3, 6))
    ast.parse((ROOT / "tickwork_command.py").read_text(), feature_version=(3, 6))
    monkeypatch.setattr(sys, "version_info", (3, 9, 2, "final", 0))
    assert "Python 3.9, but 3.10 or newer is required" in installation_check.problem()


def test_entry_files_import_nothing_of_tickwork():
    process = python("-c", "import sys, runtime.host.installation_check; print(*sys.modules)", cwd=ROOT)
    loaded = set(process.stdout.split())
    assert "runtime.host.installation_check" in loaded
    assert not {"cext", "graph", "blocks", "runtime.cli.main", "numpy", "networkx"} & loaded


@pytest.mark.parametrize(
    "name, code",
    [
        ("graph", "from blocks.filters import Butterworth"),
        ("runtime", "from graph import Diagram, main\ndiagram = Diagram('d', 10)\nmain(diagram)"),
    ],
)
def test_a_script_that_finds_another_package_of_that_name_names_both(name, code, lab, tmp_path):
    other = tmp_path / "other" / name
    other.mkdir(parents=True)
    (other / "__init__.py").write_text("")
    (lab / "knee.py").write_text(code)
    process = python("knee.py", cwd=lab, path=os.pathsep.join([str(other.parent), str(ROOT)]))
    message = f"ImportError: `{name}` is {other}, which hides Tickwork's {ROOT / name}: rename or uninstall"
    assert process.returncode == 1 and message in process.stderr


def test_a_distribution_that_has_replaced_a_package_is_named(tmp_path):
    site = copy_packages(tmp_path / "site")
    (site / "graph" / "__init__.py").write_text("class Graph: ...\n")
    folder = site / "graph-0.4.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: graph\nVersion: 0.4\n")
    (folder / "RECORD").write_text("graph/__init__.py,,\n")
    process = python(*RUN, "check", "knee.py", cwd=tmp_path, path=site)
    assert_one_line(process, "the package graph has replaced files of Tickwork's `graph`")
    cure = "run `pip uninstall -y graph && pip install --force-reinstall --no-deps tickwork`"
    assert cure in process.stderr


def damage(cache, data, changed):
    """Write other content into a cache of a module's bytecode."""
    cache.write_bytes({"cut": data[:-50], "a header": data[:16], "zeros": data[:16] + bytes(len(data) - 16)}[changed])


@pytest.fixture(scope="module")
def warm(tmp_path_factory):
    """A folder with the caches of all modules of a run."""
    folder = tmp_path_factory.mktemp("caches")
    (folder / "wave.py").write_text("import shared\n" + WAVE)
    (folder / "shared.py").write_text("GAIN = 2.0\n")
    process = cached(folder, "tickwork", "wave.py", "--fast", "--duration", "0.1")
    assert process.returncode == 0, process.stderr
    return folder


def cached(folder, *words):
    """Run a command of the environment, or a Python with -c, with the caches of a folder."""
    variables = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    program, *arguments = words
    return subprocess.run(
        [str(Path(sys.executable).with_name(program)), *arguments], cwd=folder, capture_output=True, text=True,
        env=variables | {"PYTHONPYCACHEPREFIX": str(folder / "caches"), "PYTHONPATH": str(ROOT)},
    )  # fmt: skip


CHANGES = ("cut", "a header", "zeros")
MODULES = ("runtime/__init__", "runtime/host/ending", "runtime/cli/main", "runtime/cli/run", "runtime/session/session")
MODULES += ("graph/schedule", "graph/diagram", "runtime/host/interrupts", "shared")


@pytest.mark.parametrize("module, changed", soaked(list(product(MODULES, CHANGES)), but=[2]))
def test_a_damaged_bytecode_cache_is_named_with_its_remedy(module, changed, warm):
    root = warm if module == "shared" else ROOT
    [cache] = (warm / "caches" / root.relative_to("/")).glob(f"{module}.cpython*.pyc")
    data = cache.read_bytes()
    damage(cache, data, changed)
    try:
        process = cached(warm, "tickwork", "wave.py", "--fast", "--duration", "0.1")
    finally:
        cache.write_bytes(data)
    assert process.returncode == 2 and "Traceback" not in process.stderr
    place = os.path.relpath(cache, warm) if module == "shared" else str(cache)
    assert f"the bytecode cache {place} is damaged" in process.stderr
    assert f"run `rm -r {os.path.dirname(place)}`" in process.stderr


def test_a_damaged_bytecode_cache_of_an_import_in_python_is_named(warm):
    code = "import runtime; runtime.run('wave.py', 0.1)"
    assert cached(warm, "python", "-c", code).returncode == 0
    [cache] = (warm / "caches" / ROOT.relative_to("/")).glob("runtime/session/simulate.cpython*.pyc")
    data = cache.read_bytes()
    damage(cache, data, "cut")
    try:
        process = cached(warm, "python", "-c", code)
    finally:
        cache.write_bytes(data)
    assert process.stderr.splitlines()[-1].startswith(f"ImportError: the bytecode cache {cache} is damaged")


@pytest.mark.soak
def test_a_damaged_bytecode_cache_of_a_child_process_is_named(warm):
    run = ("tickwork", "wave.py", "--duration", "0.1")
    assert cached(warm, *run).returncode == 0
    [cache] = (warm / "caches" / ROOT.relative_to("/")).glob("runtime/record/recorder/process.cpython*.pyc")
    data = cache.read_bytes()
    damage(cache, data, "cut")
    try:
        process = cached(warm, *run)
    finally:
        cache.write_bytes(data)
    assert process.returncode == 2 and "Traceback" not in process.stderr
    assert f"the bytecode cache {cache} is damaged" in process.stderr


def test_an_error_of_a_module_is_not_one_of_its_cache(lab, monkeypatch):
    (lab / "broken_module.py").write_text("int('x')\n")
    monkeypatch.syspath_prepend(str(lab))
    with pytest.raises(ValueError) as raised:
        import_module("broken_module")
    assert installation_check.damaged_cache(raised.value) is None
