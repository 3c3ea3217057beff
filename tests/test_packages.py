"""The distributions under packages/, installed with pip into a folder, pass their own tests."""

import os
import shutil
import subprocess
import sys

import pytest

from tests.checkout import ROOT
from tests.soaking import soaked


@pytest.mark.soak
@pytest.mark.parametrize("name", soaked(sorted(folder.name for folder in (ROOT / "packages").iterdir()), but=[0]))
def test_a_distribution_installs_and_passes_its_tests(name, tmp_path):
    source, site = tmp_path / name, tmp_path / "site"
    shutil.copytree(ROOT / "packages" / name, source, ignore=shutil.ignore_patterns("build", "*.egg-info", "*.so"))
    where = {**os.environ, "PYTHONPATH": os.pathsep.join([str(site), str(ROOT), os.environ.get("PYTHONPATH", "")])}
    install = ["pip", "install", "-q", "--no-build-isolation", "--no-deps", "--target", str(site), str(source)]
    for command in (install, ["pytest", "-p", "no:cacheprovider", "-m", "", str(source / "tests")]):
        done = subprocess.run([sys.executable, "-m", *command], env=where, cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr
        assert "skipped" not in done.stdout or os.environ.get("SKIPPED_FILES") != "error", done.stdout
