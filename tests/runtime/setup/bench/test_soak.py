"""`soak`: hours of a rig as seconds, on drives of another process."""

import json
import os
import threading
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from runtime.host.ending import Interrupted
from runtime.host.machine.probe import Machine
from runtime.setup.bench.clock import busy_processors
from runtime.setup.bench.soak import Soak, failed, filled
from tests.runtime.robot.guardian.bus import Bus
from tests.runtime.runs import finished

pytestmark = pytest.mark.paced
WORDS = ("--model", "AK10-9-V2.0", "--hours", "0.0015", "--minutes", "0.02", "--yes")


@pytest.mark.soak
def test_a_soak_runs_in_spells_and_leaves_a_report_of_each(tmp_path):
    with Bus(tmp_path, number=63) as bus:
        run = finished("soak", bus.rig, *WORDS, "--actuators", "2", cwd=tmp_path)
        [path] = tmp_path.glob("soak_*.json")
        report = json.loads(path.read_text())
        lost = [failed(spell) for spell in report["spells"]]  # on a busy machine, perhaps a tick
        assert run.returncode == any(lost), run.stdout + run.stderr
        assert ("nothing was lost" in run.stdout) is not any(lost)
        assert [spell["busy"] for spell in report["spells"]] == [False, True, False][: len(report["spells"])]
        for spell in report["spells"]:
            assert spell["commands"] == 480 and spell["why"] == "" and spell["free"] > 0, spell
            assert spell["late max"] > 0.0 and spell["clock jump"] == spell["suspended"] == 0.0
        assert report["versions"]["python"] and str(tmp_path) not in path.read_text()
        assert len([*(tmp_path / "soak").iterdir()]) == sum(lost), "recordings of spells that lost something"
        refused = finished("soak", bus.rig, *WORDS, cwd=tmp_path)
        assert refused.returncode == 2 and "soak exists already" in refused.stderr


def test_a_spell_that_lost_something_has_failed():
    fine = {"why": "", "missed replies": 0, "lost ticks": 0, "full card": False, "dropped records": 0}
    fine["problems of the recording"] = []
    assert not failed(fine) and not failed(fine | {"dropped records": 5, "full card": True})
    for found in ({"why": "silent"}, {"missed replies": 1}, {"lost ticks": 1}, {"dropped records": 5}):
        assert failed(fine | found)


def test_a_card_is_filled_but_for_a_little_and_free_again(tmp_path, monkeypatch):
    sizes = []
    monkeypatch.setattr("os.posix_fallocate", lambda descriptor, at, size: sizes.append(size))
    with filled(tmp_path):
        assert sizes[0] > 0
        assert not any(tmp_path.iterdir()), "a file with a name outlives kill -9, and the card stays full"


def test_an_incomplete_report_is_marked_and_a_jump_of_the_clock_is_named(tmp_path, monkeypatch):
    """The wall clock goes back by an hour in the second spell; the third is interrupted."""
    clocks = iter([(0.0, 50.0, 0.0), (10.0, 60.0, 10.0), (10.0, 60.0, 10.0), (20.0, -3530.0, 20.0), (20.0, 70.0, 20.0)])
    monkeypatch.setattr("runtime.setup.bench.soak.read_clocks", lambda: next(clocks))
    soak, said = Soak(Attempt(tmp_path / "soak", 2), 200.0, tmp_path / "report.json", Machine()), []
    with pytest.raises(Interrupted):
        soak.run(3600.0, said.append)
    report = json.loads((tmp_path / "report.json").read_text())
    assert [spell["clock jump"] for spell in report["spells"]] == [0.0, pytest.approx(-3600.0)]
    assert report["complete"] is False and report["hours"] == 1.0 and "clock jumped by -3.6e+03 s" in said[1]
    clocks = iter([(0.0, 50.0, 0.0), (10.0, 60.0, 10.0)])
    soak = Soak(Attempt(tmp_path / "other", 2), 200.0, tmp_path / "whole.json", Machine())
    assert soak.run(0.001, said.append) and json.loads((tmp_path / "whole.json").read_text())["complete"] is True


def test_ctrl_c_does_not_reach_the_processes_that_keep_the_processors_busy():
    listed = Path(f"/proc/self/task/{threading.get_native_id()}/children")
    before = set(listed.read_text().split())
    with busy_processors():
        busy = set(listed.read_text().split()) - before
        assert busy and all(os.getpgid(int(child)) != os.getpgid(0) for child in busy)


class Attempt:
    """OnRig whose spells lose nothing. spells : number of those before Ctrl-C"""

    def __init__(self, folder, spells):
        self.folder, self.left, self.seconds, self.ids = folder, spells, 10.0, [1]
        self.rig = SimpleNamespace(path=folder.with_suffix(".toml"))
        counts = SimpleNamespace(counts=lambda name: np.zeros(1))
        self.result = SimpleNamespace(shared=counts, statistics={"dropped": 0}, recording={"problems": []})

    def __call__(self, rate):
        if self.left == 0:
            raise Interrupted(2)
        self.left -= 1
        return SimpleNamespace(commands=1, missed=0, lost=0, why="")
