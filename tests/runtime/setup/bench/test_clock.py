"""`python -m runtime bench clock`: what it counts, and that what it says of itself holds. How well this machine keeps
time is not tested.
"""

import json

import numpy as np
import psutil
import pytest

from cext.clock.histogram import counts_of, percentile, percentiles
from runtime.host.errors import OK, BadInput
from runtime.setup.bench import clock, costs
from runtime.setup.bench.c_program import build


def test_bench_clock_reports_both_loops_at_every_rate_and_costs_of_a_tick(command_line):
    code, out, err = command_line("bench", "clock", "--seconds", "0.1", "--repeats", "1", "--ticks", "20000", "--json")
    told = json.loads(out)
    assert (code, err) == (OK, "")
    assert list(told["clock"]) == [
        f"{rate} Hz, {name}" for rate in (200, 1000, 2000) for name in (clock.C, clock.NATIVE, clock.PYTHON)
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
    assert len(told["goals"]) == 15 and list(command_line.folder.iterdir()) == []


def test_under_load_the_processors_are_kept_busy_and_left_alone_afterwards(command_line):
    before = set(psutil.Process().children())
    code, out, _ = command_line("bench", "clock", "--seconds", "0.3", "--repeats", "1", "--load", "--busy-thread")
    assert (
        code == OK
        and "all processors loaded, a busy Python thread" in out
        and "1000 Hz, ticks lost in excess of the C loop" in out
    )
    left = set(psutil.Process().children()) - before
    assert [child for child in left if child.status() != psutil.STATUS_ZOMBIE] == []


def test_the_loop_in_c_keeps_the_same_grid():
    late, off, missed = clock.c_chunk(build(clock.C_LOOP), 500, 0.1, "off")
    assert len(late) + missed == 50 and late.min() >= 0 and len(off) == len(late) - 1


def test_a_stall_of_the_loop_in_c_is_counted_from_the_grid_point_that_was_awaited():
    late, off, missed = clock.kept_time(np.array([10, 20, -1, -1, 500, 30]), 1000)
    assert late.tolist() == [10, 20, 2500, 30] and off.tolist() == [10, 2480, 470] and missed == 2


def test_samples_are_pooled_by_their_counts():
    one, two = np.array([100, 200, 300]), np.array([400, 10**6])
    pooled = counts_of(one) + counts_of(two)
    assert pooled.sum() == 5
    for share, true in ((0.2, 100e-9), (0.5, 300e-9), (0.99, 1e-3)):
        assert true < percentile(pooled, share) <= 1.033 * true
    assert percentile(pooled, 0.5) == pytest.approx(percentiles([*one, *two])["p50"], rel=1e-12)
    with pytest.raises(ValueError, match="the histogram is empty"):
        percentile(counts_of([]), 0.5)
    with pytest.raises(BadInput, match="no tick ran in time to be measured: end other programs, or pass a longer"):
        clock.Kept().late(0.5)


def test_the_benchmark_diagram_has_the_stated_number_of_signals():
    for python_blocks in (0, 10):
        made = clock.diagram(1000, python_blocks)
        assert sum(len(block.outputs) for block in made) == clock.SIGNALS


def test_memory_does_not_grow_with_the_number_of_ticks():
    assert abs(costs.growth(few=10_000, many=1_000_000)) <= 2**20
