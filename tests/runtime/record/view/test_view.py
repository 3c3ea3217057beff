"""The process of `view`, without a browser: what it sends, whom it refuses, and how it ends."""

import json
import signal
import socket
import struct
import subprocess
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

import runtime
from tests.checkout import ROOT
from tests.runtime.record.panel.panels import free_port
from tests.runtime.record.view.recorded import SIGNALS, TORQUE, trial, viewing
from tests.runtime.runs import environment
from tests.soaking import soaked


class Page:
    """A page without a browser."""

    def __init__(self, address, **headers):
        host = address.removeprefix("http://").rstrip("/")
        headers = {"origin": f"http://{host}", **headers}
        self.socket = connect(f"ws://{host}/socket", compression=None, max_size=None, **headers).__enter__()
        self.hello = self.take("hello")["recordings"]
        while min(self.take("progress")["shares"]) < 1.0:
            pass

    def take(self, kind):
        while True:
            message = self.socket.recv(timeout=30)
            if isinstance(message, bytes) and kind == "window":
                return message
            if isinstance(message, str) and (found := json.loads(message))["type"] == kind:
                return found

    def ask(self, **question):
        self.socket.send(json.dumps({"id": 7, **question}))

    def window(self, signals, begin, end, width=100.0, recording=0):
        """(head, {signal: (time, low, high, broken)})"""
        self.ask(do="window", recording=recording, signals=signals, begin=begin, end=end, width=width)
        message = self.take("window")
        [length] = struct.unpack_from("<I", message)
        head, doubles, found = json.loads(message[4 : 4 + length]), np.frombuffer(message[4 + length :]), {}
        for piece in head["pieces"]:
            count, places = piece["count"], piece["signals"]
            time, doubles = doubles[:count], doubles[count:]
            parts = doubles[: 3 * count * len(places)].reshape(3, len(places), count)
            doubles = doubles[parts.size :]
            found |= {place: (time, *parts[:, row]) for row, place in enumerate(places)}
        assert len(doubles) == 0
        return head, found


def test_a_page_gets_the_samples_of_the_recording_in_units_for_people(tmp_path):
    path = trial(tmp_path, "walk")
    recorded = runtime.load(path)
    with viewing(tmp_path, path) as (process, address):
        page = Page(address)
        [described] = page.hello
        assert [signal["path"] for signal in described["signals"]] == [text.split()[0] for text in SIGNALS]
        assert [described["signals"][2][key] for key in ("block", "port", "shown")] == ["knee, left", "position", "°"]
        assert [(event["time"], event["kind"], event["text"]) for event in described["events"]] == [
            (4.0, "mark", "Mark 1: new shoes"),
            (6.0, "change", "law, left: gain 1 to 2.5 (page 2)"),
            (7.0, "warning", "knee, left: the motor is warm"),
            (0.0, "end", "The run has ended"),
        ]
        head, found = page.window([2, TORQUE], 1.0, 1.95, 1000.0)
        assert head["id"] == 7 and {piece["size"] for piece in head["pieces"]} == {1}
        time, low, high, broken = found[2]
        rows = np.searchsorted(recorded.tick, np.round(time * recorded.about["rate"]))
        np.testing.assert_allclose(low, np.degrees(recorded["left/knee.position"][rows]), rtol=1e-15)
        assert (low == high).all() and not broken.any()
        assert np.isnan(found[TORQUE][1][found[TORQUE][3] > 0]).all() and found[TORQUE][3].sum() == 40
        page.ask(do="average", of=[[0, None, None], [0, 5.0, 9.0]], paths=["left/knee.torque", "left/gait.phase"])
        answer = page.take("average")
        assert [leg["title"] for leg in answer["legs"]] == ["left", "right"] and answer["problems"] == []
        whole, part = answer["legs"][1]["of"]
        assert whole["strides"] > part["strides"] >= 2
        assert whole["curves"]["angle"]["mean"] == pytest.approx(
            np.degrees(recorded.strides("right/knee.position").mean(axis=0)), abs=0.5
        )
        assert [signal["path"] for signal in answer["signals"]] == ["left/gait.phase"]  # a leg has the torque already
        process.send_signal(signal.SIGINT)
        assert process.wait(30) == 0
        with pytest.raises(ConnectionClosed):
            page.take("none")


def damaged(path):
    """Destroy bytes in the middle of a file."""
    data = bytearray(Path(path).read_bytes())
    middle = len(data) // 2
    data[middle : middle + 64] = bytes(64)
    Path(path).write_bytes(data)


def test_a_damaged_recording_is_reported_and_shown_without_what_is_lost(tmp_path):
    path = trial(tmp_path, "walk", ticks=20_000)  # several chunks
    damaged(path)
    [(before, after)] = runtime.load(path).gaps
    with viewing(tmp_path, path) as (process, address):
        page = Page(address)
        assert "is damaged" in page.hello[0]["trouble"] and page.hello[0]["gaps"] == [[before, after]]
        for width in (100.0, 4000.0):
            time, _, _, broken = page.window([0], before - 1.0, after + 1.0, width)[1][0]
            assert not ((before + 0.5 < time) & (time < after - 0.1)).any() and not broken.any()
            assert time[0] < before and time[-1] > after
        process.send_signal(signal.SIGTERM)
        assert process.wait(30) == 143
        assert f"tickwork: {Path(path).name} is damaged" in process.stderr.read()


def test_only_the_pages_of_this_process_connect_and_malformed_questions_end_them(tmp_path):
    with viewing(tmp_path, trial(tmp_path, "walk", ticks=900)) as (process, address):
        for origin in ("http://evil.example", None, address.replace("127.0.0.1", "evil.example").rstrip("/")):
            with pytest.raises(InvalidStatus):
                Page(address, origin=origin)
        with pytest.raises(urllib.error.HTTPError) as refused:
            urllib.request.urlopen(f"{address}../view.py")
        assert refused.value.code == 404
        question = {"do": "window", "id": 1, "recording": 0, "signals": [0], "begin": 0.0, "end": 1.0, "width": 10.0}
        for wrong in (
            {"recording": 1},
            {"signals": [99]},
            {"signals": [-1]},
            {"width": 1e9},
            {"end": None},
            {"do": "stop"},
        ):
            page = Page(address)
            page.socket.send(json.dumps({**question, **wrong}))
            with pytest.raises(ConnectionClosed):
                page.take("window")
            assert page.socket.close_code == 1008, wrong
        page = Page(address)
        assert page.window([0], 2.0, 1.0, 10.0)[0]["problem"] == ""  # an empty window
        assert page.window([], 0.0, 1.0, 10.0)[1] == {}
        page.ask(do="average", of=[[0, 1e9, 2e9]], paths=["left/imu.nothing"])
        assert page.take("average")["legs"] == []


@pytest.mark.parametrize(
    "options, words, opens", soaked([([], "%s &", True), (["--no-browser"], "%s &", False), ([], "%s", False)], but=[0])
)
def test_the_page_is_opened_in_a_browser_that_leaves_the_terminal(tmp_path, options, words, opens):
    (script := tmp_path / "browser").write_text(f"#!/bin/sh\necho $1 > {tmp_path / 'opened'}\n")
    script.chmod(0o755)
    env = environment(DISPLAY=":9", BROWSER=f"{script} {words}")
    with viewing(tmp_path, trial(tmp_path, "walk", ticks=10), options=options, env=env) as (process, address):
        Page(address)
        for _ in range(100 if opens else 1):
            if (tmp_path / "opened").exists():
                break
            time.sleep(0.02)
        assert (tmp_path / "opened").exists() is opens


def test_the_command_needs_nothing_that_was_compiled():
    text = "import sys, runtime.cli.view; print({'cext', 'graph', 'blocks', 'matplotlib'} & {*sys.modules})"
    assert subprocess.run([sys.executable, "-c", text], cwd=ROOT, capture_output=True, text=True).stdout == "set()\n"


def test_wrong_arguments_are_refused_in_one_line(command_line, tmp_path):
    path = trial(tmp_path, "walk", ticks=10)
    assert command_line.refused("view").startswith("no recording given: pass the .mcap file of a run")
    assert command_line.refused("view", "nothing.mcap") == "nothing.mcap: No such file or directory"
    (other := tmp_path / "notes.mcap").write_text("notes")
    assert "is not a recording of Tickwork" in command_line.refused("view", other)
    assert command_line.refused("view", path, "--port", "70000") == "--port 70000: at most 65535"
    assert command_line.refused("view", path, "--prot", "80").startswith(
        "there is no option --prot; did you mean '--port'?"
    )
    seven = [tmp_path / f"{number}.mcap" for number in range(7)]
    assert command_line.refused("view", *seven) == "7 recordings: at most 6 can be distinguished. Pass fewer"
    with socket.create_server(("127.0.0.1", port := free_port())):
        assert command_line.refused("view", path, "--port", port) == (
            f"cannot listen on 127.0.0.1: port {port} is in use. Pass another one, as in --port 8500"
        )
