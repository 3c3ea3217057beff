"""The knee exoskeleton on a rig: a process of its own over real SocketCAN, drives in this one, and a third party that
listens.
"""

import re

import numpy as np
import pytest

from tests.hardware.drives import Drives, is_answer
from tests.hardware.vcan import ERROR, Node, needs_vcan
from tests.runtime.runs import (
    DISABLE,
    ENABLE,
    KNEE_EXO,
    NOTHING,
    TORQUE_STEP,
    Files,
    after_asking,
    finished,
    started,
    torque_of,
)

pytestmark = [needs_vcan, pytest.mark.soak]
RIG = """\
# the left leg was rebuilt
[bus.legs]
interface = "socketcan"
channel = "vcan0"

[device."left/knee"]
can_id = 3
invert = true
offset = 0.12
range = [-12.0, 12.0]
wake_shift = 0.0

[device."right/knee"]
range = [-12.0, 12.0]
wake_shift = 0.0
"""
MOTORS = {3: 0.3, 2: -0.2}  # rad, by id


@pytest.fixture
def rig(tmp_path):
    path = tmp_path / "lab.toml"
    path.write_text(RIG)
    return path


def commands(frames, identifier):
    """What a third party has heard that was said to one drive, as hex digits."""
    return [data.hex().upper() for number, data in frames if number == identifier and not is_answer(identifier, data)]


def test_the_diagram_of_the_simulation_runs_on_a_rig(rig, tmp_path):
    with Drives(MOTORS), Node() as listener:
        process = finished(
            KNEE_EXO,
            "--rig",
            rig,
            "--yes",
            "--rate",
            "50",
            "--duration",
            "1",
            "--record",
            tmp_path / "out",
            "--set",
            "left/knee.timeout=0.5",
            "--set",
            "right/knee.timeout=0.5",
            cwd=tmp_path,
        )
        frames = listener.heard()
    assert process.returncode == 0, process.stderr
    assert f"knee_exo: 1 s at 50 Hz, on the rig {rig}" in process.stdout
    assert "zero torque, then disable: confirmed by left/knee, right/knee" in process.stdout
    files = Files(tmp_path / "out")
    for identifier in MOTORS:
        said = after_asking(commands(frames, identifier))
        assert said[:2] == [ENABLE, NOTHING] and said[-2:] == [NOTHING, DISABLE]
        assert said == files.sent(identifier)
        torques = [torque_of(data) for data in said if data not in (ENABLE, DISABLE)]
        assert len(torques) >= 25 and max(map(abs, torques)) <= 12.0 + TORQUE_STEP
    assert not [number for number, _ in frames if number not in MOTORS]
    joints = {side: files.table[f"{side}/knee.position [rad]"] for side in ("left", "right")}
    step = 25.0 / 65535  # rad, a code of position
    assert joints["left"] == pytest.approx(np.full(joints["left"].size, -0.3 - 0.12), abs=step)
    assert joints["right"] == pytest.approx(np.full(joints["right"].size, 0.2), abs=step)  # inverted by the diagram
    ages = files.table["left/knee.age [s]"]
    assert 0.0 <= ages.min() and np.median(ages) < 0.04  # of the last tick's answer
    sidecar = files.sidecar
    assert sidecar["metadata"]["rig"] == {"file": str(rig), "text": RIG, "settings": {}} and not sidecar["simulated"]
    [event] = [event for event in sidecar["events"] if event["event"] == "buses"]
    assert (event["legs"]["channel"], event["legs"]["worst_state"], event["legs"]["strangers"]) == (
        "vcan0",
        "active",
        0,
    )
    assert sidecar["ended"] == "ok"
    again = finished("replay", files.one(".mcap"), cwd=tmp_path)  # with nothing connected, as the rig had it
    assert again.returncode == 0 and "are the same, bit for bit" in again.stdout, again.stdout + again.stderr


def test_drives_that_lose_power_end_the_run_in_the_safe_stop(rig, tmp_path):
    with Drives(MOTORS) as drives, Node() as listener:
        words = [KNEE_EXO, "--rig", rig, "--yes", "--rate", "50", "--no-record"]
        process = started(*words, cwd=tmp_path)
        frames = []
        while len(frames) < 100:
            frames += listener.heard()
        drives.cut_power()
        out, err = process.communicate(timeout=30)
        frames += listener.heard()
    assert process.returncode == 3 and re.search(
        r"FAULT at (left|right)/knee, .*: no reply for longer than its "
        r"timeout \(0.1 s\)",
        err,
    )
    assert "NOT confirmed by left/knee, right/knee" in out
    for identifier in MOTORS:
        said = after_asking(commands(frames, identifier))
        stop = said[said.index(DISABLE) - 1 :]
        assert len(stop) > 10 and set(stop) == {NOTHING, DISABLE}  # again and again, as nobody confirms


def test_a_rig_without_replies_reports_the_ids_received_instead(rig, tmp_path):
    with Node() as stranger:
        process = started(KNEE_EXO, "--rig", rig, "--yes", "--rate", "50", "--no-record", cwd=tmp_path)
        while not stranger.heard():
            pass
        stranger.send(0x181, b"hello")
        _, err = process.communicate(timeout=30)
    assert process.returncode == 3
    assert "no reply from left/knee (id 3 on bus legs), right/knee (id 2 on bus legs)" in err
    assert "1 frames were received, 1 of them with an unknown ID (unknown IDs on legs: 181)" in err


def test_bus_off_ends_the_run_with_a_remedy(rig, tmp_path):
    with Drives(MOTORS), Node() as controller:
        process = started(KNEE_EXO, "--rig", rig, "--yes", "--rate", "50", "--no-record", cwd=tmp_path)
        frames = []
        while len(frames) < 100:
            frames += controller.heard()
        controller.send(ERROR | 0x040, bytes(8))
        out, err = process.communicate(timeout=30)
        frames += controller.heard()
    assert process.returncode == 3 and "FAULT at legs" in err and "vcan0 is bus-off after too many errors" in err
    assert "120 Ω at both ends" in err and "confirmed by left/knee, right/knee" in out
    for identifier in MOTORS:
        assert commands(frames, identifier)[-2:] == [NOTHING, DISABLE]
