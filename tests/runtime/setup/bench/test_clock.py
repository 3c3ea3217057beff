"""`python -m runtime bench clock`: what it counts, and that what it says of itself holds. How well this machine keeps
time is not tested.
"""

import json

import numpy as np
import pytest

from cext.clock.histogram import counts_of, percentile, percentiles
from runtime.host.errors import OK, BadInput
from runtime.setup.bench import clock


@pytest.mark.paced
def test_bench_clock_reports_native_and_python_blocks_at_every_rate(command_line):
    code, out, err = command_line("bench", "clock", "--seconds", "0.1", "--repeats", "1", "--json")
    rows = json.loads(out)["clock"]
    assert (code, err) == (OK, "") and list(command_line.folder.iterdir()) == []
    assert list(rows) == [f"{rate} Hz, {name}" for rate in (200, 1000, 2000) for name in clock.CONTENDERS]
    for name, row in rows.items():
        assert row["ticks"] + row["missed"] == 0.1 * int(name.split()[0])
        assert 0.0 <= row["period_p50_us"] <= row["period_p99_us"]


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
