"""`doctor --bundle`: one archive for a bug report, without data about persons, also of a damaged recording."""

import getpass
import json
import os
import platform
import re
import zipfile

import pytest

from runtime.setup.doctor.bundle import Bundle
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
    about = json.loads(bundle.members["recording.json"])
    assert about["name"] == "knee" and "kernel.log" in bundle.members
    if damage == "empty":
        assert "signals.csv: " in bundle.members["problems.txt"]
    else:
        assert about["trouble"] and len(bundle.members["signals.csv"].splitlines()) > 1
    assert contents(bundle.write(tmp_path / "a.zip")) == bundle.members
    assert "Mallory" not in "\n".join(bundle.members.values())
