"""A lab's own block library: built against the public ABI, installed with pip, found, run, and asked for where it is
missing.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
LIBRARY = ROOT / "tests" / "example_lab"
BLOCKS = ("-m", "runtime", "blocks")
DIAGRAM = """
from gaitlab.blocks import CadenceMeter, LeakyAccumulator
from blocks.recorders import CsvRecorder
from graph import Diagram

with Diagram("lab", rate=100) as diagram:
    CadenceMeter()(1.0)
    LeakyAccumulator(leak=0.5)(1.0)
    CsvRecorder()
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A folder with the library in it, as pip installs it."""
    target, source = tmp_path_factory.mktemp("site"), tmp_path_factory.mktemp("source") / "example_lab"
    subprocess.run(["cp", "-r", str(LIBRARY), str(source)], check=True)
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "pip",
            "install",
            "--quiet",
            "--no-build-isolation",
            "--no-deps",
            "--target",
            str(target),
            str(source),
        ],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return target


def python(installed, *arguments, cwd):
    return subprocess.run(
        [sys.executable, *arguments],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(installed), str(ROOT)])},
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=120,
    )


def test_tests_of_a_third_party_library_pass_where_it_is_installed(installed, tmp_path):
    subprocess.run(["cp", "-r", str(LIBRARY / "tests"), str(tmp_path / "lab_tests")], check=True)
    done = python(installed, "-m", "pytest", "-q", "-p", "no:cacheprovider", "lab_tests", cwd=tmp_path)
    assert done.returncode == 0 and "9 passed" in done.stdout, done.stdout + done.stderr


def test_blocks_of_a_third_party_library_run_in_a_diagram(installed, tmp_path):
    (tmp_path / "lab.py").write_text(DIAGRAM)
    done = python(installed, "-m", "runtime", "lab.py", "--fast", "--duration", "0.1", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    rows = next((tmp_path / "recordings").glob("*.csv")).read_text().splitlines()
    assert rows[0] == "time [s],tick,cadence_meter.cadence,leaky_accumulator.y"
    assert rows[1:4] == ["0.0,0,0.0,1.0", "0.01,1,0.0,1.5", "0.02,2,0.0,1.75"] and len(rows) == 11


def test_a_missing_block_library_is_reported_with_the_install_command(installed, tmp_path):
    (tmp_path / "lab.py").write_text(DIAGRAM)
    write = "from runtime.diagrams.file import load; from graph.store import to_json; print(to_json(load('lab.py')[1]))"
    text = python(installed, "-c", write, cwd=tmp_path).stdout
    assert json.loads(text)["libraries"]["gaitlab"] == "1.0.0"
    (tmp_path / "lab.json").write_text(text)
    read = (
        "import sys; from graph.store import from_json; from graph import DiagramError\ntry: "
        "from_json(open('lab.json').read())\nexcept DiagramError as e: print(e)"
    )
    said = python(tmp_path, "-c", read, cwd=tmp_path).stdout
    assert "TW031 missing library" in said and "pip install gaitlab==1.0.0" in said


def test_a_third_party_library_is_listed_with_the_built_in_ones(installed, tmp_path):
    done = python(installed, *BLOCKS, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (
        "gaitlab 1.0.0  4 blocks" in done.stdout
        and ("    CadenceMeter      Steps a minute from heel strikes: 60 over") in done.stdout
    )
    said = python(installed, *BLOCKS, "cadence_meter", cwd=tmp_path).stdout
    assert said.startswith("CadenceMeter  from gaitlab.blocks import CadenceMeter\nPython; gaitlab.blocks, line ")


def test_from_prints_version_author_and_tested_python_versions(installed, tmp_path):
    said = python(installed, *BLOCKS, "--from", "gaitlab", cwd=tmp_path).stdout.splitlines()
    facts = {line[2:15].strip(): line[15:] for line in said if line.startswith("  ") and line[2:15].strip()}
    assert (said[0], facts["author"], facts["about"]) == (
        "gaitlab 1.0.0  4 blocks",
        "The gait laboratory",
        "Blocks of the gait laboratory",
    )
    assert facts["tested with"] == "tickwork>=0.1" and facts["Python"] == ">=3.10"
    assert not any("Butterworth" in line for line in said)
