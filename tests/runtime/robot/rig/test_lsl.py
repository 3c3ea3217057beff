"""The inlet of the Lab Streaming Layer on a rig: outlets of pylsl send, stop, restart and have the same name."""

import os
import re
import socket
import threading
import time
from contextlib import suppress

import numpy as np
import pytest

import runtime
from blocks.sensors.received import CHANNELS_LIMIT
from runtime.host.liblsl import Inlet, Outlet, found, load
from runtime.robot.rig.errors import Refused
from runtime.robot.rig.line import text_of
from runtime.robot.rig.lsl_line import open_line, select
from runtime.robot.rig.lsl_receiver import Rectified, receive
from tests.checkout import ROOT
from tests.optional import Library
from tests.runtime.runs import write

pylsl = Library("pylsl")

DIAGRAM = """
from blocks.recorders import CsvRecorder
from blocks.sensors import LslInlet
from graph import Diagram

with Diagram("emg", rate=200) as diagram:
    LslInlet(channels=(("biceps", "mV", "EMG 2"), ("count", "1")), timeout=10.0, name="emg")
    LslInlet(channels=(("biceps", "mV", "EMG 2"),), timeout=0.0, name="held")
    CsvRecorder()
"""


def outlet(name, source):
    """An outlet of two channels with labels, of which one has a unit as in XDF files."""
    info = pylsl.StreamInfo(name, "EMG", 2, 100, "float32", source)
    channels = info.desc().append_child("channels")
    for label, unit in (("count", ""), ("EMG 2", "microvolts")):
        channel = channels.append_child("channel")
        channel.append_child_value("label", label)
        channel.append_child_value("unit", unit)
    return pylsl.StreamOutlet(info)


class Sender(threading.Thread):
    """Sends until a folder has rows of a run; restarts, sends on, beside another outlet of its name; then ends."""

    def __init__(self, name, folder):
        super().__init__(daemon=True)
        self.folder = folder
        self.name_, self.stamps, self.restart = name, [], None
        self.outlet = outlet(name, "amplifier 1")

    def send(self, count, other=None):
        for number in range(count):
            if number % 50 == 20:  # one that was on its way for a second, which is dropped
                self.outlet.push_sample([-1.0, -1000.0], pylsl.local_clock() - 1.0)
                time.sleep(0.01)
            self.stamps.append(pylsl.local_clock())
            number = len(self.stamps) - 1
            self.outlet.push_sample([number, 1000.0 * number], self.stamps[-1])
            if other is not None:
                other.push_sample([-1.0, -1000.0])
            time.sleep(0.01)

    def run(self):
        while not any(path.stat().st_size > 60_000 for path in self.folder.glob("*.csv")):
            self.send(1)
        self.send(100)
        time.sleep(0.3)
        self.outlet = None
        other = outlet(self.name_, "amplifier 2")
        time.sleep(0.2)
        self.outlet, self.restart = outlet(self.name_, "amplifier 1"), len(self.stamps)
        self.send(300, other)
        time.sleep(0.3)  # an outlet that is closed drops what it has not yet sent
        self.outlet = None


@pytest.mark.soak  # liblsl took up to 3 s and more to find a restarted outlet, and the timeout is waited for
@pytest.mark.paced
def test_an_inlet_follows_its_own_outlet_through_a_restart_and_ends_the_run_when_it_is_stale(tmp_path):
    name = f"amplifier {os.getpid()}"
    sender = Sender(name, tmp_path / "recordings")
    sender.start()
    robot = write(tmp_path, DIAGRAM)
    rig = write(tmp_path, f'[device.emg]\nstream = "{name}"\n\n[device.held]\nstream = "{name}"\n', "lab.toml")
    trial = runtime.run(robot, 60.0, rig=rig, yes=True, record=str(tmp_path / "recordings"))
    sender.join()
    biceps, count, age = trial["emg.biceps"], trial["emg.count"], trial["emg.age"]
    assert np.array_equal(biceps, count) and np.all(np.diff(count) >= 0.0)  # 1000 µV are 1 mV; never that of the other
    sent = np.array(sender.stamps)[count.astype(int)]
    assert np.allclose(trial["emg.stamp"] - trial["emg.offset"], sent, rtol=0.0, atol=1e-6)
    assert np.abs(trial["emg.offset"]).max() < 1e-3  # the same clock
    resumed = np.argmax(count >= sender.restart)
    assert trial["emg.lost"][-1] >= 3
    assert 0 < resumed and 0.2 < age[:resumed].max() < 10.0 and count[-1] == len(sender.stamps) - 1
    assert trial.fault is not None and "emg" in str(trial.fault) and age[-1] > 9.9
    assert trial["held.biceps"][-1] == biceps[-1] and trial["held.age"][-1] > 9.9  # it alone ends no run


def test_a_stream_that_is_missing_or_ambiguous_is_refused():
    name = f"force {os.getpid()}"
    with pytest.raises(Refused, match=f"no stream in the network has the name {name!r}"):
        open_line("plate", name, "", [("count", "1")], rectify=0.0, max_delay=0.5)
    outlets = [outlet(name, "plate 1"), outlet(name, "plate 2")]
    with pytest.raises(Refused, match="2 streams have this name: plate . on .*, plate . on "):
        open_line("plate", name, "", [("count", "1")], rectify=0.0, max_delay=0.5)
    assert len(outlets) == 2


def test_channels_are_selected_by_label_and_converted():
    given = [("a", "microvolts"), ("b", "deg"), ("c", "furlongs")]
    places, scales, remarks = select("here", [("b", "rad"), ("c", "m"), ("a", "mV")], given)
    assert places == [1, 2, 0] and scales == pytest.approx([np.pi / 180.0, 1.0, 1e-3])
    assert remarks == ["here: channel 'c' has unit furlongs, it is taken as m"]
    assert select("here", [("x", "N")], [("", ""), ("", "")])[0] == [0]
    with pytest.raises(Refused, match="channel 'a' is in µV, the diagram expects N"):
        select("here", [("a", "N")], given)
    with pytest.raises(Refused, match="here has 0 channels 'd'"):
        select("here", [("d", "m")], given)


def test_numbers_arrive_exactly_unless_a_line_is_too_short():
    rng = np.random.default_rng(5)
    for count in (1, 20, 38):
        numbers = (rng.normal(size=count) * 10.0 ** rng.integers(-300, 300, count)).tolist()
        numbers[0] = 1795903895.123456  # s since 1970
        assert list(map(float, text_of(numbers).split(","))) == numbers
    many = text_of([-1.2345678912345678e-300] * CHANNELS_LIMIT)
    assert len(many) <= 960 and float(many.split(",")[-1]) == pytest.approx(-1.2345678912345678e-300, rel=1e-8)
    assert list(map(float, text_of([np.inf, -np.inf]).split(","))) == [np.inf, -np.inf]


def test_the_markers_of_the_page_give_the_angle_of_the_shank():
    page = (ROOT / "docs" / "how_to" / "lsl.md").read_text()
    emg, markers = re.findall(r"^```python\n(.*?)^```", page, re.DOTALL | re.MULTILINE)
    names = {"__name__": "sample"}
    exec(emg + markers, names)
    trial = runtime.run(names["diagram"], 2.0, plant=names["plant"])
    angle = trial["shank.y"][trial["mocap.received"] > 0]
    assert angle.max() == pytest.approx(0.5, abs=1e-3) and angle.min() == pytest.approx(-0.5, abs=1e-3)


def test_the_rectified_mean_of_a_sine_with_an_offset_is_its_mean_absolute_value():
    samples = [[40.0 + 3.0 * np.sin(2.0 * np.pi * 100.0 * k / 2000.0)] for k in range(4000)]
    rectified = Rectified(1, 5.0, 2000.0)
    rectified.of(samples[:2000])
    assert rectified.of(samples[2000:])[0] == pytest.approx(3.0 * 2.0 / np.pi, rel=0.02)


def described(name, *channels, rate=100):
    """An outlet of one source, whose channels have these labels and units."""
    info = pylsl.StreamInfo(name, "EMG", len(channels), rate, "float32", f"source of {name}")
    listed = info.desc().append_child("channels")
    for label, unit in channels:
        channel = listed.append_child("channel")
        channel.append_child_value("label", label)
        channel.append_child_value("unit", unit)
    return pylsl.StreamOutlet(info)


RESTARTS = {  # what a sender changes, by the first value that it then sends
    10.0: ((("b", "mV"), ("a", "mV")), 100),
    20.0: ((("a", "mV"), ("b", "V")), 100),
    30.0: ((("a", "mV"), ("b", "mV")), 2000),
    40.0: ((("a", "mV"), ("b", "mV")), 100),  # nothing
}


@pytest.mark.soak  # liblsl takes seconds to find a restarted outlet
@pytest.mark.paced
def test_a_sender_that_restarts_with_other_channels_is_not_received_until_it_has_the_first_ones_again():
    name, passed = f"restarts {os.getpid()}", set()
    sender = described(name, ("a", "mV"), ("b", "mV"))
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    ended, end = os.pipe()
    [info] = found(name)
    inlet = Inlet(info)
    receiver = threading.Thread(target=receive, args=(inlet, theirs, ended, [1], [1.0], 0.0, 5.0), daemon=True)
    receiver.start()
    ours.settimeout(0.01)

    def send(value, duration):
        until = time.monotonic() + duration
        while time.monotonic() < until and (value == 0.0 or 40.0 not in passed):
            sender.push_sample([0.0, value])
            with suppress(TimeoutError):
                passed.add(float(ours.recv(1000).split(b",")[1]))

    send(0.0, 1.0)
    for value, (channels, rate) in RESTARTS.items():
        sender = None
        time.sleep(0.2)
        sender = described(name, *channels, rate=rate)
        send(value, 8.0)
    os.write(end, b"\0")
    receiver.join(10.0)
    assert passed == {0.0, 40.0}


@pytest.mark.parametrize("name", ["Anna's EMG", "the \"left\" 'leg'", "Größe & <more>"])
def test_a_stream_of_any_name_is_found(name):
    name = f"{name} {os.getpid()}"
    outlet = Outlet(name, "EMG", f"source of {name}", [("a", "V")])
    assert len(found(name)) == len(found(name, f"source of {name}")) == 1
    outlet.close()


def test_a_stream_of_irregular_samples_is_shown_as_one_without_a_rate():
    name = f"irregular {os.getpid()}"
    outlet = Outlet(name, "EMG", f"source of {name}", [("a", "V")])
    opened = open_line("emg", name, "", [("a", "V")], rectify=0.0, max_delay=0.5)
    os.close(opened.fd)
    opened.close()
    outlet.close()
    assert opened.channel.endswith(", without a rate")
    with pytest.raises(Refused, match="rectify needs a stream with a sampling rate"):
        outlet = Outlet(name, "EMG", f"source of {name}", [("a", "V")])
        open_line("emg", name, "", [("a", "V")], rectify=20.0, max_delay=0.5)
    outlet.close()


def test_a_stream_that_is_lost_without_a_source_is_reported_in_one_line(capfd):
    name = f"lost {os.getpid()}"
    sender = pylsl.StreamOutlet(pylsl.StreamInfo(name, "EMG", 1, 100, "float32", ""))
    opened = open_line("emg", name, "", [("a", "V")], rectify=0.0, max_delay=0.5)
    del sender
    line = socket.socket(fileno=opened.fd)
    line.settimeout(20.0)
    assert line.recv(100) == b""  # the process has ended
    opened.close()
    line.close()
    told = [line for line in capfd.readouterr().err.splitlines() if "data_receiver" not in line and "INFO|" not in line]
    assert told == [
        f"tickwork: stream {name!r}: the stream is lost, and has no source_id by which it could be found again"
    ]


def test_a_stream_whose_texts_are_not_utf_8_is_received():
    name = f"latin {os.getpid()}"
    liblsl = load("a test")
    description = liblsl.lsl_create_streaminfo(name.encode(), b"EMG", 1, 100.0, 2, f"{name} 1".encode())
    channels = liblsl.lsl_append_child(liblsl.lsl_get_desc(description), b"channels")
    channel = liblsl.lsl_append_child(channels, b"channel")
    liblsl.lsl_append_child_value(channel, b"label", "Größe".encode("latin-1"))
    sender = liblsl.lsl_create_outlet(description, 0, 60)
    [info] = found(name, f"{name} 1")
    inlet = Inlet(info)
    assert [label for label, _ in inlet.about["channels"]] == ["Gr\ufffd\ufffde"]
    inlet.close()
    liblsl.lsl_destroy_outlet(sender)


def test_a_sample_that_is_nan_does_not_stay_in_the_rectified_values():
    rectified = Rectified(2, 5.0, 2000.0)
    rectified.of([[1.0, 2.0]])
    values = rectified.of([[1.0, 2.0], [np.nan, 2.1], [1.0, 2.2]])
    assert np.isnan(values[0]) and values[1] > 0.0
    assert np.isfinite(rectified.of([[1.1, 2.3], [1.2, 2.4]])).all()
