"""GPIO lines: Linux's records of edges, through the thread that reads on a rig and in a plant; and what libgpiod says
where there is no chip.

No machine of the tests has a chip of GPIO lines: what is not tried here are the two ioctls by which a level is read and
set, and libgpiod's own request of a line.
"""

import os
import socket
import struct
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blocks.actuators import CubeMars
from blocks.gpio import EmulatedGpio, EStopSwitch, GpioInput, SyncIn, SyncOut
from cext.lines.streams import Streams
from graph import Diagram
from runtime.robot.rig import gpio_line
from runtime.robot.rig.errors import Refused
from tests.blocks.actuators.wire import MALFORMED, TAKEN, Wired
from tests.blocks.running import player, run
from tests.cext.rigs import Rig, ends_in_the_safe_stop, plant_of

NOTED, PRESSED, ESTOP = 2, 5, -13
BYTES, LOST, BACK, LEVEL = 0, 1, 2, 3
RISING, FALLING = 1, 2


def event(when, kind, number, offset=17):
    """struct gpio_v2_line_event of <linux/gpio.h>."""
    return struct.pack("=QIIII6I", when, kind, offset, number, number, *[0] * 6)


@pytest.fixture(scope="module")
def wired():
    made = {kind: Wired(kind) for kind in (GpioInput, EStopSwitch)}
    return lambda kind: Wired.again(made[kind])


def test_level_edges_and_their_times(wired):
    line = wired(GpioInput)
    assert line["known"] == 0.0 and line.hear(LEVEL, b"\1") == TAKEN and (line["on"], line["known"]) == (1.0, 1.0)
    assert line.hear(BYTES, event(1_500_000_000, FALLING, 1)) == TAKEN and (
        line["on"],
        line["falls"],
        line["fall_time"],
    ) == (0.0, 1.0, 1.5)
    line.hear(BYTES, event(2_000_000_123, RISING, 2))
    assert (line["on"], line["rises"], line["missed"]) == (1.0, 1.0, 0.0) and line["rise_time"] == pytest.approx(
        2.000000123, abs=1e-12
    )
    line.hear(BYTES, event(3_000_000_000, FALLING, 7))  # the kernel's queue was full
    assert line["missed"] == 4.0
    line.hear(BYTES, event(3_000_000_000, FALLING, 0xFFFFFFFF))
    missed = line["missed"]
    line.hear(BYTES, event(3_000_000_000, RISING, 0))  # the numbers begin anew
    assert line["missed"] == missed
    line.hear(BYTES, event(3_000_000_000, FALLING, 3))
    assert line["missed"] == missed + 2.0
    assert line.hear(LOST, b"") == NOTED and line["known"] == 0.0


@given(data=st.binary(max_size=64))
def test_invalid_record_is_refused(data, wired):
    line = wired(GpioInput)
    answer = line.hear(BYTES, data)
    whole = len(data) == 48 and int.from_bytes(data[8:12], "little") in (RISING, FALLING)
    assert answer == (TAKEN if whole else NOTED if not data else MALFORMED) and line["known"] == whole


def test_reader_thread_delivers_records_with_run_clock_times(wired):
    """A pipe in the place of the chip: it has no level, and gives what was recorded."""
    out, into = os.pipe()
    streams = Streams()
    stream = streams.add(out, "switch", record=48, is_gpio=True)
    os.close(out)
    streams.start()
    began = time.monotonic_ns()
    stream.begin(began)
    os.write(
        into,
        b"".join(
            event(began + 1_000_000 * (number + 1), RISING if number % 2 == 0 else FALLING, number + 1)
            for number in range(21)
        ),
    )
    line, deadline = wired(GpioInput), time.monotonic() + 5.0
    while line["rises"] < 11.0 and time.monotonic() < deadline:
        for kind, _, data, _ in stream.end.receive():
            assert kind == BYTES and len(data) == 48
            line.hear(kind, data)
    streams.end()
    os.close(into)
    assert (line["rises"], line["falls"], line["missed"], line["on"]) == (11.0, 10.0, 0.0, 1.0)
    assert line["rise_time"] == pytest.approx(0.021, abs=1e-9) and line["fall_time"] == pytest.approx(0.020, abs=1e-9)


def test_a_chip_that_is_unplugged_is_lost(wired):
    here, there = socket.socketpair()
    streams = Streams()
    stream = streams.add(here.fileno(), record=48, is_gpio=True)
    here.close()
    streams.start()
    there.close()
    line, deadline = wired(EStopSwitch), time.monotonic() + 5.0
    answers = []
    while not answers and time.monotonic() < deadline:
        answers += [line.hear(kind, data) for kind, _, data, _ in stream.end.receive()]
    streams.end()
    assert answers == [PRESSED] and line["pressed"] == 1.0


def knee_with_switch(level, lost=False):
    """A knee commanded to 1 N·m, and an emergency stop whose line is at `level`, tick by tick."""
    with Diagram("robot", rate=200) as robot:
        CubeMars("AK10-9-V2.0", can_id=1, name="knee")(torque_command=1.0)
        EStopSwitch(name="stop")
    plant = plant_of(robot)
    with plant:
        EmulatedGpio(bus="stop", name="line")(
            level=player(level, "1", bool), lost=player(np.atleast_1d(lost), "1", bool)
        )
    return Rig(robot, plant)


@pytest.mark.parametrize("what", ["opened", "for one tick of the plant", "gone"])
def test_an_emergency_stop_on_a_line_ends_the_run_and_nothing_of_that_tick_is_sent(what):
    level, lost = np.ones(400, bool), np.zeros(400, bool)
    if what == "opened":
        level[60:] = False
    elif what == "gone":
        lost[60:] = True
    else:
        level[60] = False
    rig = knee_with_switch(level, lost)
    outcome = rig.run(200)
    assert (outcome.status, outcome.culprit) == ("e-stop", "stop") and 11 <= outcome.tick <= 13
    assert len(rig.commands()) == outcome.tick and ends_in_the_safe_stop(rig)


def test_button_pressed_while_arming_prevents_arming():
    rig = knee_with_switch(np.zeros(10, bool))
    outcome = rig.run(200)
    assert (outcome.status, outcome.culprit) == ("e-stop", "stop") and rig.commands() == []


def test_unknown_level_counts_as_pressed(wired):
    line = wired(EStopSwitch)
    assert line.say() == ESTOP
    assert line.hear(LEVEL, b"\1") == TAKEN and line.say() == []
    assert line.hear(BYTES, event(1, FALLING, 1)) == PRESSED and line.hear(BYTES, event(2, RISING, 2)) == TAKEN
    assert line["pressed"] == 0.0 and line.say() == ESTOP  # it was pressed, and let go


@given(data=st.binary(max_size=64), kind=st.integers(0, 9))
def test_unrecognised_record_counts_as_press(data, kind, wired):
    line = wired(EStopSwitch)
    answer = line.hear(kind, data)
    released = (kind == LEVEL and len(data) == 1 and data != b"\0") or (
        kind == BYTES and len(data) == 48 and int.from_bytes(data[8:12], "little") == RISING
    )
    assert answer == (TAKEN if released else PRESSED)


def test_external_edge_is_recorded_with_its_timestamp():
    with Diagram("robot", rate=200) as robot:
        SyncIn(name="mocap")
    level = np.zeros(2000, bool)
    level[503:1207] = True
    with Diagram("plant", rate=1000) as plant:
        EmulatedGpio(bus="mocap", name="mocap")(level=player(level, "1", bool))
    recording = run(robot, 300, plant=plant, substeps=5)
    on = recording["mocap.on"] > 0.0
    assert recording["mocap.rises"][-1] == recording["mocap.falls"][-1] == 1.0 and on.any() and not on[-1]
    assert recording["mocap.rise_time"][-1] == pytest.approx(0.503, abs=0.006)
    assert recording["mocap.fall_time"][-1] - recording["mocap.rise_time"][-1] == pytest.approx(0.704, abs=1e-6)


def test_pulse_is_sent_at_tick_0_and_on_request():
    with Diagram("robot", rate=200) as robot:
        SyncOut(name="sync", duration=0.05)(pulse=player([False] * 50 + [True, False], "1", bool))
    sent = []

    def listen(buses):
        sent.append(buses["sync"].device)

    recording = run(robot, 100, before=listen)
    high = recording["sync.high"] > 0.0
    assert list(np.flatnonzero(high)) == [*range(10), *range(50, 60)]
    assert [(frame[2], round(frame[3] * 1e-9, 3)) for frame in sent[0].receive()] == [
        (b"\1", 0.0),
        (b"\0", 0.05),
        (b"\1", 0.25),
        (b"\0", 0.3),
    ]


def test_missing_pin_chip_or_package_is_reported(monkeypatch):
    with pytest.raises(Refused) as caught:
        gpio_line.open_line("stop", **EStopSwitch(name="stop").opening())
    assert (
        caught.value.problem.code == "TW127" and caught.value.problem.message == '[device."stop"] has no chip and pin'
    )
    monkeypatch.setitem(__import__("sys").modules, "gpiod", None)
    with pytest.raises(Refused) as caught:
        gpio_line.open_line("stop", **EStopSwitch(name="stop", pin="GPIO17").opening())
    assert caught.value.problem.hint == "pip install 'tickwork[gpio]'"


def test_missing_chip_is_reported_with_its_path(tmp_path):
    pytest.importorskip("gpiod")
    with pytest.raises(Refused) as caught:
        gpio_line.open_line("button", **GpioInput(name="button", chip="/dev/gpiochip99", pin="17").opening())
    assert caught.value.problem.code == "TW127" and "no such chip" in caught.value.problem.message
    for path in ("/dev/null", str(tmp_path / "file")):
        (tmp_path / "file").write_text("")
        with pytest.raises(Refused) as caught:
            gpio_line.open_line("button", **GpioInput(name="button", chip=path, pin="GPIO17").opening())
        assert caught.value.problem.code in ("TW119", "TW127")
    with pytest.raises(Refused):
        gpio_line.open_line("sync", **SyncOut(name="sync", chip="/dev/gpiochip99", pin="4").opening())
