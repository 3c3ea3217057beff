"""`build`: native blocks of a user, compiled in a folder of their own with packages as a wheel installs them."""

import re

import pytest

from tests.checkout import ROOT, RUN, assert_one_line, copy_packages, python

pytest.importorskip("Cython")
PAGE = (ROOT / "docs" / "how_to" / "native_blocks.md").read_text()
KERNEL = re.search(r"```cython\n(.*?)```", PAGE, re.S)[1]
BLOCK = re.search(r"```python notest\n(import math.*?)```", PAGE, re.S)[1]


def test_the_kernel_of_the_page_is_compiled_beside_its_source_and_runs(tmp_path):
    site, folder = copy_packages(tmp_path / "site"), tmp_path / "lab"
    folder.mkdir()
    (folder / "my_kernels.pyx").write_text(KERNEL)
    (folder / "square.py").write_text(f"{BLOCK}\nprint(Square().step([1.0, -3.0]), end='')\n")
    process = python(*RUN, "build", "my_kernels.pyx", cwd=folder, path=site)
    assert process.returncode == 0, process.stderr
    assert sorted(path.name for path in folder.iterdir()) == [process.stdout.strip(), "my_kernels.pyx", "square.py"]
    assert python("square.py", cwd=folder, path=site).stdout == "[1. 9.]"


@pytest.mark.soak
def test_a_source_with_an_error_and_a_missing_one_are_reported(tmp_path):
    (tmp_path / "wrong.pyx").write_text("cdef int 3x")
    process = python(*RUN, "build", "wrong.pyx", cwd=tmp_path)
    assert process.returncode == 2 and "wrong.pyx:1:9" in process.stdout + process.stderr
    assert process.stderr.endswith("tickwork: wrong.pyx does not compile: correct the errors above\n")
    assert_one_line(python(*RUN, "build", "none.pyx", cwd=tmp_path), "none.pyx is not a Cython source")
