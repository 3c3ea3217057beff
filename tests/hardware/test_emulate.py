"""`emulate` on real SocketCAN: the plant in one process, the knee exoskeleton in another, vcan0 between them."""

import signal

import pytest

from tests.hardware.vcan import needs_vcan
from tests.runtime.robot.emulation.test_emulate import read_until
from tests.runtime.runs import KNEE_EXO, finished, started

pytestmark = [needs_vcan, pytest.mark.soak]


def test_the_knee_exoskeleton_walks_against_its_plant_on_vcan(tmp_path):
    rig = tmp_path / "lab.toml"
    rig.write_text(
        '[bus.legs]\ninterface = "socketcan"\nchannel = "vcan0"\n'
        '[device."left/knee"]\nrange = [-12.5, 12.5]\nwake_shift = 0.0\n[device."right/knee"]\nrange = [-12.5, '
        "12.5]\nwake_shift = 0.0\n"
    )
    plant = started("emulate", KNEE_EXO, "--rig", rig, cwd=tmp_path)
    try:
        read_until(plant.stdout, "Ctrl-C ends it")
        second = finished("emulate", KNEE_EXO, "--rig", rig, cwd=tmp_path)
        assert second.returncode == 2 and "TW107" in second.stderr
        run = finished(
            KNEE_EXO,
            "--rig",
            rig,
            "--yes",
            "--rate",
            "50",
            "--duration",
            "2",
            "--no-record",
            "--set",
            "left/knee.timeout=0.5",
            "--set",
            "right/knee.timeout=0.5",
            cwd=tmp_path,
        )
        assert run.returncode == 0, run.stderr
        assert "confirmed by left/knee, right/knee" in run.stdout
        plant.send_signal(signal.SIGINT)
        out, err = plant.communicate(timeout=20)
    finally:
        plant.kill()
        plant.communicate()
    assert plant.returncode == 130 and " 0 sent" not in out, out + err
