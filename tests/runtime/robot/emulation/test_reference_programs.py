"""Programs of Epically Powerful 1.0.7 on emulated devices: its example scripts and its commands, as they are.

They run in an environment of their own, since the package requires a vendor's library and a web server. `make
reference` makes one and runs these tests; otherwise they are skipped, unless REFERENCE_PYTHON names the Python of one.
"""

import contextlib
import csv
import json
import os
import re
import signal
import socket
import subprocess
import time
from functools import partial
from pathlib import Path

import pytest

from tests.runtime.robot.emulation.test_emulate import read_until
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

VENDOR = """
import sys
import mscl

node = mscl.InertialNode(mscl.Connection.Serial(sys.argv[1], 115200))
node.timeout(5000)  # ms
node.setToIdle()
print(node.getBasicDeviceStatus().systemState(), node.getDiagnosticDeviceStatus().comPortInfo().bytesRead > 20)
for data_class in (mscl.MipTypes.CLASS_AHRS_IMU, mscl.MipTypes.CLASS_ESTFILTER):
    node.pollData(data_class, mscl.MipChannelFields())
    print(sorted({point.field() >> 8 for packet in node.getDataPackets(2000) for point in packet.data()}))
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
    if program.endswith(".py") and not os.path.isabs(program):
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
    """A row for each pass of its loop, and each pass reads the line once."""
    process = begun(bench, tmp_path, "ep-collect-imu-data", "-id", 154136, "-d", 2, "-o", "out.csv", "-r", 7)
    out, _ = process.communicate(timeout=60)
    assert process.returncode == 0 and "Data saved to out.csv" in out, out
    table = list(csv.DictReader((tmp_path / "out.csv").open()))
    assert len(table) == int(re.search(r"pin 7 was read (\d+) times", out)[1])
    times = [float(row["time"]) for row in table]
    assert times[0] == 0.0 and times == sorted(times) and {float(row["sync_7"]) for row in table} == {1.0}
    assert float(table[-1]["154136_acc_y"]) == pytest.approx(-2.0, abs=1e-4)


def test_the_vendors_library_reads_the_status_and_polls(bench, tmp_path):
    """MSCL: basic and diagnostic status, and one packet of each set in the stored format."""
    [port] = Path(bench["TICKWORK_PORTS"]).parent.glob("tty*")
    command = [PYTHON, "-c", VENDOR, port]
    found = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert found.stdout.splitlines() == ["3 True", "[128]", "[130]"], found.stderr


# What its window for a RobStride does: the buttons call these methods.
ROBSTRIDES = """
from epicallypowerful.toolbox.robstride_setup import RobstrideConfigure

tool = RobstrideConfigure(max_can_id=12)
print(sorted(tool.scan()))
print(tool.disable(3) is not None, tool.change_id(3, 9) is not None, tool.enable(9) is not None)
tool.available_devices = set()
print(sorted(tool.scan()))
print(tool.disable(9) is not None)
"""
PAIR = """
from blocks.actuators import actuators
from graph import Diagram

with Diagram("pair", rate=200) as diagram:
    for motor in actuators({3: "RS02", 5: "CyberGear"}).values():
        motor(torque_command=0.0)
"""


def test_the_setup_of_robstrides_finds_enables_and_renumbers_them(tmp_path):
    group = f"239.{10 + os.getpid() % 200}.{os.getpid() // 200 % 250}.79"
    rig = write(
        tmp_path,
        f'[bus.can]\ninterface = "udp_multicast"\nchannel = "{group}"\noptions = {{ port = 43114 }}\n',
        "pair.toml",
    )
    write(tmp_path, PAIR, "pair.py")
    write(tmp_path, ROBSTRIDES, "buttons.py")
    process = started("emulate", "pair.py", "--rig", rig, cwd=tmp_path)
    try:
        read_until(process.stdout, "Ctrl-C ends it")
        out, _ = begun({"REFERENCE_CAN": f"{group}:43114"}, tmp_path, str(tmp_path / "buttons.py")).communicate(
            timeout=PATIENCE
        )
        found = [line for line in out.splitlines() if line[:1] in "[TF"]
        assert found == ["[3, 5]", "True True True", "[5, 9]", "True"], out
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=10)


def test_dummy_data_of_both_are_read_by_one_parser(tmp_path):
    """PlotJuggler's: one JSON object per datagram, a number at the top named timestamp, numbers below it."""
    taken = {}
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server:
        server.bind(("127.0.0.1", 0))
        server.settimeout(PATIENCE)
        host, port = server.getsockname()
        for begin, *arguments in (
            (begun, {}, tmp_path, "ep-dummy-viz", "-ip", host, "-p", port),
            (partial(started, cwd=tmp_path), "plotjuggler", "--dummy", f"{host}:{port}"),
        ):
            sender = begin(*arguments)
            taken[begin] = json.loads(server.recv(65536))
            sender.kill()
            sender.communicate()
            server.setblocking(False)
            with contextlib.suppress(BlockingIOError):
                while server.recv(65536):
                    pass
            server.settimeout(PATIENCE)
    theirs, ours = taken.values()
    assert theirs["example_data"].keys() == {"sine", "cosine"} and isinstance(theirs["timestamp"], float)
    flat = [value for key, value in ours.items() if key != "timestamp"]
    while any(isinstance(value, dict) for value in flat):
        flat = [inner for value in flat for inner in (value.values() if isinstance(value, dict) else [value])]
    assert isinstance(ours["timestamp"], float) and len(flat) == 4
    assert all(isinstance(value, float) for value in flat)
