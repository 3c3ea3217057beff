"""The wheel and the source archive, built and installed as a user would."""

import shutil
import subprocess
import sysconfig
import tarfile
import venv
import zipfile
from pathlib import PurePath

import pytest

from tests.checkout import PACKAGES, ROOT, assert_one_line, copy_tracked, python, tracked

pytestmark = pytest.mark.soak


@pytest.fixture(scope="module")
def archives(tmp_path_factory):
    """Names in the wheel and in the source archive, and the wheel."""
    clone = copy_tracked(tmp_path_factory.mktemp("clone"))
    for stub in sources(".pyi"):  # of the build, as `make wheel` has them
        shutil.copy2(ROOT / stub, clone / stub)
    build = python("-m", "build", "--no-isolation", "--outdir", clone / "dist", cwd=clone, timeout=900)
    assert build.returncode == 0, build.stdout + build.stderr
    [wheel], [source] = (clone / "dist").glob("*.whl"), (clone / "dist").glob("*.tar.gz")
    with zipfile.ZipFile(wheel) as opened:
        wheel_names = opened.namelist()
    with tarfile.open(source) as opened:
        source_names = [name.partition("/")[2] for name in opened.getnames()]
    return wheel_names, source_names, wheel


@pytest.fixture(scope="module")
def environment(archives, tmp_path_factory):
    """An environment with the wheel in it; the libraries it needs are lent by this one."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, with_pip=True)
    site = next(folder.glob("lib/python*/site-packages"))
    (site / "lent.pth").write_text(sysconfig.get_path("purelib") + "\n")
    pip = [folder / "bin" / "python", "-m", "pip"]
    install = subprocess.run([*pip, "install", "-q", "--no-deps", archives[2]], capture_output=True, text=True)
    assert install.returncode == 0, install.stderr
    return folder


def sources(suffix):
    return {str(path.relative_to(ROOT)) for room in PACKAGES for path in (ROOT / room).rglob(f"*{suffix}")}


def test_wheel_has_exactly_all_modules_and_their_data_files(archives):
    names = {name for name in archives[0] if ".dist-info/" not in name}
    compiled = {name.split(".")[0] + ".pyx" for name in names if PurePath(name).suffix == ".so"}
    assert compiled - {"cext/cython_shared.pyx"} == sources(".pyx")  # only Cython 3.3 and later makes this one
    beside = {
        str(name)
        for path in tracked()
        if (name := path.relative_to(ROOT)).parts[0] in (*PACKAGES, "tickwork_command.py") and path.suffix != ".pyx"
    }
    assert {name for name in names if not name.endswith(".so")} == beside | sources(".pyi")


def test_the_modules_in_the_wheel_have_no_debug_symbols(archives):
    with zipfile.ZipFile(archives[2]) as wheel:
        modules = {name: wheel.read(name) for name in wheel.namelist() if name.endswith(".so")}
    assert modules and [name for name, data in modules.items() if b".debug_info" in data or b".symtab" in data] == []


def test_the_source_archive_builds(archives):
    names = set(archives[1])
    assert sources(".py") | sources(".pyx") | sources(".pxd") <= names
    assert {
        "setup.py",
        "pyproject.toml",
        "LICENSE",
        "README.md",
        "Makefile",
        "diagrams/knee_exo.py",
        "tests/test_wheel.py",
    } <= names
    assert not [name for name in names if name.endswith((".c", ".so", ".pyc"))]


def test_the_knee_exoskeleton_runs_from_the_wheel_beside_folders_of_the_same_names(environment, tmp_path):
    for name in PACKAGES:
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise SystemExit('imported')\n")
    process = subprocess.run(
        [environment / "bin" / "tickwork", ROOT / "diagrams" / "knee_exo.py", "--fast", "--duration", "2"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert process.returncode == 0, process.stderr
    assert list((tmp_path / "recordings").glob("*.csv"))


def test_python_m_runtime_reports_shadowing_working_folder(environment, tmp_path):
    (tmp_path / "graph").mkdir()
    (tmp_path / "graph" / "__init__.py").touch()
    process = python("-m", "runtime", "--help", cwd=tmp_path, executable=environment / "bin" / "python")
    assert_one_line(process, f"`graph` comes from {tmp_path}", f"{environment}", "start with `tickwork`")


def test_the_installed_version_is_the_one_of_pyproject(environment, tmp_path):
    code = (
        "import importlib.metadata as m; d = m.distribution('tickwork'); print(d.version, "
        "d.metadata['License-Expression'])"
    )
    process = python("-c", code, cwd=tmp_path, executable=environment / "bin" / "python")
    from tests.test_packaging import PYPROJECT

    assert process.stdout.split() == [PYPROJECT["project"]["version"], PYPROJECT["project"]["license"]]
