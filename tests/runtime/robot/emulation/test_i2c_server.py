"""Exchanges with emulated chips over the socket, in one process."""

import errno
import socket
from pathlib import Path

import pytest

from blocks.i2c import CHANNELS
from blocks.sensors import ADS1115
from cext.lines.i2c_socket import SocketAdapter
from graph import Diagram
from runtime.host.errors import BadInput
from runtime.robot.emulation.i2c_server import I2cServer

CONVERSION, CONFIG, MUX = 0x00, 0x01, 0x70


@pytest.fixture
def bus(tmp_path, monkeypatch):
    """(I2cServer of an ADS1115 behind channel 2 of a multiplexer, its device, adapter of a run)."""
    monkeypatch.chdir(tmp_path)
    with Diagram("robot", rate=200):
        device = ADS1115(name="insole", bus="chips", channels=("a0", "a1"), mux=MUX, channel=2)
    server = I2cServer(Path("chips"), [(device, device.emulator())])
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as end:
        end.connect("chips")
        adapter = SocketAdapter(end.fileno())
    yield server, device, adapter
    server.close()
    assert not list(tmp_path.iterdir())


def answer(server, device, number, volts):
    """Put an answer of the emulator on the bus: a code, and the configuration that was converted."""
    name = device.channels[number]
    data = volts.to_bytes(2, "big") + device.configuration(name).to_bytes(2, "big")
    server.chips[device.place, device.address].answers[number] = 1e12, data


def test_the_answer_of_the_channel_that_was_selected_is_read(bus):
    server, device, adapter = bus
    with pytest.raises(OSError) as refused:
        adapter.exchange_bytes(device.address, CONVERSION, count=2)
    assert refused.value.errno == errno.EREMOTEIO  # the channel of the multiplexer is closed
    adapter.exchange_bytes(MUX, -1, bytes((1 << device.place - 1 - CHANNELS * (device.mux - MUX),)))
    with pytest.raises(OSError):
        adapter.exchange_bytes(device.address, CONVERSION, count=2)  # the emulator is silent
    for number in (0, 1):
        answer(server, device, number, 100 + number)
    for number in (1, 0, 1):
        adapter.exchange_bytes(device.address, CONFIG, device.configuration(device.channels[number]).to_bytes(2, "big"))
        assert int.from_bytes(adapter.exchange_bytes(device.address, CONVERSION, count=2), "big") == 100 + number
    with pytest.raises(OSError):
        adapter.exchange_bytes(0x20, CONVERSION, count=2)


def test_an_adapter_without_a_server_reports_an_error(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    server = I2cServer(Path("chips"), [])
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as end:
        end.connect("chips")
        adapter = SocketAdapter(end.fileno())
    server.close()
    with pytest.raises(OSError) as lost:
        adapter.exchange_bytes(0x48, CONFIG, count=2)
    assert lost.value.errno == errno.EREMOTEIO


def test_a_path_that_cannot_be_written_is_bad_input(tmp_path):
    with pytest.raises(BadInput, match="Choose a folder"):
        I2cServer(tmp_path / "nowhere" / "chips", [])
