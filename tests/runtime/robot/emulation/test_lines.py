"""`emulate` plays sensors on serial lines behind pseudo-terminals, and a run in another process sets them up as it
would real ones.
"""

import os
import signal

import pytest

from runtime.host.errors import BAD_INPUT, OK
from runtime.robot.emulation.lines import GPIO, NETWORK, TERMINALS
from runtime.robot.rig.streams import KINDS
from tests.runtime.record.panel.panels import Watched
from tests.runtime.robot.emulation.test_emulate import read_until
from tests.runtime.robot.rig.test_sensor_runs import RIG, ROBOT
from tests.runtime.robot.rig.test_udp import free_port
from tests.runtime.runs import Files, finished, started, write

pytestmark = pytest.mark.paced


def test_every_kind_of_line_of_a_rig_has_an_emulator():
    assert {*TERMINALS, NETWORK, GPIO} == {*KINDS} - {"lsl", "ros2"}  # any program can send these


def test_sensors_are_identified_by_serial_number_and_stream(tmp_path):
    robot = write(tmp_path, ROBOT, "robot.py")
    rig = write(tmp_path, RIG, "lab.toml")
    no_folder = finished("emulate", robot, "--rig", rig, "--lines", robot, cwd=tmp_path)
    assert no_folder.returncode == BAD_INPUT and "cannot create the folder: File exists" in no_folder.stderr
    plant = started("emulate", robot, "--rig", rig, "--lines", tmp_path / "ports", cwd=tmp_path)
    try:
        told = "".join(read_until(plant.stdout, "Ctrl-C ends it"))
        assert f"shank       terminal {tmp_path}/ports/ttyshank" in told and "TICKWORK_PORTS=" in told
        run = finished(
            robot,
            "--rig",
            rig,
            "--yes",
            "--duration",
            "0.5",
            "--record",
            "out",
            cwd=tmp_path,
            TICKWORK_PORTS=str(tmp_path / "ports" / "tty*"),
        )
        assert run.returncode == OK, run.stderr
        assert Files(tmp_path / "out").table["shank.accel[2] [m/s^2]"][-1] < -9.8
        plant.send_signal(signal.SIGTERM)
        out, err = plant.communicate(timeout=10)
    finally:
        plant.kill()
        plant.communicate()
    assert (plant.returncode, err) == (143, "stopped by SIGTERM\n") and not list((tmp_path / "ports").iterdir())


LINES = """
from blocks.controls import GameController
from blocks.gpio import EStopSwitch, GpioInput, SyncOut
from blocks.recorders import CsvRecorder
from blocks.safety import EStopHeartbeat
from blocks.sensors import Insole, Microcontroller
from blocks.sources import Sine
from graph import Diagram


def build():
    with Diagram("lines", rate=200) as diagram:
        Microcontroller((("accel", "int16[3]", "m/s²", 0.01),), packet_rate=100, name="shank")
        Insole(name="left", bus="left", side="left", address="127.0.0.1:{udp}")
        Insole(name="right", bus="right", side="right", transport="tcp", address="127.0.0.1:{tcp}")
        GameController(name="pad")
        EStopSwitch(name="stop")
        EStopHeartbeat(name="button", bus="button")
        GpioInput(name="input")
        SyncOut(name="output", duration=0.1)
        CsvRecorder()
    return diagram


def plant(robot):
    with Diagram("plant", rate=1000) as plant:
        robot["shank"].emulator(name="shank")(accel=(0.0, 1.0, -9.81))
        robot["left"].emulator(name="left")(force=700.0, centre=(0.1, 0.0))
        robot["right"].emulator(name="right")(force=300.0, centre=(0.2, 0.0))
        robot["pad"].emulator()(left_x=Sine(frequency=5.0)())
        robot["stop"].emulator()
        robot["button"].emulator()
        robot["input"].emulator()(level=robot["output"].emulator().on)
    return plant
"""


def test_line_of_every_kind_has_an_emulator_in_another_process(tmp_path):
    udp, tcp, button, peer = (free_port() for _ in range(4))
    robot = write(tmp_path, LINES.format(udp=udp, tcp=tcp), "robot.py")
    # the path of a socket has 107 bytes at most, so this one is not in the folder of the test
    chip = f'chip = "unix:/tmp/chip{os.getpid()}"'
    rig = write(
        tmp_path,
        f'[bus.button]\ninterface = "udp"\nchannel = "0.0.0.0:{button}"\npeer = "127.0.0.1:{peer}"\n'
        + f'[device.shank]\nport = "{tmp_path}/ttyshank"\n[device.pad]\ndevice = "{tmp_path}/ttypad"\n'
        + "".join(f'[device.{name}]\n{chip}\npin = "{name}"\n' for name in ("stop", "input", "output")),
        "lab.toml",
    )
    early = finished(robot, "--rig", rig, "--yes", "--duration", "0.3", "--no-record", cwd=tmp_path)
    assert early.returncode == BAD_INPUT and "start `python -m runtime emulate` with this rig first" in early.stderr
    plant = started("emulate", robot, "--rig", rig, "--lines", tmp_path, cwd=tmp_path)
    try:
        introduction = "".join(read_until(plant.stdout, "Ctrl-C ends it"))
        assert f"udp 127.0.0.1:{udp}" in introduction and f"tcp 127.0.0.1:{tcp}" in introduction
        assert f"socket /tmp/chip{os.getpid()}.stop" in introduction
        run = finished(robot, "--rig", rig, "--yes", "--duration", "0.3", "--record", "out", cwd=tmp_path)
        second = finished("emulate", robot, "--rig", rig, cwd=tmp_path)
        plant.send_signal(signal.SIGHUP)
        _, err = plant.communicate(timeout=10)
    finally:
        plant.kill()
        plant.communicate()
    assert (run.returncode, plant.returncode) == (OK, 129), run.stderr + err
    assert "stop is emulated by another process" in run.stdout + run.stderr
    table = Files(tmp_path / "out").table
    for side, force in (("left", 700.0), ("right", 300.0)):
        assert table[f"{side}.force [N]"][-1] == pytest.approx(force, rel=1e-4)
        assert table[f"{side}.corrupt"][-1] == 0
    assert table["shank.accel[2] [m/s^2]"][-1] == -9.81 and table["shank.lost"][-1] == 0
    assert table["shank.received"][-1] > 10
    assert max(table["pad.left_x"]) > 0.5 and table["button.count"][-1] > 5
    assert (table["stop.pressed"][-1], table["input.rises"][-1], table["input.falls"][-1]) == (0, 1, 1)
    rise, fall = table["input.rise_time [s]"][-1], table["input.fall_time [s]"][-1]
    assert 0.09 < fall - rise < 0.2  # kernel time
    assert second.returncode == BAD_INPUT and f"tcp 127.0.0.1:{tcp}: Address already in use" in second.stderr
    assert "Traceback" not in err + second.stderr


CHIPS = """
from blocks.imus import ICM20948, MPU9250
from blocks.recorders import CsvRecorder
from blocks.sensors import ADS1115, NAU7802
from graph import Diagram


def build():
    with Diagram("leg", rate=200) as diagram:
        MPU9250(name="shank", bus="chips", timeout=1.0, mux=0x70, channel=2)
        ICM20948(name="thigh", bus="chips", timeout=1.0, mux=0x70, channel=1, address=0x69)
        ADS1115(name="insole", bus="chips", timeout=1.0, channels=("a0", "a1"))
        NAU7802(name="handle", bus="chips", timeout=1.0, capacity=100.0)
        CsvRecorder()
    return diagram


def plant(robot):
    with Diagram("plant", rate=1000) as plant:
        robot["insole"].emulator(name="insole")(a0=1.0, a1=2.0)
        robot["shank"].emulator(name="shank", adjustment=(100, 128, 160))(mag=(10.0, 20.0, 30.0))
        robot["thigh"].emulator(name="thigh")(accel=(1.0, 2.0, 3.0))
        robot["handle"].emulator(name="handle")(ratio=0.0005)
    return plant
"""


@pytest.mark.soak
def test_chips_on_i2c_are_set_up_and_read_over_a_socket(tmp_path):
    robot = write(tmp_path, CHIPS, "robot.py")
    # a socket's path has 107 bytes at most, so this one is not in the folder of the test
    rig = write(tmp_path, f'[bus.chips]\ninterface = "i2c"\nchannel = "unix:/tmp/chips{os.getpid()}"\n', "lab.toml")
    early = finished(robot, "--rig", rig, "--yes", "--duration", "0.3", "--no-record", cwd=tmp_path)
    assert early.returncode == BAD_INPUT and "start `python -m runtime emulate` with this rig first" in early.stderr
    plant = started("emulate", robot, "--rig", rig, cwd=tmp_path)
    try:
        assert "thigh  id 0x70.1 0x69" in "".join(read_until(plant.stdout, "Ctrl-C ends it"))
        for folder in ("first", "second"):  # a second run sets the same chips up again
            run = finished(robot, "--rig", rig, "--yes", "--duration", "0.3", "--record", folder, cwd=tmp_path)
            assert run.returncode == OK, run.stderr
        plant.send_signal(signal.SIGINT)
        plant.communicate(timeout=10)
    finally:
        plant.kill()
        plant.communicate()
    table = Files(tmp_path / "second").table
    for name, value in {
        "insole.a0 [V]": 1.0,
        "insole.a1 [V]": 2.0,
        "shank.mag[0] [uT]": 10.0,
        "shank.mag[2] [uT]": 30.0,
        "thigh.accel[2] [m/s^2]": 3.0,
        "handle.counts": 1073742.0,
        "shank.errors": 0.0,
    }.items():
        assert table[name][-1] == pytest.approx(value, abs=0.1), name


POWERED = """
from blocks.actuators import CubeMars
from blocks.charge_pump import ChargePump
from blocks.logic import Not
from blocks.models import Limb
from graph import Diagram


def build():
    with Diagram("knee", rate=200) as diagram:
        CubeMars("AK80-9", bus="legs", name="knee", range=(-1.0, 1.0), wake_shift=0.0, timeout=1.0)(torque_command=0.0)
        ChargePump(name="pump", start_up=0.3)
    return diagram


def plant(robot):
    with Diagram("plant", rate=1000) as plant:
        relay = robot["pump"].emulator(name="relay")
        limb, drive = Limb(inertia=0.1, damping=0.1, stiffness=0.0, reflex=0.0), robot["knee"].emulator()
        limb(torque=drive.torque)
        drive(position=limb.position, velocity=limb.velocity, power_lost=Not()(relay.holds))
    return plant
"""


def test_a_drive_behind_the_relay_of_a_charge_pump_answers_because_the_run_toggles_its_line(tmp_path):
    robot = write(tmp_path, POWERED)
    channel = f"239.{10 + os.getpid() % 200}.{os.getpid() // 200 % 250}.77"
    rig = write(
        tmp_path,
        f'[bus.legs]\ninterface = "udp_multicast"\nchannel = "{channel}"\n\n[device.pump]\nport = '
        f'"{tmp_path}/ttypump"\n',
        "lab.toml",
    )
    plant = started("emulate", robot, "--rig", rig, "--lines", tmp_path, cwd=tmp_path)
    try:
        assert f"pump        terminal {tmp_path}/ttypump" in "".join(read_until(plant.stdout, "Ctrl-C ends it"))
        run = finished(robot, "--rig", rig, "--yes", "--duration", "0.5", "--no-record", cwd=tmp_path)
    finally:
        plant.kill()
        plant.communicate()
    assert run.returncode == OK, run.stderr
    assert (
        "zero torque, then disable: confirmed by knee" in run.stdout and "nothing stops" not in run.stdout + run.stderr
    )
    assert "suspend of the computer (the charge pump 'pump')" in " ".join(run.stderr.split())


HELD = """
from blocks.actuators import CubeMars
from blocks.gpio import GpioInput
from blocks.sinks import Panel
from graph import Block, Diagram, Output


class Presses(Block):
    \"\"\"Presses of a button: 1.3 s long, 0.3 s apart.\"\"\"

    level = Output("1", dtype=bool)

    def step(self, t):
        return t % 1.6 > 0.3


def build():
    with Diagram("knee", rate=200) as diagram:
        CubeMars("AK80-9", bus="legs", name="knee", range=(-1.0, 1.0), wake_shift=0.0, timeout=1.0)(torque_command=0.0)
        GpioInput(name="button")
        Panel(port={port}, lost="stop")
    return diagram


def plant(robot):
    with Diagram("plant", rate=1000) as plant:
        robot["knee"].emulator()(position=0.0, velocity=0.0)
        robot["button"].emulator()(level=Presses()())
    return plant
"""


@pytest.mark.hazard("H9h")
def test_a_held_button_does_not_arm_without_the_page_that_the_diagram_demands(tmp_path):
    port = free_port()
    robot = write(tmp_path, HELD.replace("{port}", str(port)))
    channel = f"239.{10 + os.getpid() % 200}.{os.getpid() // 200 % 250}.78"
    chip = f'chip = "unix:/tmp/held{os.getpid()}"\npin = "button"\n'
    rig = write(
        tmp_path,
        f'[bus.legs]\ninterface = "udp_multicast"\nchannel = "{channel}"\n\n[device.button]\n{chip}',
        "lab.toml",
    )
    plant = started("emulate", robot, "--rig", rig, cwd=tmp_path)
    try:
        read_until(plant.stdout, "Ctrl-C ends it")
        words = ("--arm-on", "button.on", "--duration", "0.5", "--stop-for", "0.2", "--no-record")
        with started(robot, "--rig", rig, *words, cwd=tmp_path) as run:
            try:
                read_until(run.stderr, "NOT armed: no page has the controls")  # with the table
                read_until(run.stderr, "NOT armed: no page has the controls")  # after the button was held
                page = Watched.open(f"http://127.0.0.1:{port}/")
                assert page.hello["simulated"] is False and page.status["state"] == "ready"
                page.operate()
                out, err = run.communicate(timeout=30)
            finally:
                run.kill()
    finally:
        plant.kill()
        plant.communicate()
    assert run.returncode == OK and "0.5 s at 200 Hz" in out, out + err
