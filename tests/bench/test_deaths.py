"""`python -m tests.bench deaths`: that it measures what it says. How fast this machine is, is not tested."""

import json

import psutil
import pytest

from runtime.host.errors import OK


@pytest.mark.soak
def test_bench_deaths_measures_each_death_and_leaves_no_process(bench):
    before = set(psutil.Process().children())
    code, out, err = bench("deaths", "--kills", "1", "--json")
    assert (code, err) == (OK, "")
    told = json.loads(out)
    assert told["load"]["min"] <= told["load"]["max"]
    measured = [each for each in told["deaths"].values() if each["n"]]
    assert len(told["deaths"]) == 4 and len(measured) >= 3, "one may lack its real-time priority"
    assert all((each["n"], each["missed"]) == (1, 0) and 0.0 < each["p50"] == each["max"] < 900.0 for each in measured)
    left = set(psutil.Process().children()) - before
    assert [child for child in left if child.status() != psutil.STATUS_ZOMBIE and not is_server(child)] == []


def is_server(process):
    """Whether it is the server of the commands of these tests, which stays (tests/runtime/forked.py)."""
    return any("tests.runtime.forked" in word for word in process.cmdline())
