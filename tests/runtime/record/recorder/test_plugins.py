"""Sinks and formats of an installed package: found by their entry points, without a line of ours."""

import json
import os
import subprocess
import sys
import textwrap

import pytest

from runtime.host.errors import BadInput
from runtime.host.plugins import Plugins
from runtime.record.export import FORMATS
from runtime.record.recorder.plugins import SERVICES
from runtime.record.recorder.service import Service
from tests.checkout import ROOT
from tests.runtime.runs import environment, write

SINKS = """
from graph import Param, Sink

class Counter(Sink):
    "Counts ticks and frames, and writes how many there were."
    unit = Param("ticks", "1", "what the file calls them")
    service = "counter"
    writes_files = True
"""
SERVICE = """
import json
import os
from runtime.record.recorder.service import Service

class CounterService(Service):
    def open(self):
        self.path = os.path.join(self.plan["folder"], self.plan["stem"] + ".count.json")
        self.files[self.path] = "how many there were"
        self.ticks = self.frames = 0
        open(self.path, "x").close()

    def row(self, tick, time, values):
        self.ticks += 1

    def frame(self, payload):
        self.frames += 1

    def close(self):
        with open(self.path, "w") as file:
            json.dump({self.sink["parameters"]["unit"]: self.ticks, "frames": self.frames}, file)
        return {"ticks": self.ticks}
"""
FORMAT = """
def check(trial, kind):
    pass

def write(trial, path, progress):
    with open(path, "w") as file:
        file.writelines(f"{name}: {trial[name][-1]}\\n" for name in trial.names)
"""
ROBOT = """
from blocks.actuators import CubeMars
from countlab.sinks import Counter
from graph import Diagram

with Diagram("counted", rate=200) as diagram:
    knee = CubeMars("AK10-9-V2.0", bus="legs", can_id=1, range=(-12.5, 12.5), name="knee")
    knee(torque_command=0.0)
    Counter(unit="samples")
"""


@pytest.fixture
def lab(tmp_path):
    """A folder with an installed package `countlab`, and a diagram that uses it."""
    package, info = tmp_path / "site" / "countlab", tmp_path / "site" / "countlab-1.0.dist-info"
    package.mkdir(parents=True)
    info.mkdir()
    for name, text in (("__init__", ""), ("sinks", SINKS), ("service", SERVICE), ("summary", FORMAT)):
        write(package, text, f"{name}.py")
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: countlab\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        textwrap.dedent(
            """
            [tickwork.sinks]
            counter = countlab.service:CounterService
            csv = countlab.service:CounterService
            [tickwork.formats]
            last = countlab.summary
            """
        )
    )
    write(tmp_path, ROBOT)
    return tmp_path


def run(lab, *words):
    done = subprocess.run(
        [sys.executable, "-m", "runtime", *words],
        cwd=lab,
        env=environment(PYTHONPATH=os.pathsep.join([str(ROOT), str(lab / "site")])),
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.soak
def test_a_sink_of_an_installed_package_writes_its_file_and_gets_rows_and_frames(lab):
    said = run(lab, "robot.py", "--fast", "--duration", "1")
    [path] = (lab / "recordings").glob("*.count.json")
    counted = json.loads(path.read_text())
    [sidecar] = [
        json.loads(file.read_text()) for file in (lab / "recordings").glob("*.json") if "count" not in file.name[8:]
    ]
    assert counted["samples"] == sidecar["ticks"] == 200
    assert counted["frames"] == sum(sidecar["statistics"]["frames"][kind] for kind in ("sent", "received")) >= 400
    assert sidecar["sinks"]["counter"] == {"ticks": 200} and f"{path.name}  (how many there were)" in said
    [log] = (lab / "recordings").glob("*.mcap")
    assert run(lab, "convert", str(log), "--to", "last").strip().endswith(".last")
    assert "knee.position: " in log.with_suffix(".last").read_text()


def test_the_formats_of_installed_packages_are_listed(lab):
    assert f"{', '.join(FORMATS.own)}, last" in " ".join(run(lab, "convert", "--help").split())


def test_builtin_plugins_load_without_distribution_and_are_not_replaced(lab, monkeypatch):
    monkeypatch.syspath_prepend(str(lab / "site"))
    for name, place in SERVICES.own.items():
        service = SERVICES.load(name)
        assert f"{service.__module__}:SERVICE" == place and issubclass(service, Service)
    for name, place in FORMATS.own.items():
        assert FORMATS.load(name).__name__ == place
    assert list(SERVICES) == [*SERVICES.own, "counter"] and SERVICES.load("counter").__name__ == "CounterService"


def test_a_module_on_the_path_needs_no_entry_point():
    assert Plugins("tickwork.nothing", {}).load("runtime.host.errors:BadInput") is BadInput


def test_an_unknown_name_is_bad_input_with_a_suggestion():
    with pytest.raises(
        BadInput, match="'plotjugler' in the entry-point group 'tickwork.sinks'; did you mean 'plotjuggler'"
    ):
        SERVICES.load("plotjugler")
