"""`python -m tests.bench views`. The lateness of this machine is not tested."""

import json

import pytest

from runtime.host.errors import OK
from tests.bench import views, views_process

pytestmark = pytest.mark.soak


def test_lateness_is_reported_with_every_viewer_and_with_none(bench, tmp_path):
    code, out, err = bench("views", "--seconds", "0.3", "--repeats", "1", "--json")
    report = json.loads(out)
    assert (code, err) == (OK, "")
    assert list(report["views"]) == [views.NONE, views.ALL] and report["problems"] == []
    for row in report["views"].values():
        assert (
            row["ticks"] + row["missed"] == 300
            and 0.0 < row["late_p50_us"] <= row["late_p99_us"] <= row["late_p99.9_us"]
        )
    assert [goal["what"] for goal in report["goals"]] == [
        "all viewers on, lateness p99",
        "all viewers on, records dropped",
    ]
    assert report["goals"][0]["value"] == pytest.approx(
        report["views"][views.ALL]["late_p99_us"] / report["views"][views.NONE]["late_p99_us"]
    )
    assert list(tmp_path.iterdir()) == []


def test_the_diagram_has_as_many_signals_as_the_heading_states(tmp_path):
    made = views_process.diagram(False, tmp_path, 9870)
    assert sum(len(block.outputs) for block in made) == views_process.SIGNALS
