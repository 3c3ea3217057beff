"""The outlet of the Lab Streaming Layer, received by pylsl, as LabRecorder receives it."""

import json
import os
import threading

import numpy as np
import pytest

import runtime
from blocks.sinks import Lsl
from cext.memory.shared_state import RECORD_EVENT, SharedState
from runtime.record.analysis.xdf import start
from tests.optional import Library
from tests.runtime.record.recorder.running import counting, run

pylsl = Library("pylsl")


class Receiver(threading.Thread):
    """Receives the stream of a name until `end`."""

    def __init__(self, name):
        super().__init__(daemon=True)
        self.ended = threading.Event()
        [info] = pylsl.resolve_byprop("name", name, timeout=10.0)
        self.inlet, self.samples, self.stamps = pylsl.StreamInlet(info), [], []
        self.info = self.inlet.info(timeout=10.0)
        self.inlet.open_stream(timeout=10.0)
        self.start()

    def run(self):
        while True:
            ended = self.ended.is_set()
            sample, stamp = self.inlet.pull_sample(timeout=0.2)
            if sample is not None:
                self.samples.append(sample)
                self.stamps.append(stamp)
            elif ended:
                return

    def end(self):
        self.ended.set()
        self.join(10.0)

    @property
    def channels(self):
        """(label, unit, type) of each channel, where XDF tools read them."""
        channel, found = self.info.desc().child("channels").child("channel"), []
        for _ in range(self.info.channel_count()):
            found.append(tuple(map(channel.child_value, ("label", "unit", "type"))))
            channel = channel.next_sibling("channel")
        return found


@pytest.mark.paced
def test_a_receiver_gets_every_recorded_sample_with_its_time_and_the_marks(tmp_path):
    pylsl.__name__  # skips without the library
    name, received, shared = f"legs {os.getpid()}", [], SharedState(1 << 20)
    diagram = counting()
    with diagram:
        Lsl(stream=name)

    def before(recorder):
        received.extend([Receiver(name), Receiver(f"{name} events")])
        shared.push(RECORD_EVENT, json.dumps({"event": "note", "number": 1, "text": "Größe", "tick": 0}).encode())

    run(diagram, tmp_path, 100, virtual=False, shared=shared, before=before)
    signals, events = received
    signals.end()
    events.end()
    trial = runtime.load(tmp_path)
    assert (signals.info.type(), signals.info.nominal_srate()) == ("Signals", 200.0)
    assert signals.channels == [(path, trial.unit(path), "Signals") for path in trial.names]
    assert ("counter.value", "m", "Signals") in signals.channels
    assert np.array_equal(signals.samples, trial.rows) and len(trial) > 50
    began = (shared.began + shared.first_tick) * 1e-9
    assert np.allclose(signals.stamps, began + trial.time, rtol=0.0, atol=1e-6)
    assert start(trial) == pytest.approx(began, abs=1e-9)
    assert (events.info.type(), events.info.nominal_srate()) == ("Markers", 0.0)
    assert events.samples[0] == ["mark 1: Größe"] and events.samples[-1][0].startswith("end: ok")
    assert abs(events.stamps[-1] - signals.stamps[-1]) < 0.02
