"""Connection of the recorder to a companion: keys, signals, events, and the death of the companion."""

import json
import os
import select
import socket
import subprocess

import pytest

from cext.memory.shared_state import RECORD_ROW, SharedState
from cext.recording.ring_batch import Batch
from cext.schedule.mailbox_writer import Writer
from runtime.record.recorder.companion import Companion
from runtime.record.storage.format import row_struct


class Recording:
    def __init__(self):
        self.events = []

    def take_event(self, event):
        self.events.append(event)


class Ends:
    """Both ends of a connection, and the run beside it."""

    def __init__(self):
        self.shared, self.recording = SharedState(4096), Recording()
        ours, self.theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.process = subprocess.Popen(["sleep", "60"])
        self.companion = Companion(ours.detach(), self.recording, self.shared, os.pidfd_open(self.process.pid))

    def send(self, **message):
        self.theirs.send(json.dumps(message).encode())
        self.companion.look()

    def close(self):
        self.process.kill()
        self.process.wait()
        self.theirs.close()
        self.companion.socket.close()

    def received(self):
        return json.loads(self.theirs.recv(1 << 17))


@pytest.fixture
def ends(monkeypatch):
    posted = []
    monkeypatch.setattr(
        "runtime.record.recorder.companion.Writer",
        lambda shared: type("Posted", (), {"set": lambda self, changes: posted.append(changes)})(),
    )
    made = Ends()
    made.posted = posted
    yield made
    made.close()


def test_only_keys_that_the_companion_uses_are_sent(ends):
    assert not ends.companion.press("y")
    ends.send(keys=["y", "n"], status="1/36 y applies")
    assert ends.companion.press("y") and ends.received() == {"key": "y"}
    assert not ends.companion.press("s")
    assert "1/36 y applies" in str(ends.companion.parts())


def test_watched_signals_of_rows_are_sent(ends):
    row = row_struct(3)
    batch = Batch([(RECORD_ROW, row.pack(tick, 1e-5, 1.0, 10.0 * tick, 3.0)) for tick in range(300)])
    ends.companion.take([batch], 100.0)
    ends.send(watch=[1])
    ends.companion.take([(7, b"change"), batch], 100.0)
    first, second = ends.received()["rows"], ends.received()["rows"]
    assert len(first + second) == 300 and first[2] == [0.02, 20.0] and second[-1] == [2.99, 2990.0]


def test_events_are_recorded_and_needs_kept(ends):
    ends.send(keys=["y"])
    ends.send(event={"event": "optimise", "step": "proposal"})
    assert ends.recording.events == [{"event": "optimise", "step": "proposal"}]
    assert ends.companion.press("y")


def test_dead_companion_sets_fallback_and_frees_keys(ends):
    ends.send(keys=["y"], fallback=[[3, 6.0], [0, 0.5]])
    ends.companion.press("y")  # is never read: its end then resets the connection
    ends.theirs.send(json.dumps({"event": {"event": "last"}}).encode())
    ends.theirs.close()
    ends.companion.look()
    assert ends.posted == [[(3, 6.0), (0, 0.5)]] and not ends.companion.press("y")
    assert [event["event"] for event in ends.recording.events] == ["last", "companion"]
    [line] = ends.recording.events[1]["lines"]
    assert line.endswith("its last accepted parameters are restored. The run continues; space stops it")
    ends.companion.look()
    assert len(ends.recording.events) == 2


def test_companion_that_does_not_read_does_not_block(ends):
    ends.send(keys=["y"])
    for _ in range(10_000):
        ends.companion.press("y")


@pytest.mark.parametrize("end", [lambda ends: ends.shared.close(), lambda ends: ends.process.kill()])
def test_companion_that_ends_with_the_run_changes_nothing(ends, end):
    ends.send(fallback=[[0, 1.0]])
    end(ends)
    select.select([os.pidfd_open(ends.process.pid)], [], [], 0.0 if ends.shared.closed else 10.0)
    ends.theirs.close()
    ends.companion.look()
    assert (ends.posted, ends.recording.events) == ([], [])


def test_fallback_is_written_to_the_mailbox():
    made = Ends()
    made.send(fallback=[[0, 1.0]])
    made.theirs.close()
    made.companion.look()
    assert Writer(made.shared).mark() == 1  # letter 0 is in use
    made.close()
