"""Read permission of a recording: its owner, and the group of a shared folder."""

import os
import stat

import pytest

from runtime.host.errors import OK
from runtime.record.recorder.report import write_json
from runtime.record.storage.files import create, make_folder, mode_in
from tests.runtime.runs import KNEE_EXO


@pytest.fixture(autouse=True)
def generous_umask():
    """Debian's default, under which others read every new file."""
    before = os.umask(0o022)
    yield
    os.umask(before)


def mode(path):
    return stat.S_IMODE(os.stat(path).st_mode)


def modes(folder):
    """The permissions of everything in a folder."""
    return {mode(path) for path in folder.rglob("*")}


def record(command_line, *words):
    code, _, err = command_line(KNEE_EXO, "--fast", "--duration", "0.1", *words)
    assert code == OK, err


@pytest.mark.hazard("H15a")
def test_a_recording_is_readable_only_by_its_owner(command_line):
    record(command_line, "--can-log")
    folder = command_line.folder / "recordings"
    assert mode(folder) == 0o700 and modes(folder) == {0o600}
    assert {path.suffix for path in folder.iterdir()} >= {".csv", ".mcap", ".json", ".log"}


def test_files_in_a_readable_folder_are_private_too(command_line, tmp_path):
    folder = tmp_path / "open"
    folder.mkdir(mode=0o755)
    record(command_line, "--record", folder)
    assert mode(folder) == 0o755 and modes(folder) == {0o600}


def test_a_folder_with_the_setgid_bit_is_shared_with_its_group(command_line, tmp_path):
    folder = tmp_path / "lab"
    folder.mkdir()
    folder.chmod(0o2770)
    record(command_line, "--record", folder / "monday" / "subject")
    assert mode(folder / "monday") == mode(folder / "monday" / "subject") == 0o2750
    assert modes(folder / "monday" / "subject") == {0o640}


def test_the_setgid_bit_alone_shares_nothing(tmp_path):
    tmp_path.chmod(0o2700)
    assert mode_in(tmp_path) == 0o600


@pytest.mark.soak
def test_converted_files_and_plots_are_private(command_line):
    record(command_line, "--no-record")
    record(command_line)
    [recording] = (command_line.folder / "recordings").glob("*.mcap")
    assert command_line("convert", recording, "--to", "sto", "-o", command_line.folder / "out")[0] == OK
    assert command_line("plot", recording, "left/knee.torque")[0] == OK
    assert command_line("plot", recording, "left/knee.torque", "-o", command_line.folder / "picture.png")[0] == OK
    assert mode(command_line.folder / "out") == 0o700
    assert {mode(path) for path in command_line.folder.rglob("*") if path.is_file() and path.suffix != ".xml"} == {
        0o600
    }
    assert list((command_line.folder / "out").glob("*.sto")) and len(list(command_line.folder.rglob("*.png"))) >= 2


def test_a_sidecar_keeps_its_permissions_when_it_is_replaced(tmp_path):
    path, descriptor = create(str(tmp_path / "trial"), ".json")
    os.close(descriptor)
    write_json(path, {"name": "trial"})
    assert mode(path) == 0o600


def test_a_file_used_as_a_folder_is_rejected(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(FileExistsError):
        make_folder(tmp_path / "file")
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    with pytest.raises(FileExistsError):
        make_folder(tmp_path / "link")
