"""Requests to a run as events of its recording: who has made them, also where another program has damaged them."""

import math

import pytest

from runtime.record.storage.changes import MARK, STOP, Changes, stopped_by
from runtime.record.storage.format import CHANGE


@pytest.mark.parametrize(
    "origin, writer, by",
    [
        (0, 4711, "set 4711"),
        (1, 4711, "keys"),
        (2, 0, "replay"),
        (3, 2, "page 2"),
        (77, 4711, "set 4711"),
        (-1, 5, "set 5"),
    ],
)
def test_an_event_names_who_has_made_the_request(origin, writer, by):
    records = [CHANGE.pack(tick, kind, origin, writer, -1, 3.0, 0.0, math.inf) for tick, kind in ((8, MARK), (9, STOP))]
    assert list(Changes([]).events(b"".join(records))) == [
        {"event": "mark", "number": 3, "tick": 8, "by": by},
        {"event": "stop", "tick": 9, "by": by},
    ]


@pytest.mark.parametrize(
    "origin, words", [("keys", "the space bar"), ("page 2", "page 2 of the panel"), ("set 4711", "process 4711")]
)
def test_who_has_stopped_a_run_in_words(origin, words):
    assert stopped_by(origin) == f"stopped by {words}"
