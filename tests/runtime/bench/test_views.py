"""`python -m runtime bench views`: everything is on where it says so. How late this machine is with that is not
tested.
"""

import json

import pytest

from runtime.base.errors import OK
from runtime.bench import views

pytestmark = pytest.mark.timing


def test_it_tells_how_late_the_loop_is_with_everything_on_and_with_nothing(command_line):
    code, out, err = command_line("bench", "views", "--seconds", "0.3", "--repeats", "1", "--json")
    told = json.loads(out)
    assert (code, err) == (OK, "")
    assert list(told["views"]) == [views.NONE, views.ALL] and told["problems"] == []
    for row in told["views"].values():
        assert (
            row["ticks"] + row["missed"] == 300
            and 0.0 < row["late_p50_us"] <= row["late_p99_us"] <= row["late_p99.9_us"]
        )
    assert [goal["what"] for goal in told["goals"]] == [
        "all viewers on, lateness p99",
        "all viewers on, records dropped",
    ]
    assert told["goals"][0]["value"] == pytest.approx(
        told["views"][views.ALL]["late_p99_us"] / told["views"][views.NONE]["late_p99_us"]
    )
    assert list(command_line.folder.iterdir()) == []


def test_there_are_as_many_signals_as_it_says(tmp_path):
    made = views.diagram(False, tmp_path, 9870)
    assert sum(len(block.outputs) for block in made) == views.SIGNALS
