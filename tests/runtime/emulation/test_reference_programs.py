"""Programs of Epically Powerful 1.0.7 on emulated devices: its example scripts and its commands, as they are.

They run in an environment of their own, since the package requires a vendor's library and a web server. `make
reference` makes one and runs these tests; otherwise they are skipped, unless REFERENCE_PYTHON names the Python of one.
"""

import csv
import os
import re
import signal
import subprocess
import time
from pathlib import Path

import pytest

from tests.runtime.emulation.test_emulate import read_until
from tests.runtime.runs import started, write

PYTHON = os.environ.get("REFERENCE_PYTHON", "")
pytestmark = [
    pytest.mark.paced,
    pytest.mark.skipif(not PYTHON, reason="no environment with epicallypowerful: run `make reference`"),
]
HOST = Path(__file__).with_name("reference_host.py")
PATIENCE = 30.0  # s until a program shows what it should

ROBOT = """
from blocks.actuators import CubeMarsServo, actuators
from blocks.gpio import SyncIn
from blocks.imus import MPU9250, MicroStrain, OpenImu
from blocks.models import Limb
from blocks.recorders import CsvRecorder
from graph import Actuator, Diagram

with Diagram("bench", rate=200) as diagram:
    for motor in actuators({1: "AK80-9", 2: "RS02", 3: "CyberGear", 4: "AK80-9-V3.0"}).values():
        motor(torque_command=0.0)
    CubeMarsServo("AK80-9", can_id=5, name="servo")(current_command=0.0)
    OpenImu(bus="can", address=132, bitrate=1e6, name="openimu")
    MicroStrain("154136", name="microstrain")
    MPU9250(bus="i2c", name="mpu")
    SyncIn(name="sync")
    CsvRecorder()


def plant(robot):
    with Diagram("plant", rate=1000) as plant:
        for block in robot:
            if isinstance(block, Actuator):
                drive, limb = block.emulator(), Limb(inertia=0.1, damping=0.1, stiffness=0.0, reflex=0.0)
                limb(torque=drive.torque)
                drive(position=limb.position, velocity=limb.velocity)
        robot["openimu"].emulator()(accel=(0.5, -1.0, -9.5))
        robot["microstrain"].emulator()(accel=(1.0, -2.0, -9.0), gyro=(0.4, 0.0, 0.0))
        robot["mpu"].emulator()(accel=(3.0, -2.0, 9.0))
        robot["sync"].emulator()(level=True)
    return plant
"""
RIG = """
[bus.can]
interface = "udp_multicast"
channel = "{group}"

[bus.i2c]
interface = "i2c"
channel = "unix:{folder}/i2c"

[device.sync]
chip = "unix:{folder}/chip"
pin = "7"
"""


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """{variable of the environment: value} with which the programs find the emulated devices."""
    folder = tmp_path_factory.mktemp("bench")
    group = f"239.{10 + os.getpid() % 200}.{os.getpid() // 200 % 250}.78"
    rig = write(folder, RIG.format(group=group, folder=folder), "lab.toml")
    write(folder, ROBOT, "bench.py")
    process = started("emulate", "bench.py", "--rig", rig, "--lines", "ports", cwd=folder)
    read_until(process.stdout, "Ctrl-C ends it")
    yield {
        "REFERENCE_CAN": group,
        "REFERENCE_I2C": f"{folder}/i2c",
        "REFERENCE_GPIO": f"{folder}/chip.7",
        "TICKWORK_PORTS": f"{folder}/ports/tty*",
    }
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=10)
    assert err == "stopped by SIGINT (Ctrl-C)\n"


def begun(bench, folder, program, *arguments):
    if program.endswith(".py"):
        where = "import epicallypowerful, pathlib; print(pathlib.Path(epicallypowerful.__file__).parents[1])"
        site = subprocess.run([PYTHON, "-c", where], cwd=folder, capture_output=True, text=True, check=True).stdout
        program = f"{site.splitlines()[-1]}/examples/{program}"
    return subprocess.Popen(
        [PYTHON, "-u", str(HOST), program, *map(str, arguments)],
        cwd=folder,
        env={**os.environ, **bench},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def rows(process):
    """Yield the numbers of each row of a table on its terminal."""
    seen, deadline = [], time.monotonic() + PATIENCE
    for line in process.stdout:
        seen.append(line)
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if line.startswith("|") and all(re.fullmatch(r"-?\d+(\.\d+)?", cell) for cell in cells):
            yield [float(cell) for cell in cells]
        assert time.monotonic() < deadline, "".join(seen[-20:])
    raise AssertionError("it ended: " + "".join(seen[-20:]))


def shows(bench, folder, expected, program, *arguments, typed=""):
    """Run a program until it shows an expected row, end it with Ctrl-C, and return all it has shown.

    expected : function of a row
    """
    process = begun(bench, folder, program, *arguments)
    try:
        process.stdin.write(typed)
        process.stdin.close()
        found = []
        for row in rows(process):
            found.append(row)
            if expected(row):
                break
        process.send_signal(signal.SIGINT)
        process.stdout.read()
        process.wait(timeout=10)
    finally:
        process.kill()
        process.wait()
    return found


def near(*values):
    """Function of a row: whether its last columns have these values."""
    return lambda row: row[-len(values) :] == pytest.approx(values, abs=0.05)


@pytest.mark.parametrize("model, can_id", [("AK80-9", 1), ("RS02", 2), ("CyberGear", 3), ("AK80-9-V3", 4)])
def test_position_controller_moves_every_family(bench, tmp_path, model, can_id):
    """A sine of 90° amplitude, by a PD law with 5 N·m/rad."""
    moved = shows(
        bench, tmp_path, lambda row: abs(row[1]) > 0.3, "position_controller.py", typed=f"{model}\n{can_id}\n"
    )
    assert moved[0][0] == can_id and max(abs(row[1]) for row in moved) < 2.0


@pytest.mark.parametrize("model, can_id", [("AK80-9", 1), ("RS02", 2), ("AK80-9-V3", 4), ("AK80-9-servo", 5)])
def test_display_shows_every_family(bench, tmp_path, model, can_id):
    def rests(row):
        return len(row) == 4 and abs(row[3]) < 0.05

    shows(bench, tmp_path, rests, "display_actuator_data.py", typed=f"{model}\n{can_id}\n")
    shows(bench, tmp_path, rests, "ep-stream-actuator", "-at", model, "-ai", can_id)


@pytest.mark.parametrize(
    "program, arguments, typed",
    [
        ("impedance_controller.py", (), "AK80-9\n1\n"),
        ("sample_position_controller_with_visualizer.py", (), "AK80-9\n1\n127.0.0.1\n5556\n"),
        ("ep-sample-impedance-ctrl", ("-at", "RS02", "-ai", 2), ""),
        ("ep-sample-position-ctrl", ("-at", "RS02", "-ai", 2), ""),
        ("ep-sample-actuator-viz", ("-at", "AK80-9", "-ai", 1, "-ip", "127.0.0.1", "-p", 5556), ""),
    ],
)
def test_sample_controllers_hold_the_actuator(bench, tmp_path, program, arguments, typed):
    """Within 100 passes of their loop after it has started to obey: the program before may have left it in motion."""
    near = 0

    def holds(row):
        nonlocal near
        near = near + 1 if abs(row[1]) < 2.0 else 0
        return near > 100

    shows(bench, tmp_path, holds, program, *arguments, typed=typed)


@pytest.mark.parametrize(
    "program, arguments, typed",
    [
        ("imu_actuator_controller.py", (), "154136\nAK80-9\n1\n"),
        ("ep-sample-imu-ctrl", ("-at", "AK80-9", "-ai", 1, "-id", 154136, "-r", 200), ""),
    ],
)
def test_torque_follows_the_angular_rate_of_an_imu(bench, tmp_path, program, arguments, typed):
    """0.25 N·m·s/rad: a tenth of a newton metre at 0.4 rad/s."""
    shows(bench, tmp_path, lambda row: row[1:] == [0.1, 154136.0, 0.4], program, *arguments, typed=typed)


@pytest.mark.parametrize(
    "program, arguments, typed, values",
    [
        ("display_microstrain_imu_data.py", (), "154136\n", (1.0, -2.0, -9.0)),
        ("display_microstrain_imu_data_check.py", (), "154136\n", (0.4, 0.0, 0.0)),
        ("ep-stream-microstrain-imu", ("-id", 154136), "", (1.0, -2.0, -9.0)),
        ("display_mpu9250_imu_data.py", (), "", (3.0, -2.0, 9.0)),
        ("ep-stream-mpu9250-imu", ("--i2c-bus", 1), "", (3.0, -2.0, 9.0)),
        # as delivered: x and y exchanged, y and z negated
        ("display_open_imu_data.py", (), "132\n", (1.0, 0.5, 9.5)),
        ("ep-stream-open-imu", ("-id", 132), "", (1.0, 0.5, 9.5)),
    ],
)
def test_sensor_programs_show_what_the_sensors_measure(bench, tmp_path, program, arguments, typed, values):
    shows(bench, tmp_path, near(*values), program, *arguments, typed=typed)


def test_collected_imu_data_contains_the_synchronisation_line(bench, tmp_path):
    process = begun(bench, tmp_path, "ep-collect-imu-data", "-id", 154136, "-d", 2, "-o", "out.csv", "-r", 7)
    out, _ = process.communicate(timeout=60)
    assert process.returncode in (0, 1) and "Data saved to out.csv" in out, out
    table = list(csv.DictReader((tmp_path / "out.csv").open()))
    assert len(table) > 50 and float(table[-1]["154136_acc_y"]) == pytest.approx(-2.0, abs=1e-4)
    assert {float(row["sync_7"]) for row in table} == {1.0}
