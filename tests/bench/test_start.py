"""`python -m tests.bench start`. The speed of this machine is not tested."""

import re

import pytest

from runtime.host.errors import BAD_INPUT, OK

pytestmark = pytest.mark.soak


def test_starting_is_measured_from_outside(bench):
    code, out, err = bench("start", "--repeats", "1")
    assert (code, err) == (OK, "")
    first, memory = re.search(r"knee_exo\.py, to the first tick +([\d.e+]+) +\S+ +\S+ +([\d.]+)", out).groups()
    assert 50.0 < float(first) < 20_000.0 and 20.0 < float(memory) < 200.0


def test_bench_start_rejects_a_missing_file(bench):
    assert bench("start", "nowhere.py") == (BAD_INPUT, "", "tests.bench: file nowhere.py does not exist\n")


def test_a_failed_start_is_reported_with_its_reason(bench, tmp_path):
    (tmp_path / "broken.py").write_text("raise SystemExit('not today')\n")
    code, _, err = bench("start", str(tmp_path / "broken.py"), "--repeats", "1")
    assert code == BAD_INPUT and "the run did not reach its first tick: " in err and "broken.py" in err
