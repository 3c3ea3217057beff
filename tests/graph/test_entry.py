"""`main(diagram)`, the last line of a diagram file."""

import pytest

from graph import Diagram, main
from tests.checkout import ROOT, assert_one_line, python

WAVE = """
from blocks.recorders import CsvRecorder
from blocks.sources import Sine
from graph import Diagram, main

with Diagram("wave", rate=100) as diagram:
    Sine()
    CsvRecorder()
main(diagram)
"""


@pytest.fixture
def wave(tmp_path):
    """A diagram file that calls main."""
    path = tmp_path / "wave.py"
    path.write_text(WAVE)
    return path


def started(path, *arguments):
    return python(path.name, *arguments, cwd=path.parent, path=ROOT)


@pytest.mark.soak
def test_a_file_that_calls_main_accepts_the_options_of_run(wave):
    process = started(wave, "--fast", "--duration", "1")
    assert (process.returncode, process.stderr) == (0, "") and "wave: 1 s at 100 Hz" in process.stdout
    [recording] = (wave.parent / "recordings").glob("*.csv")
    assert len(recording.read_text().splitlines()) == 101


def test_the_command_line_runs_such_a_file_once(wave):
    process = python("-m", "runtime", wave.name, "--fast", "--duration", "1", cwd=wave.parent, path=ROOT)
    assert (process.returncode, process.stderr) == (0, "") and process.stdout.count("wave: 1 s at 100 Hz") == 1
    assert len(list((wave.parent / "recordings").glob("*.csv"))) == 1


def test_the_exit_code_is_that_of_the_command_line(wave):
    assert_one_line(started(wave, "--duration", "minus"), "--duration")


@pytest.mark.soak
def test_a_file_with_build_calls_main_without_a_diagram(wave):
    body = (
        WAVE.replace("\nwith", "\ndef build(rate=100):\n  with")
        .replace("\n    ", "\n      ")
        .replace("rate=100) as", "rate=rate) as")
    )
    wave.write_text(body.replace("main(diagram)", "  return diagram\nmain()"))
    process = started(wave, "--fast", "--duration", "1", "--no-record", "--set", "rate=50")
    assert (process.returncode, process.stderr) == (0, "") and "wave: 1 s at 50 Hz" in process.stdout


def test_main_rejects_a_diagram_without_the_expected_name(wave):
    wave.write_text(WAVE.replace("as diagram", "as another").replace("main(diagram)", "main(another)"))
    process = started(wave, "--fast", "--duration", "1")
    assert (
        process.returncode == 1 and "ValueError: main() runs the object that the file calls `diagram`" in process.stderr
    )


def test_main_does_nothing_in_a_module_that_is_imported():
    assert main(Diagram("anything", rate=100)) is None


@pytest.mark.parametrize("name", ["json", "runtime"])
@pytest.mark.soak
def test_a_file_beside_the_diagram_shadows_no_module(name, wave):
    (wave.parent / f"{name}.py").write_text("raise SystemExit(0)\n")
    process = started(wave, "--fast", "--duration", "1", "--no-record")
    if name == "json":
        assert_one_line(process, " json.py has the name of a library", "rename it")
    else:
        assert (process.returncode, process.stderr) == (0, "") and "wave: 1 s at 100 Hz" in process.stdout
