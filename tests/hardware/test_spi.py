"""SPI through the kernel: calls of spidev, served by a device in user space.

Under User Mode Linux, where test_user_mode_linux.py runs this file.
"""

import json
import math
import os
import subprocess
import sys

import pytest

from blocks.recorders import CsvRecorder
from blocks.sensors import AS5047
from graph import Diagram
from runtime.robot.rig.bus import RigBus
from runtime.robot.rig.i2c import SeveralRefused
from runtime.robot.rig.spi import SpiInterface
from tests.hardware.reading import newest
from tests.hardware.spi_device import CODE
from tests.hardware.vcan import REQUIRED

pytestmark = [
    pytest.mark.skipif(
        not os.environ.get(REQUIRED), reason="makes a device of the kernel: under User Mode Linux alone"
    ),
    pytest.mark.soak,
]
BUS = RigBus("joints", "spi", "/dev/spidev7", bitrate=500_000)


def test_an_encoder_is_read_by_messages_of_spidev():
    if not os.path.exists("/dev/cuse"):
        subprocess.run(["modprobe", "-d", "/run", "cuse"], check=True)
    device = subprocess.Popen(
        [sys.executable, "-m", "tests.hardware.spi_device"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert device.stdout is not None and device.stdout.readline()
    with Diagram("robot", rate=50) as robot:
        knee = AS5047(name="knee", bus="joints", rate=20.0, timeout=3.0)
        CsvRecorder()
    last = newest(robot, SpiInterface(BUS, [knee]), 50)
    mode, messages, transfers = json.loads(device.communicate("")[0])
    assert last["knee.position"] == pytest.approx(math.tau * CODE / 16384) and last["knee.errors"] == 0.0
    # three frames of 16 bits; the chip is deselected after the first and the second
    assert mode == 1 and messages > 10 and transfers == [[2, 500_000, 8, 1], [2, 500_000, 8, 1], [2, 500_000, 8, 0]]
    with Diagram("robot", rate=50):
        other = AS5047(chip_select=1)
    with pytest.raises(SeveralRefused, match="TW131.*/dev/spidev7.1: no such chip select"):
        SpiInterface(BUS, [other])
