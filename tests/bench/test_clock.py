"""`python -m tests.bench clock`: what it counts. How well this machine keeps time is not tested."""

import json

import numpy as np
import psutil
import pytest

from runtime.host.errors import OK
from runtime.setup.bench import clock
from tests.bench import c_clock, costs
from tests.bench.c_program import build

pytestmark = pytest.mark.soak


def test_bench_clock_reports_both_loops_at_every_rate_and_costs_of_a_tick(bench, tmp_path):
    code, out, err = bench("clock", "--seconds", "0.1", "--repeats", "1", "--ticks", "20000", "--json")
    assert (code, err) == (OK, "")
    told = json.loads(out)
    assert list(told["clock"]) == [
        f"{rate} Hz, {name}" for rate in (200, 1000, 2000) for name in (c_clock.C, *clock.CONTENDERS)
    ]
    for name, row in told["clock"].items():
        assert row["ticks"] + row["missed"] == 0.1 * int(name.split()[0])
        assert 0.0 <= row["period_p50_us"] <= row["period_p99_us"]
    assert (
        told["costs"]["drift_ns"] <= 0.5
        and 0.0 < told["costs"]["histogram_add_ns"]
        and 0.0 < told["costs"]["knee_minute_s"]
        and 0.0 < told["costs"]["recorder_us"] < told["costs"]["recorder_csv_us"]
    )
    assert len(told["goals"]) == 15 and list(tmp_path.iterdir()) == []


def test_under_load_the_processors_are_kept_busy_and_left_alone_afterwards(bench):
    before = set(psutil.Process().children())
    code, out, _ = bench("clock", "--seconds", "0.3", "--repeats", "1", "--load", "--busy-thread")
    assert (
        code == OK
        and "all processors loaded, a busy Python thread" in out
        and "1000 Hz, ticks lost in excess of the C loop" in out
    )
    left = [child for child in {*psutil.Process().children()} - before if child.status() != psutil.STATUS_ZOMBIE]
    # the process that starts those of all tests stays
    assert [child for child in left if "tests.runtime.forked" not in "".join(child.cmdline())] == []


def test_the_loop_in_c_keeps_the_same_grid():
    late, off, missed = c_clock.c_chunk(build(c_clock.C_LOOP), 500, 0.1, "off")
    assert len(late) + missed == 50 and late.min() >= 0 and len(off) == len(late) - 1


def test_a_stall_of_the_loop_in_c_is_counted_from_the_grid_point_that_was_awaited():
    late, off, missed = c_clock.kept_time(np.array([10, 20, -1, -1, 500, 30]), 1000)
    assert late.tolist() == [10, 20, 2500, 30] and off.tolist() == [10, 2480, 470] and missed == 2


def test_memory_does_not_grow_with_the_number_of_ticks():
    assert abs(costs.growth(few=10_000, many=1_000_000)) <= 2**20
