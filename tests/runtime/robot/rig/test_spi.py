"""SPI on a rig: lines of the rig file, chips that are missing, and runs over an emulated bus."""

import os
import re
import signal
import time
from argparse import Namespace
from pathlib import Path

import pytest

from blocks.sensors import AS5047, AS5048A
from blocks.sensors.as504x import with_parity
from graph import Diagram, DiagramError, compile
from runtime.host.errors import BAD_INPUT, OK
from runtime.robot.emulation.spi_server import SpiServer
from runtime.robot.rig.bus import RigBus
from runtime.robot.rig.buses import RigBuses
from runtime.robot.rig.errors import Refused, RigError
from runtime.robot.rig.file import parse
from runtime.robot.rig.i2c import SeveralRefused
from runtime.robot.rig.overrides import override
from runtime.robot.rig.spi import SpiInterface, hint_of_buses, in_words
from runtime.robot.rig.tool_bus import ToolBus
from runtime.setup.commissioning.bus import named_buses
from tests.runtime.robot.emulation.test_emulate import read_until
from tests.runtime.runs import Files, finished, started, write

RIG = '[bus.joints]\ninterface = "spi"\nchannel = "/dev/spidev0"\n'
ROBOT = """
from blocks.recorders import CsvRecorder
from blocks.sensors import AS5047, AS5048A
from graph import Diagram


def build():
    with Diagram("leg", rate=200) as diagram:
        AS5047(name="knee", bus="joints", timeout=0.5)
        AS5048A(name="hip", bus="joints", chip_select=1, invert=True, timeout=0.5)
        CsvRecorder()
    return diagram


def plant(robot):
    with Diagram("plant", rate=1000) as plant:
        robot["knee"].emulator(name="knee")(position=1.0)
        robot["hip"].emulator(name="hip")(position=-0.5, magnet=1)
    return plant
"""


@pytest.mark.parametrize(
    "line, words",
    [
        ("fd = true", "fd: not valid for an SPI bus"),
        ("bitrate = 20_000_000", "bitrate = 20000000: outside the range of the clock"),
        ('channel = "spidev0"', "expected a device file in /dev"),
        ('channel = "/dev/spidev0.1"', 'write channel = "/dev/spidev0", and chip_select = 1'),
    ],
)
def test_unsupported_option_is_refused(tmp_path, line, words):
    text = RIG.replace('channel = "/dev/spidev0"', line) if line.startswith("channel") else RIG + line
    with pytest.raises(RigError, match=words):
        parse(tmp_path / "lab.toml", text)


@pytest.mark.parametrize(
    "interface, words",
    [("i2c", 'use SPI.*interface = "spi" and channel = "/dev/spidev0"'), ("spi", "TW131.*no such chip select.*do_spi")],
)
def test_another_medium_and_a_bus_that_is_not_there(tmp_path, interface, words):
    rig = parse(tmp_path / "lab.toml", RIG.replace('"spi"', f'"{interface}"').replace("spidev0", "spidev77"))
    with Diagram("robot", rate=200) as robot:
        AS5047(bus="joints")
    override(rig, robot)
    with pytest.raises(RigError) as refused:
        RigBuses(rig, robot, ["joints"])
    assert re.search(words, " ".join(str(refused.value).split()))


def test_errors_of_opening_name_the_remedy(tmp_path):
    assert "TW132" in str(in_words("[bus.a] x", "/dev/null", PermissionError(13, "Permission denied")))
    with Diagram("robot", rate=200):
        device = AS5047()
    (tmp_path / "bus.0").write_text("")
    with pytest.raises(SeveralRefused, match="TW131.*is not an SPI bus"):
        SpiInterface(RigBus("a", "spi", str(tmp_path / "bus")), [device])
    (tmp_path / "spidev0.1").write_text("")
    assert f"there is {tmp_path}/spidev0.1; " in hint_of_buses(str(tmp_path))


def test_two_chips_at_one_chip_select_are_refused_and_the_load_is_computed():
    with Diagram("robot", rate=200) as robot:
        AS5047(bus="joints")
        AS5048A(bus="joints", chip_select=1, rate=1000.0)
    [load] = compile(robot).loads
    # 48 bits at 1 Mbit/s, and three gaps of 10 µs, 200 and 1000 times per second
    assert (load.typical, load.worst, load.frames) == pytest.approx((0.0576, 0.0936, 3600.0))
    with robot:
        AS5047(bus="joints", name="third")
    with pytest.raises(DiagramError, match="chip select 0"):
        compile(robot)


def test_a_chip_without_a_valid_reply_is_refused_and_the_thread_of_a_bus_has_its_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with Diagram("robot", rate=200):
        knee, hip = AS5047(name="knee"), AS5048A(name="hip", chip_select=1)
    server = SpiServer(Path("chips"), [(knee, knee.emulator())])
    try:
        wires = SpiInterface(RigBus("joints", "spi", "unix:chips"), []).wires
        wires.start()
        until = time.monotonic() + 5.0  # of the new thread, which names itself
        while "tickwork-spi\n" not in (names := [task.read_text() for task in Path("/proc/self/task").glob("*/comm")]):
            assert time.monotonic() < until, names
        wires.stop()
        answer = b"".join(with_parity(word).to_bytes(2, "big") for word in (0, 0x1234, 0x180))
        server.chips[0, 0].answers[0] = 1e12, answer
        with pytest.raises(SeveralRefused) as refused:
            SpiInterface(RigBus("joints", "spi", "unix:chips"), [knee, hip])
    finally:
        server.close()
    [problem] = refused.value.problems
    assert '[device."hip"] unix:chips, chip select 1: no valid reply of a AS5048A' in problem.message
    assert "error bit, as an input without a chip reads" in problem.message


def test_commands_for_all_buses_of_a_rig_leave_spi_out(tmp_path):
    rig = write(tmp_path, RIG + '[bus.legs]\ninterface = "socketcan"\nchannel = "can0"\n', "lab.toml")
    options = Namespace(rig=rig, bus=None, interface=None, channel=None, bitrate=None)
    assert [bus.name for bus in named_buses(options)] == ["legs"]
    options.bus = "joints"
    with pytest.raises(Refused, match="TW105.*has no drives"):
        ToolBus(named_buses(options)[0])


@pytest.mark.paced
def test_encoders_are_read_over_an_emulated_bus_and_the_record_replays(tmp_path):
    robot = write(tmp_path, ROBOT, "robot.py")
    # a socket's path has 107 bytes at most, so this one is not in the folder of the test
    rig = write(tmp_path, RIG.replace("/dev/spidev0", f"unix:/tmp/spi{os.getpid()}"), "lab.toml")
    early = finished(robot, "--rig", rig, "--yes", "--duration", "0.3", "--no-record", cwd=tmp_path)
    assert early.returncode == BAD_INPUT and "start `python -m runtime emulate` with this rig first" in early.stderr
    plant = started("emulate", robot, "--rig", rig, cwd=tmp_path)
    try:
        assert "hip  id CS1" in "".join(read_until(plant.stdout, "Ctrl-C ends it"))
        run = finished(robot, "--rig", rig, "--yes", "--duration", "0.5", "--record", "out", cwd=tmp_path)
        assert run.returncode == OK, run.stderr
        plant.send_signal(signal.SIGINT)
        plant.communicate(timeout=10)
        alone = finished(robot, "--rig", rig, "--yes", "--duration", "0.3", "--no-record", cwd=tmp_path)
        assert alone.returncode == BAD_INPUT
    finally:
        plant.kill()
        plant.communicate()
    files = Files(tmp_path / "out")
    for name, value in {
        "knee.position [rad]": 1.0,
        "hip.position [rad]": -0.5,
        "knee.magnet": 0,
        "hip.magnet": 1,
        "knee.errors": 0,
        "hip.errors": 0,
    }.items():
        assert files.table[name][-1] == pytest.approx(value, abs=3.9e-4), name
    replayed = finished("replay", files.one(".mcap"), cwd=tmp_path)
    assert replayed.returncode == OK, replayed.stdout + replayed.stderr
