"""`python -m tests.bench ros2`. The times of this machine are not tested."""

import json

import pytest

from runtime.host.errors import OK
from tests.optional import Library

pytestmark = pytest.mark.soak
zenoh = Library("zenoh")


def test_times_of_a_run_and_of_bare_zenoh_are_reported(bench, tmp_path):
    assert zenoh.Config
    words = ("--seconds", "1.5", "--repeats", "2", "--joints", "2", "--sensors", "1", "--json")
    code, out, err = bench("ros2", *words)
    report = json.loads(out)
    assert (code, err) == (OK, "") and len(report["sizes"]) == 2
    for name, each in report["ros2"].items():
        assert each["n"] > 100 and each["p50_ms"] <= each["p90_ms"] <= each["p99_ms"] <= each["p100_ms"]
        assert 0.0 < each["p50_ms"] < 100.0, name
    assert [goal["what"] for goal in report["goals"]] == ["from the tick to the call of Zenoh, p99"]
    assert list(tmp_path.iterdir()) == []
