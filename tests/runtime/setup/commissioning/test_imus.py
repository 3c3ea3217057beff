"""`scan` and `stream imu`: MicroStrain's sensors behind pseudo-terminals, real pyserial in between."""

import csv
import importlib.util
import json
import re
import threading

import pytest

from runtime.host.errors import BAD_INPUT, OK
from runtime.robot.emulation.gpio_server import GpioServer
from tests.blocks.test_gpio import BYTES, FALLING, LEVEL, RISING, event
from tests.runtime.record.recorder.rerun.test_rerun import vectors
from tests.runtime.robot.rig.test_microstrain import Sensors
from tests.runtime.runs import Listener

pytestmark = pytest.mark.paced


@pytest.fixture(scope="module")
def ports(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ports")
    sensors = Sensors(folder, "133931", "133932=3DM-CV7-AHRS")
    yield folder
    sensors.unplug()
    sensors.process.stdout.close()


@pytest.fixture(autouse=True)
def there(ports, monkeypatch):
    monkeypatch.setenv("TICKWORK_PORTS", str(ports / "tty*"))


def test_scan_lists_every_sensor_with_its_serial_number(command_line, ports):
    code, out, err = command_line("scan")
    assert (code, err) == (OK, "")
    assert f"port {ports}/tty133931  MicroStrain 3DM-GX5-25  serial 6253.133931, firmware 1.1.6, 5g, 300dps" in out
    told = json.loads(command_line("scan", "--json")[1])
    assert [sensor["serial"] for sensor in told["sensors"]] == ["6253.133931", "6286.133932"] and told["buses"] == []


@pytest.mark.soak
def test_two_are_shown_recorded_and_plotted(command_line):
    """In Rerun, where it is there, each channel has a plot, and an attitude its axes."""
    viewer = ["--rerun", "out.rrd"] if importlib.util.find_spec("rerun") else []
    with Listener() as listener:
        code, out, err = command_line(
            "stream",
            "imu",
            "3931",
            "3932",
            "--channels",
            "accel,quaternion",
            "--rate",
            "100",
            "--duration",
            "1",
            "--record",
            "out",
            "--plotjuggler",
            listener.address,
            *viewer,
        )
        told = listener.rest()
    assert (code, err) == (OK, "")
    assert re.search(r"imu_3931  accel +-?0\.000 +-?0\.000 +-9\.807 m/s²", out)
    assert re.search(r"^imu_3931: \d+ packets, 0 corrupt, 0 samples lost", out, re.MULTILINE)
    [file] = (command_line.folder / "out").glob("imu_*.csv")
    lines = file.read_text().splitlines()
    assert "imu_3931.accel[2] [m/s^2]" in lines[0] and "imu_3932.quaternion[0]," in lines[0]
    assert told[-1]["imu_3932"]["accel"][2] == pytest.approx(-9.80665)
    if viewer:
        seen = vectors(command_line.folder / "out.rrd")
        for sensor in ("imu_3931", "imu_3932"):
            ticks, accel = seen[f"/{sensor}/accel/m_per_s²"]
            assert ticks == sorted(ticks) and accel[-1] == pytest.approx([0.0, 0.0, -9.80665])
            assert (
                seen[f"/{sensor}/quaternion/values"][1][-1] == pytest.approx([1.0, 0.0, 0.0, 0.0])
                and len(seen[f"/{sensor}/euler/rad"][1][-1]) == 3
            )


def test_a_missing_device_is_reported_with_the_present_ones(command_line):
    code, _, err = command_line("stream", "imu", "77")
    assert code == BAD_INPUT and "TW127" in err and "6253.133931" in err


def test_a_synchronisation_input_is_recorded_beside_the_samples(command_line):
    chip = f"unix:{command_line.folder}/chip"
    server = GpioServer("sync", chip, "GPIO22")
    server.end.send(LEVEL, b"\0")
    edges = [event(0, kind, number) for number, kind in enumerate((RISING, FALLING, RISING), 1)]
    pulse = threading.Timer(0.6, lambda: [server.end.send(BYTES, edge) for edge in edges])
    pulse.start()
    arguments = ("--channels", "gyro", "--rate", "100", "--duration", "1.5", "--record", "out")
    code, out, err = command_line("stream", "imu", "3931", "--sync", f"{chip}:GPIO22", *arguments)
    pulse.join()
    server.close()
    assert (code, err) == (OK, "")
    assert "sync_GPIO22: 2 rising and 1 falling edges" in out and "on    1.000 1" in out
    [file] = (command_line.folder / "out").glob("imu_*.csv")
    rows = list(csv.DictReader(file.open()))
    levels = [float(row["sync_GPIO22.on"]) for row in rows]
    assert levels[0] == 0.0 and levels[-1] == 1.0 and levels == sorted(levels)
    assert [float(rows[-1][f"sync_GPIO22.{name}"]) for name in ("rises", "falls")] == [2.0, 1.0]


def test_a_synchronisation_input_that_cannot_be_opened_is_reported(command_line):
    code, _, err = command_line("stream", "imu", "3931", "--sync", "/dev/gpiochip77:GPIO22", "--duration", "1")
    assert code == BAD_INPUT and "/dev/gpiochip77 GPIO22" in err
