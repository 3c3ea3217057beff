"""Game controllers and keyboards: Linux's events, through the thread that reads on a rig and in a plant."""

import os
import struct
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blocks.controls import EmulatedControls, GameController, Keyboard
from cext.lines.streams import Streams
from graph import Diagram, DiagramError
from runtime.robot.rig import evdev_line
from runtime.robot.rig.errors import Refused
from tests.blocks.actuators.wire import MALFORMED, TAKEN, Wired
from tests.blocks.running import player, run

NOTED, BYTES, LOST, BACK = 2, 0, 1, 2
KEY, AXIS = 1, 3


def event(kind, code, value):
    """struct input_event of <linux/input.h>."""
    return struct.pack("=qqHHi", 12, 345, kind, code, value)


@pytest.fixture(scope="module")
def pad():
    made = Wired(GameController)
    return lambda: Wired.again(made)


def test_sticks_are_shares_with_a_dead_zone_and_buttons_are_down_or_up(pad):
    wired = pad()
    assert wired.hear(BYTES, event(AXIS, 0, 32767) + event(AXIS, 4, -32768)) == TAKEN and (
        wired["left_x"],
        wired["right_y"],
    ) == (1.0, -1.0)
    for raw, share in (
        (0, 0.0),
        (3200, 0.0),
        (-3200, 0.0),
        (16384, (0.5 - 0.1) / 0.9),
        (-16384, -(0.5 - 0.1) / 0.9),
        (40000, 1.0),
    ):
        wired.hear(BYTES, event(AXIS, 0, raw))
        assert wired["left_x"] == pytest.approx(share, abs=5e-5)
    wired.hear(BYTES, event(KEY, 304, 1) + event(0, 0, 0))
    assert wired["a"] == 1.0 and wired["b"] == 0.0
    wired.hear(BYTES, event(KEY, 304, 0))
    assert wired["a"] == 0.0


def test_unplugged_device_or_missed_event_releases_controls(pad):
    for gone in (LOST, BYTES):
        wired = pad()
        wired.hear(BYTES, event(AXIS, 0, 32767) + event(KEY, 304, 1))
        assert (wired["left_x"], wired["a"], wired["connected"]) == (1.0, 1.0, 1.0)
        wired.hear(gone, b"" if gone == LOST else event(0, 3, 0))  # SYN_DROPPED
        assert (
            (wired["left_x"], wired["a"]) == (0.0, 0.0)
            and wired["connected"] == (gone != LOST)
            and wired["missed"] == (gone == BYTES)
        )


@given(data=st.binary(max_size=64), kind=st.integers(0, 5))
def test_any_bytes_are_accepted_or_rejected(data, kind, pad):
    wired = pad()
    answer = wired.hear(kind, data)
    assert answer == (NOTED if kind in (LOST, BACK) else TAKEN if kind == BYTES and len(data) % 24 == 0 else MALFORMED)
    assert -1.0 <= wired["left_x"] <= 1.0


def test_reader_thread_delivers_events(pad):
    """A pipe in the place of /dev/input/event0."""
    out, into = os.pipe()
    streams = Streams()
    stream = streams.add(out, "pad", record=24)
    os.close(out)
    streams.start()
    os.write(into, b"".join(event(AXIS, 1, value) for value in range(0, 30000, 100)))
    wired, deadline = pad(), time.monotonic() + 5.0
    while wired["left_y"] < 0.9 and time.monotonic() < deadline:
        for kind, _, data, _ in stream.end.receive():
            assert wired.hear(kind, data) == TAKEN
    streams.end()
    os.close(into)
    assert wired["left_y"] == pytest.approx((2 * (29900 + 32768) / 65535 - 1 - 0.1) / 0.9)


def test_controls_report_emulated_events():
    with Diagram("robot", rate=200) as robot:
        Keyboard(name="keys")
        GameController(name="pad", dead_zone=0.0)
    wave = np.sin(np.arange(600) / 50.0)
    with Diagram("plant", rate=1000) as plant:
        EmulatedControls.of(robot["keys"], name="keys")(space=player(wave > 0.5, "1", bool))
        EmulatedControls.of(robot["pad"], name="pad")(left_x=player(wave, "1"))
    recording = run(robot, 100, plant=plant, substeps=5)
    assert set(recording["keys.space"]) == {0.0, 1.0} and not recording["keys.up"].any()
    assert np.abs(np.diff(recording["pad.left_x"])).max() < 0.11 and recording["pad.left_x"].max() > 0.98


@pytest.mark.parametrize(
    "parameters, words",
    [
        ({"axes": (("x", "ABS_X"),)}, "an axis must be .name, code, minimum, maximum."),
        ({"buttons": (("go", "BTN_GO"),)}, "go: unknown code 'BTN_GO'"),
        ({"buttons": (("age", "KEY_A"),)}, "'age' cannot be the name of a port: it is reserved"),
        ({"axes": (("x", 0, 5, 5),)}, "x: the minimum must be below the maximum"),
    ],
)
def test_unknown_axis_or_button_is_reported(parameters, words):
    with pytest.raises(DiagramError, match=words):
        Keyboard(**parameters)


def test_missing_device_is_reported(tmp_path):
    (tmp_path / "file").write_text("")
    for device, words in (
        ("", "device is missing"),
        ("/dev/input/by-id/nothing", "No such file"),
        (str(tmp_path / "file"), "is not an input device"),
    ):
        with pytest.raises(Refused) as caught:
            evdev_line.open_line("pad", device)
        assert caught.value.problem.code == "TW127" and words in caught.value.problem.message
