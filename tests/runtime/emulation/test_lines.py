"""`emulate` plays sensors on serial lines behind pseudo-terminals, and a run in another process sets them up as it would real ones."""

import signal

from runtime.errors import OK
from tests.runtime.emulation.test_emulate import read_until
from tests.runtime.rig.test_sensor_runs import RIG, ROBOT
from tests.runtime.runs import Files, finished, started, write


def test_a_robots_sensors_are_found_by_their_serial_numbers_and_stream(tmp_path):
    robot = write(tmp_path, ROBOT, "robot.py")
    rig = write(tmp_path, RIG, "lab.toml")
    (tmp_path / "ports").mkdir()
    plant = started("emulate", robot, "--rig", rig, "--lines", tmp_path / "ports", cwd=tmp_path)
    try:
        told = "".join(read_until(plant.stdout, "Ctrl-C ends it"))
        assert f"shank       terminal {tmp_path}/ports/ttyshank" in told and "TICKWORK_PORTS=" in told
        run = finished(robot, "--rig", rig, "--yes", "--duration", "0.5", "--record", "out", cwd=tmp_path,
                       TICKWORK_PORTS=str(tmp_path / "ports" / "tty*"))
        assert run.returncode == OK, run.stderr
        assert Files(tmp_path / "out").table["shank.accel[2] [m/s^2]"][-1] < -9.8
        plant.send_signal(signal.SIGINT)
        out, err = plant.communicate(timeout=10)
    finally:
        plant.kill()
        plant.communicate()
    assert (plant.returncode, err) == (OK, "") and not list((tmp_path / "ports").iterdir())
