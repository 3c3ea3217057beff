"""`doctor --bundle`: one archive for a bug report, without data about persons, also of a damaged recording."""

import getpass
import json
import os
import platform
import re
import zipfile

import pytest

from runtime.host.errors import BadInput
from runtime.robot.rig.records import Record, digest
from runtime.setup.doctor.bundle import Bundle
from runtime.setup.doctor.persons import Persons
from tests.runtime.runs import finished, knee, write

NAME = "Mallory Jones"
SUBJECT = (
    f'version = 1\nid = "S03X"\nsigned_by = "{NAME}"\ndate = 2026-11-27\nreason = "r"\n[joint."knee"]\ntorque = 2\n'
)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bundle")
    write(folder, SUBJECT, "limits.toml")
    words = ("--trial", "subject=S03X", f"operator={NAME}", "notes=left knee hurts", "condition=assist")
    run = finished(
        knee(folder), "--fast", "--duration", "20", "--subject", "limits.toml", "--record", "here", *words, cwd=folder
    )
    assert run.returncode == 0, run.stderr
    [path] = (folder / "here").glob("*.mcap")
    return path


RIG = """# wiring of Mallory Jones' robot
[bus.legs]  # Mallory's "bus"
interface = "virtual"
channel = "a # is no comment"
key = 'nor # here'
"""
ABOUT = {
    "metadata": {
        "subject": {"id": "K1", "file": "Jones.toml", "date": "2026-11-27"},
        "trial": {"subject": "K1", "operator": NAME, "side": "left", "speed": "200", "nick": 'O"Neil'},
    },
    "machine": {"node": "lab7.uni.example"},
}


def contents(path):
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
        return {name: archive.read(name).decode() for name in archive.namelist()}


def test_the_archive_has_the_end_of_the_run_and_nothing_about_persons(recording, tmp_path):
    run = finished("doctor", "--bundle", recording, "--last", "1.999", "--yes", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    [archive] = tmp_path.iterdir()
    found = contents(archive)
    assert f"written: {archive.name}" in run.stdout and archive.stat().st_mode & 0o777 == 0o600
    for name in found:
        assert f"  {name} " in run.stdout.partition("written")[0], "everything is listed before"
    assert {"recording.json", "events.json", "signals.csv", "frames.can.log", "kernel.log"} <= found.keys()
    rows = found["signals.csv"].splitlines()
    assert len(rows) == 401 and rows[-1].startswith("19.995,3999,")
    assert found["frames.can.log"].count("\n") > 798
    about = json.loads(found["recording.json"])
    assert about["metadata"]["subject"]["joints"] == {"knee": {"torque": 2.0}} and about["versions"]["python"]
    assert about["limits"]["knee.torque"] == [-2.0, 2.0]
    assert "metadata.trial, metadata.subject.id, machine.node" in run.stdout
    everything = "\n".join(found.values()) + archive.name
    for word in ("S03X", "Mallory", "left knee hurts", platform.node(), os.path.expanduser("~") + "/"):
        assert not re.search(rf"(?<!\w){re.escape(word)}(?!\w)", everything), word
    assert getpass.getuser() == "root" or getpass.getuser() not in everything


def test_an_archive_is_never_overwritten_and_nothing_is_written_without_consent(recording, tmp_path):
    for _ in range(2):
        assert finished("doctor", "--bundle", recording, "--yes", cwd=tmp_path).returncode == 0
    assert {path.stem[-2:] for path in tmp_path.iterdir()} == {"le", "-2"}
    run = finished("doctor", "--bundle", recording, cwd=tmp_path)  # without a terminal on which to ask
    assert run.returncode == 2 and "--yes" in run.stderr and len(list(tmp_path.iterdir())) == 2
    run = finished("doctor", "--bundle", "none.mcap", cwd=tmp_path)
    assert run.returncode == 2 and "no such file" in run.stderr


@pytest.mark.parametrize("damage", ["cut", "hole", "empty"])
def test_a_damaged_recording_has_an_archive_too(recording, tmp_path, damage):
    data = bytearray(recording.read_bytes())
    if damage == "cut":
        data = data[: len(data) // 2]
    else:
        data[len(data) // 3 : len(data) // 2] = bytes(len(data) // 2 - len(data) // 3)
    path = tmp_path / recording.name
    path.write_bytes(b"" if damage == "empty" else data)
    path.with_suffix(".json").write_bytes(recording.with_suffix(".json").read_bytes())
    bundle = Bundle(path)
    assert "S03X" not in bundle.members.get("problems.txt", ""), "it is part of the name of the recording"
    about = json.loads(bundle.members["recording.json"])
    assert about["name"] == "knee" and "kernel.log" in bundle.members
    if damage == "empty":
        assert "signals.csv: " in bundle.members["problems.txt"]
    else:
        assert about["trouble"] and len(bundle.members["signals.csv"].splitlines()) > 1
    assert contents(bundle.write(tmp_path / "a.zip")) == bundle.members
    assert "Mallory" not in "\n".join(bundle.members.values())


def test_names_of_persons_are_removed_and_numbers_and_names_of_blocks_are_not():
    """A field of a trial was looked for in numbers: speed=200 left JSON that nobody can read, and side=left no left."""
    persons = Persons(ABOUT, ["left/knee.position", "exo"])
    value = {
        "rate": 200,
        "left/knee": 'mallory, O"Neil',
        "lines": ["subject K1 (Jones.toml) of 2026-11-27", "exo_K1_Mallory-Jones_left_200_2026.mcap", "at 200 N·m"],
        "machine": ["lab7", "lab7.uni.example"],
    }
    assert persons.scrubbed(value) == {
        "rate": 200,
        "left/knee": "REMOVED, REMOVED",
        "lines": ["subject REMOVED of 2026-11-27", "exo_REMOVED_REMOVED_REMOVED_REMOVED_2026.mcap", "at 200 N·m"],
        "machine": ["HOST", "HOST"],
    }
    home = "/".join(["", "home", "mallory", "exo.py"])  # of another computer
    elsewhere = Persons({"metadata": {"diagram_file": home}}, [])
    assert elsewhere.scrub(f"{home}, /media/mallory/STICK") == "~/exo.py, /media/USER/STICK"


def test_no_comment_of_a_rig_file_is_kept_whatever_it_quotes():
    persons = Persons(ABOUT, [])
    assert persons.without_comments(RIG, "rig.toml") == re.sub(r"(# wiring.*|  # Mallory.*)", "", RIG)
    assert persons.removed == ["rig.toml: comments"]


def test_records_are_found_beside_the_rig_from_any_folder(recording, tmp_path, monkeypatch):
    record = Record("4F2A", "knee", "DriveBlock", "D80", signed={"name": NAME, "date": "2026-11-20"})
    (tmp_path / "lab.records").mkdir()
    (tmp_path / "lab.records" / "4F2A.toml").write_text(f"# of {NAME}\n" + record.text())
    (tmp_path / "here").mkdir()
    path = tmp_path / "here" / recording.name
    path.write_bytes(recording.read_bytes())
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")

    def records(about):
        bundle = Bundle(path)
        bundle.about = {"metadata": {"rig": {"file": "lab.toml", "text": "", "records": about}}}
        return bundle._records()

    same = records({"serials": {"knee": "4F2A"}, "sha256": digest({"knee": record})})
    assert 'device = "knee"' in same and "Jones" not in same and "CHANGED" not in same
    older = Record("90AB", "knee", "DriveBlock", "D80", signed={"name": NAME, "date": "2026-01-20"})
    (tmp_path / "lab.records" / "90AB.toml").write_text(older.text())
    both = records({"serials": {"knee": "4F2A"}, "sha256": digest({"knee": record})})
    assert "# 90AB" in both and "CHANGED" not in both, "the run has read the other record of this joint"
    assert "CHANGED" in records({"serials": {"knee": "4F2A"}, "sha256": "other"})
    path.rename(tmp_path / "elsewhere" / path.name)
    path = tmp_path / "elsewhere" / path.name
    (tmp_path / "lab.records").rename(tmp_path / "moved")
    with pytest.raises(BadInput, match="no folder lab.records: run the command in the folder of the run"):
        records({"serials": {"knee": "4F2A"}, "sha256": "other"})
    (tmp_path / "moved" / "4F2A.toml").write_text("damaged")
    (tmp_path / "moved").rename(tmp_path / "lab.records")
    assert "# 4F2A" not in records({"serials": {}}) and "# 90AB" in records({})


def test_a_folder_that_takes_no_file_and_a_file_beside_the_recording_are_refused_in_a_line(recording, tmp_path):
    with pytest.raises(BadInput, match="cannot write .*a.zip: No such file"):
        Bundle(recording).write(tmp_path / "none" / "a.zip")
    run = finished("doctor", "--bundle", recording.with_suffix(".json"), "--yes", cwd=tmp_path)
    assert run.returncode == 2 and "name the .mcap file" in run.stderr and not any(tmp_path.iterdir())
