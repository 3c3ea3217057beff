"""`soak`: hours of a rig as seconds, on drives of another process."""

import json

import pytest

from runtime.setup.bench.soak import failed, filled
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
        assert (tmp_path / "ballast").exists() and sizes[0] > 0
    assert not any(tmp_path.iterdir())
