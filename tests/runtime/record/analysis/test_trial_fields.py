"""Trial and provenance fields of a recording."""

import json
import shutil
import subprocess

import pytest

from runtime.host.errors import OK
from tests.runtime.runs import knee


def git(folder, *words):
    subprocess.run(
        ["git", "-C", folder, "-c", "user.name=a", "-c", "user.email=a@b", *words], check=True, capture_output=True
    )


def recorded(command_line, path, *words):
    code, out, err = command_line(path, "--duration", "0.1", "--fast", "--record", path.parent / "trials", *words)
    assert code == OK, err
    [sidecar] = (path.parent / "trials").glob("*.json")
    return sidecar, json.loads(sidecar.read_text())


def test_fields_of_a_trial_are_in_the_names_and_in_the_metadata(command_line, tmp_path):
    path = knee(tmp_path)
    sidecar, told = recorded(command_line, path, "--trial", "subject=S03", "condition=fast / up", "notes=new shoes")
    assert sidecar.name.startswith("robot_S03_fast-up_2") and "shoes" not in sidecar.name
    assert told["metadata"]["trial"] == {"subject": "S03", "condition": "fast / up", "notes": "new shoes"}
    assert told["hash"].startswith("sha256:") and told["versions"]["numpy"] and told["machine"]["architecture"]


def test_a_field_without_a_name_or_given_twice_is_refused(command_line, tmp_path):
    path = knee(tmp_path)
    assert command_line.refused(path, "--trial", "S03") == "--trial S03: expected NAME=VALUE, as in subject=S03"
    assert command_line.refused(path, "--trial", "a=1", "a=2") == "--trial: a was given twice"


@pytest.mark.skipif(shutil.which("git") is None, reason="needs git")
def test_revision_and_dirty_state_of_diagram_repository_are_reported(command_line, tmp_path):
    path = knee(tmp_path)
    git(tmp_path, "init", "-q")
    git(tmp_path, "add", path.name)
    git(tmp_path, "commit", "-qm", "a robot")
    sidecar, told = recorded(command_line, path)
    assert (
        len(told["repository"]["revision"]) == 40
        and told["repository"]["dirty"] is False
        and told["repository"]["tracked"] is True
    )
    sidecar.unlink()
    path.write_text(path.read_text() + "# changed\n")
    assert recorded(command_line, path)[1]["repository"]["dirty"] is True


def test_outside_a_repository_nothing_is_claimed(command_line, tmp_path):
    assert recorded(command_line, knee(tmp_path))[1]["repository"] is None
