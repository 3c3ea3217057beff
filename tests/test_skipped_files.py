"""A file of tests that are all skipped fails a session in which missing tools are errors, as `make soak` runs."""

import os
import subprocess
import sys

import pytest

from tests.checkout import ROOT
from tests.soaking import soaked

ALL = "import pytest\n\n@pytest.mark.skip(reason='no fuzzer')\ndef test_a():\n    pass\n"
SOME = ALL + "\ndef test_b():\n    pass\n"
MODULE = "import pytest\n\npytest.importorskip('no_such_library')\n\ndef test_a():\n    pass\n"


@pytest.mark.parametrize(
    "text, setting, code",
    soaked([(ALL, "error", 1), (MODULE, "error", 1), (SOME, "error", 0), (ALL, "", 0), (MODULE, "", 5)], but=[0, 2]),
)
def test_a_file_of_skipped_tests_is_an_error_where_tools_are_required(tmp_path, text, setting, code):
    (tmp_path / "conftest.py").write_text((ROOT / "tests" / "conftest.py").read_text())
    (tmp_path / "test_it.py").write_text(text)
    environment = {**os.environ, "SKIPPED_FILES": setting, "PYTHONPATH": str(ROOT)}
    process = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "."],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert process.returncode == code, process.stdout
    assert ("every test was skipped" in process.stdout) == (code == 1)
