"""A laboratory's own drive, which an installed package brings: the commands work with it as with ours.

`new --drive` writes the package; its drive is the emulated one, behind `emulate` on udp_multicast.
"""

import itertools
import json
import os
import re
import subprocess
import sys

import pytest

from runtime.host.errors import OK
from tests.runtime.robot.loading.test_library import ROOT, installed, python  # noqa: F401
from tests.runtime.setup.commissioning.nodes import channel

pytestmark = pytest.mark.paced

ROBOT = """
from gaitlab.drive import GaitDrive
from graph import Diagram

with Diagram("lab", rate=200) as diagram:
    GaitDrive("GD-10", bus="legs", can_id=5, name="knee")(torque_command=0.0)
"""
CHANNELS = itertools.count(130)
RIG = '[bus.legs]\ninterface = "udp_multicast"\nchannel = "{}"\n'


class Bench:
    """The laboratory's drive, emulated, and commands that run in a folder beside it."""

    def __init__(self, site, folder, number):
        self.site, self.folder, self.channel = site, folder, channel(number)
        (folder / "lab.py").write_text(ROBOT)
        (folder / "lab.toml").write_text(RIG.format(self.channel))
        self.process = subprocess.Popen(
            [sys.executable, "-m", "runtime", "emulate", "lab.py", "--rig", "lab.toml"],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": os.pathsep.join([str(site), str(ROOT)])},
            stdout=subprocess.PIPE,
            text=True,
        )
        while "Ctrl-C ends it" not in (line := self.process.stdout.readline()):
            assert line, "the emulation has not begun"

    def run(self, *words):
        return python(self.site, "-m", "runtime", *words, cwd=self.folder)

    def on_bus(self, *words):
        return self.run(*words, "--interface", "udp_multicast", "--channel", self.channel)

    def end(self):
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()


@pytest.fixture
def bench(installed, tmp_path):  # noqa: F811
    place = Bench(installed, tmp_path, next(CHANNELS))
    yield place
    place.end()


@pytest.mark.soak
def test_scan_finds_a_third_party_drive(bench):
    done = bench.on_bus("scan", "--listen", "0.1", "--ids", "1-20", "--json")
    assert done.returncode == OK, done.stdout + done.stderr
    [report] = json.loads(done.stdout)["buses"]
    [drive] = report["drives"]
    assert (drive["can_id"], drive["family"], drive["block"]) == (5, "gait laboratory's drive", "GaitDrive")
    assert (drive["position"], drive["temperature"], drive["fault"], drive["enabled"]) == (0.0, 25.0, "", False)
    queries = [frame for frame in report["sent"] if frame["why"] == "disable of the gait laboratory's drives"]
    assert [(frame["id"], frame["data"]) for frame in queries] == [
        (0x500 + can_id, "02000000") for can_id in range(1, 21)
    ]


@pytest.mark.soak
def test_third_party_drive_moves_with_torque_only(bench):
    where = ("--rig", "lab.toml", "--yes")
    done = bench.run("move", "5", "--model", "GD-10", "--torque", "0.5", "--duration", "1", "--fastest", "50", *where)
    assert done.returncode == OK, done.stdout + done.stderr
    assert "GD-10, id 5 on" in done.stdout and "torque limit 1 N·m (10% of rated)" in done.stdout
    [table] = (bench.folder / "recordings").glob("*.csv")
    heads, *rows = [line.split(",") for line in table.read_text().splitlines()]
    sent = [float(row[heads.index("actuator.torque_sent [N*m]")]) for row in rows]
    measured = [float(row[heads.index("actuator.torque [N*m]")]) for row in rows]
    assert max(sent) == pytest.approx(0.5, abs=0.005) and min(sent) >= 0.0 and abs(sent[-1]) < 0.02
    assert max(measured) == pytest.approx(0.5, abs=0.005)
    refused = bench.run("move", "5", "--model", "GD-10", "--velocity", "1", *where)
    assert refused.returncode == 2 and "--velocity: GaitDrive is commanded with --torque" in refused.stderr


@pytest.mark.soak
def test_third_party_drive_is_streamed_without_torque(bench):
    done = bench.on_bus("stream", "actuator", "5", "--model", "GD-10", "--duration", "0.5")
    assert done.returncode == OK, done.stderr
    assert f"id 5 on {bench.channel}: gait laboratory's drive, without torque" in done.stdout
    assert re.search(r"0\.000 rad +-?0\.00 rad/s +-?0\.00 N·m +25 °C", done.stdout)


@pytest.mark.soak
def test_zero_and_id_of_a_third_party_drive_are_set(bench):
    done = bench.on_bus("configure", "5", "--zero", "--set-id", "9", "--yes")
    assert done.returncode == OK, done.stdout + done.stderr
    assert "id 5, gait laboratory's drive" in done.stdout and "done: id 9, 0.000 rad" in done.stdout
    found = bench.on_bus("scan", "--listen", "0.1", "--ids", "1-20", "--json")
    assert [drive["can_id"] for drive in json.loads(found.stdout)["buses"][0]["drives"]] == [9]
    refused = bench.on_bus("configure", "9", "--save")
    assert refused.returncode == 2 and "--save" in refused.stderr


@pytest.mark.soak
def test_models_of_a_third_party_family_are_listed(installed, tmp_path):  # noqa: F811
    done = python(installed, "-m", "runtime", "blocks", "--actuators", cwd=tmp_path)
    assert done.returncode == OK, done.stderr
    assert "Gait laboratory  from gaitlab.drive import GaitDrive" in done.stdout
    [row] = [line.split() for line in done.stdout.splitlines() if line.split()[:1] == ["GD-30"]]
    assert row[1:4] == ["9:1", "30", "60"]
