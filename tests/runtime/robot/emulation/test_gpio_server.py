"""Emulated GPIO lines over the socket, in one process."""

import os
import threading
import time

import pytest

from blocks.gpio import EmulatedGpio, EStopSwitch, GpioInput, SyncOut
from cext.lines.streams import Streams
from graph import StreamDevice
from runtime.host.errors import BadInput
from runtime.robot.emulation.gpio_server import GpioServer
from runtime.robot.guardian.plan_types import PlanRelay
from runtime.robot.guardian.relay import Relay
from runtime.robot.rig import gpio_line
from runtime.robot.rig.errors import Refused
from runtime.robot.rig.gpio_line import open_line
from tests.blocks.actuators.wire import TAKEN, Wired
from tests.blocks.test_gpio import BYTES, FALLING, LEVEL, LOST, PRESSED, RISING, event
from tests.runtime.runs import ROOT
from tests.runtime.test_documents import python_of

CHIP = "unix:chip"


@pytest.fixture
def connect(tmp_path, monkeypatch):
    """Function that returns (GpioServer, Stream of the run, Wired) of a kind of line at a level."""
    monkeypatch.chdir(tmp_path)
    started, streams = [], Streams()

    def connect(kind: type[StreamDevice], level: bytes | None):
        server = GpioServer("line", CHIP, "GPIO17")
        started.append(server)
        if level is not None:
            server.end.send(LEVEL, level)
        line = open_line("line", **kind(name="line", chip=CHIP, pin="GPIO17").opening())
        stream = streams.add(line.fd, record=line.record, is_gpio=line.is_gpio, level=line.level)
        os.close(line.fd)
        streams.start()
        stream.begin(time.monotonic_ns())
        return server, stream, Wired(kind)

    yield connect
    streams.end()
    for server in started:
        server.close()
    assert not list(tmp_path.iterdir())


def wait(done):
    deadline = time.monotonic() + 5.0
    while not done() and time.monotonic() < deadline:
        time.sleep(0.001)
    assert done()


def decoded(stream, wired, count):
    """Return the results of decode for the next frames."""
    frames = []

    def complete():
        frames.extend(stream.end.receive())
        return len(frames) >= count

    wait(complete)
    return [wired.hear(kind, data) for kind, _, data, _ in frames]


def test_level_on_connection_edges_and_their_times(connect):
    server, stream, line = connect(GpioInput, b"\1")
    assert decoded(stream, line, 1) == [TAKEN] and (line["on"], line["rises"]) == (1.0, 0.0)
    for number, kind in enumerate((FALLING, RISING), 1):
        server.end.send(BYTES, event(5, kind, number))
    assert decoded(stream, line, 2) == [TAKEN, TAKEN] and (line["rises"], line["falls"]) == (1.0, 1.0)
    assert 0.0 < line["fall_time"] <= line["rise_time"] < 5.0


def test_emergency_stop_is_pressed_when_the_chip_or_its_emulator_is_lost(connect):
    server, stream, switch = connect(EStopSwitch, b"\1")
    assert decoded(stream, switch, 1) == [TAKEN] and switch["pressed"] == 0.0
    server.end.send(LOST, b"")
    assert decoded(stream, switch, 1) == [PRESSED]


def test_guardian_changes_the_level_of_a_charge_pump(connect):
    server, stream, _ = connect(SyncOut, None)
    plan: PlanRelay = {"descriptor": stream.fileno(), "gpio": True, "frames": ["01", "00"], "hold": 10.0}
    relay = Relay(plan, time.monotonic_ns())
    levels = []
    for count in (1, 2):
        relay.change()
        wait(lambda: levels.extend(data for _, _, data, _ in server.end.receive()) or len(levels) == count)
    assert levels == [b"\1", b"\0"]


def test_input_without_a_level_is_rejected(connect, monkeypatch):
    monkeypatch.setattr(gpio_line, "LEVEL_TIMEOUT", 0.01)
    with pytest.raises(Refused) as caught:
        connect(EStopSwitch, None)
    assert caught.value.problem.message.endswith("no level")


def test_level_before_the_run_is_no_edge(connect):
    server, stream, line = connect(GpioInput, b"\0")
    server.end.send(BYTES, event(5, RISING, 1))
    wait(lambda: stream.counts["bytes"] == 48)
    stream.begin(time.monotonic_ns())
    assert decoded(stream, line, 1) == [TAKEN] and (line["on"], line["rises"]) == (1.0, 0.0)


def test_level_of_an_output_reaches_the_plant(connect):
    server, stream, _ = connect(SyncOut, None)
    emulator = Wired(EmulatedGpio)
    for level in (1, 0):
        stream.end.send(0, bytes([level]))
        frames = []
        wait(lambda: frames.extend(server.end.receive()) or frames)
        assert emulator.hear(frames[0][0], frames[0][2]) == TAKEN and emulator["on"] == level
    server.end.send(LOST, b"")
    wait(lambda: stream.gone)
    stream.end.send(0, b"\1")  # refused, without SIGPIPE
    assert stream.counts["refused"] == 1


def test_real_chip_and_second_emulator_are_rejected_and_a_missing_one_is_reported(connect):
    with pytest.raises(Refused) as caught:
        open_line("line", chip=CHIP, pin="GPIO4", active_low=False, output=True)
    assert "start `python -m runtime emulate`" in caught.value.problem.hint
    with pytest.raises(BadInput, match="a line of a real GPIO chip cannot be emulated"):
        GpioServer("line", "/dev/gpiochip0", "GPIO17")
    connect(SyncOut, None)
    with pytest.raises(BadInput, match="chip.GPIO17 has an emulator"):
        GpioServer("line", CHIP, "GPIO17")


def test_the_emergency_stop_of_the_page_is_pressed_by_its_program(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    [script] = python_of((ROOT / "docs/reference/rate.md").read_text())
    enter = threading.Event()
    names = {"input": lambda text: enter.wait(5.0)}
    program = threading.Thread(target=exec, args=(script.replace("/tmp/chip", "chip"), names))
    program.start()
    deadline, line = time.monotonic() + 5.0, None
    while line is None:
        try:
            line = open_line("stop", **EStopSwitch(name="stop", chip=CHIP, pin="GPIO17").opening())
        except Refused:
            assert time.monotonic() < deadline
    streams, switch = Streams(), Wired(EStopSwitch)
    stream = streams.add(line.fd, record=line.record, is_gpio=True, level=line.level)
    os.close(line.fd)
    streams.start()
    stream.begin(time.monotonic_ns())
    assert decoded(stream, switch, 1) == [TAKEN]
    enter.set()
    assert decoded(stream, switch, 1) == [PRESSED]
    program.join()
    streams.end()
    for end in ("run", "listener"):
        names[end].close()
