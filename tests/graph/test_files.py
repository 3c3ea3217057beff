"""Files of blocks: found beside the diagram or in the working folder, and refused in words if they are none."""

import os
import sys

import pytest

from blocks.recorders import CsvRecorder
from blocks.sources import Playback
from blocks.wearer import Walker
from graph import Diagram, DiagramError, compile
from graph.diagnostics import Location
from graph.files import path_beside
from runtime import run
from tests.graph.complaints import refusal
from tests.shared import shared

TABLE = "time,angle\n0,1\n1,2\n"


@pytest.fixture
def folders(tmp_path, monkeypatch):
    """Folders of the diagram and of the shell."""
    here, there = tmp_path / "lab", tmp_path / "elsewhere"
    here.mkdir()
    there.mkdir()
    monkeypatch.chdir(there)
    monkeypatch.setattr(sys, "path", list(sys.path))
    return here, there


@pytest.mark.parametrize(
    "block, name",
    [
        ("from blocks.sources import Playback; Playback('data.txt', 'angle')()", "walk.csv"),
        ("from blocks.sinks import Panel; Panel(marks_file='data.txt')", "notes.txt"),
        ("from blocks.imus.invensense import MPU9250; MPU9250(bus='i2c', calibration='data.txt')", "imu.toml"),
    ],
    ids=["recording", "notes", "calibration"],
)
@pytest.mark.parametrize("where", [0, 1], ids=["beside the diagram", "in the working folder"])
def test_a_file_is_found_in_both_folders(folders, block, name, where):
    (folders[where] / "data.txt").write_text("" if name == "imu.toml" else TABLE)
    file = folders[0] / "robot.py"
    file.write_text(f"from graph import Diagram\nwith Diagram('d', rate=100) as diagram:\n    {block}\n")
    from runtime.robot.loading.file import load

    _, diagram = load(file)
    compile(diagram)


def test_the_folder_of_the_diagram_comes_first(folders):
    for folder, value in zip(folders, (1, 5)):
        (folder / "walk.csv").write_text(TABLE.replace("0,1", f"0,{value}"))
    file = folders[0] / "robot.py"
    file.write_text(
        "from graph import Diagram\nfrom blocks.sources import Playback\nwith Diagram('d', rate=100) as diagram:\n"
        "    Playback('walk.csv', 'angle', name='angle')()\n"
    )
    assert run(file, 0.01)["angle.y"][0] == 1.0


def test_a_recording_of_the_wearer_is_found_beside_the_diagram(folders):
    """Needs ../shared."""
    (folders[0] / "walk.csv").write_bytes(shared("gait/healthy_young.csv").read_bytes())
    with Diagram("wearer", rate=1000):
        walker = Walker(recording=str(folders[0] / "walk.csv"))
    walker.location = Location(str(folders[0] / "robot.py"), 1)
    walker.set("recording", "walk.csv")
    assert walker.recording == str(folders[0] / "walk.csv")


@pytest.mark.parametrize(
    "name, words",
    [
        ("", "expected the path of a file, got ''"),
        ("a\0b", r"expected the path of a file, got 'a\\x00b'"),
        ("nowhere.csv", "there is no nowhere.csv in .*lab or in the working folder: copy it there"),
        ("pipe", "pipe is not a file: it is a pipe or a device"),
        ("/dev/null", "/dev/null is not a file: it is a pipe or a device"),
        (".", r"\. is a folder: name a file in it"),
        ("/nowhere/at/all.csv", "No such file or directory: '/nowhere/at/all.csv'"),
        ("x" * 300, "File name too long" if sys.version_info < (3, 14) else "there is no x+ in "),
        ("Läufer und Gänge.csv", "there is no Läufer und Gänge.csv in "),
    ],
)
def test_a_path_that_names_no_file_is_refused_with_the_reason(folders, name, words):
    os.mkfifo(folders[0] / "pipe")
    where = Location(str(folders[0] / "robot.py"), 1)
    with pytest.raises((ValueError, OSError), match=words):
        path_beside(where, name)
    assert refusal(Playback, name, "angle").code == "TW010"


@pytest.mark.parametrize(
    "text, words",
    [
        ("", "has no rows"),
        ("time,angle\n", "has no rows"),
        ("time,angle\n0,1\n0,2\n", "column 'time': the times must be finite and strictly increasing"),
        ("time,angle\n0,1\n", "column 'time': expected at least two times"),
        ("\0" * 100, "is not a CSV file"),
    ],
)
def test_a_table_that_cannot_be_played_is_named(tmp_path, text, words):
    path = tmp_path / "table.csv"
    path.write_text(text)
    with pytest.raises(DiagramError) as caught, Diagram("d", rate=100):
        Playback(str(path), "angle")
    assert words in str(caught.value) and str(path) in str(caught.value)


def test_a_file_of_zeros_is_refused_before_it_is_read(tmp_path):
    path = tmp_path / "zeros.csv"
    with open(path, "wb") as file:
        file.truncate(1 << 40)  # sparse: more than the memory of the machine
    with Diagram("d", rate=100):
        CsvRecorder()
        with pytest.raises(DiagramError, match="is not a CSV file in UTF-8: it has zero bytes"):
            Playback(str(path), "angle")


def test_an_absolute_path_without_a_file_has_no_advice_to_write_an_absolute_path(tmp_path):
    with Diagram("d", rate=100):
        found = refusal(Playback, str(tmp_path / "no.csv"), "angle")
    assert "No such file or directory" in found.message and found.hint == ""
