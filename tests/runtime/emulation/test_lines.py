"""`emulate` plays sensors on serial lines behind pseudo-terminals, and a run in another process sets them up as it
would real ones.
"""

import os
import signal

import pytest

from runtime.base.errors import OK
from tests.runtime.emulation.test_emulate import read_until
from tests.runtime.rig.test_sensor_runs import RIG, ROBOT
from tests.runtime.runs import Files, finished, started, write

pytestmark = pytest.mark.paced


def test_a_robots_sensors_are_found_by_their_serial_numbers_and_stream(tmp_path):
    robot = write(tmp_path, ROBOT, "robot.py")
    rig = write(tmp_path, RIG, "lab.toml")
    (tmp_path / "ports").mkdir()
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
        plant.send_signal(signal.SIGINT)
        out, err = plant.communicate(timeout=10)
    finally:
        plant.kill()
        plant.communicate()
    assert (plant.returncode, err) == (OK, "") and not list((tmp_path / "ports").iterdir())


POWERED = """
from blocks.actuators import CubeMars
from blocks.charge_pump import ChargePump
from blocks.logic import Not
from blocks.models import Limb
from graph import Diagram


def build():
    with Diagram("knee", rate=200) as diagram:
        CubeMars("AK80-9", bus="legs", name="knee", range=(-1.0, 1.0), wake_shift=0.0)(torque_command=0.0)
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
        run = finished(
            robot, "--rig", rig, "--yes", "--duration", "0.5", "--realtime", "off", "--no-record", cwd=tmp_path
        )
    finally:
        plant.kill()
        plant.communicate()
    assert run.returncode == OK, run.stderr
    assert (
        "zero torque, then disable: confirmed by knee" in run.stdout and "nothing stops" not in run.stdout + run.stderr
    )
    assert "power loss of the computer (the charge pump 'pump')" in " ".join(run.stderr.split())
