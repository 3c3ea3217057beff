"""A laboratory's own package, as `new` writes it: installed with pip, tested, found, run, and reported if missing."""

import json
import os
import shutil
import subprocess
import sys
from ipaddress import ip_address, ip_network
from pathlib import Path

import pytest

from runtime.host.errors import BadInput
from runtime.robot.rig.file import read
from runtime.setup.laboratory import create

ROOT = Path(__file__).parents[4]
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
    """A folder with the package in it, as pip installs it; `source` beside it has its files."""
    folder = tmp_path_factory.mktemp("lab")
    target, source = folder / "site", folder / "gaitlab"
    create(source, drive=True)
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


@pytest.mark.soak
def test_tests_of_a_third_party_library_pass_where_it_is_installed(installed, tmp_path):
    for folder in ("diagrams", "tests"):
        shutil.copytree(installed.parent / "gaitlab" / folder, tmp_path / folder)
    done = python(installed, "-m", "pytest", "-q", "-p", "no:cacheprovider", "tests", cwd=tmp_path)
    assert done.returncode == 0 and "12 passed" in done.stdout, done.stdout + done.stderr


@pytest.mark.soak
def test_blocks_of_a_third_party_library_run_in_a_diagram(installed, tmp_path):
    (tmp_path / "lab.py").write_text(DIAGRAM)
    done = python(installed, "-m", "runtime", "lab.py", "--fast", "--duration", "0.1", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    rows = next((tmp_path / "recordings").glob("*.csv")).read_text().splitlines()
    assert rows[0] == "time [s],tick,cadence_meter.cadence,leaky_accumulator.y"
    assert rows[1:4] == ["0.0,0,0.0,1.0", "0.01,1,0.0,1.5", "0.02,2,0.0,1.75"] and len(rows) == 11


@pytest.mark.soak
def test_a_missing_block_library_is_reported_with_the_install_command(installed, tmp_path):
    (tmp_path / "lab.py").write_text(DIAGRAM)
    write = (
        "from runtime.robot.loading.file import load; from graph.store import to_json; "
        "print(to_json(load('lab.py')[1]))"
    )
    text = python(installed, "-c", write, cwd=tmp_path).stdout
    assert json.loads(text)["libraries"]["gaitlab"] == "0.1.0"
    (tmp_path / "lab.json").write_text(text)
    read = (
        "import sys; from graph.store import from_json; from graph import DiagramError\ntry: "
        "from_json(open('lab.json').read())\nexcept DiagramError as e: print(e)"
    )
    said = python(tmp_path, "-c", read, cwd=tmp_path).stdout
    assert "TW031 missing library" in said and "pip install gaitlab==0.1.0" in said


@pytest.mark.soak
def test_a_third_party_library_is_listed_with_the_built_in_ones(installed, tmp_path):
    done = python(installed, *BLOCKS, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (
        "gaitlab 0.1.0  4 blocks" in done.stdout
        and ("    CadenceMeter      Steps per minute: 60 divided by") in done.stdout
    )
    said = python(installed, *BLOCKS, "cadence_meter", cwd=tmp_path).stdout
    assert said.startswith("CadenceMeter  from gaitlab.blocks import CadenceMeter\nPython; gaitlab.blocks, line ")


@pytest.mark.soak
def test_from_prints_version_author_and_tested_python_versions(installed, tmp_path):
    said = python(installed, *BLOCKS, "--from", "gaitlab", cwd=tmp_path).stdout.splitlines()
    facts = {line[2:15].strip(): line[15:] for line in said if line.startswith("  ") and line[2:15].strip()}
    assert (said[0], facts["author"], facts["about"]) == (
        "gaitlab 0.1.0  4 blocks",
        "Our laboratory",
        "Blocks of our laboratory",
    )
    assert facts["tested with"] == "tickwork>=0.1" and facts["Python"] == ">=3.10"
    assert not any("Butterworth" in line for line in said)


@pytest.mark.soak
def test_rig_of_the_package_has_the_buses_and_joints_of_its_robot(installed, tmp_path):
    shutil.copytree(installed.parent / "gaitlab", tmp_path / "lab")
    done = python(
        installed, "-m", "runtime", "check", "diagrams/knee.py", "--rig", "rigs/emulated.toml", cwd=tmp_path / "lab"
    )
    assert done.returncode == 0 and "gaitlab.blocks" in (tmp_path / "lab/diagrams/knee.py").read_text(), done.stderr


def test_each_laboratory_has_a_multicast_group_of_its_own(tmp_path):
    rigs = []
    for name in ("leg_lab", "arm_lab"):
        create(tmp_path / name)
        rigs.append(read(tmp_path / name / "rigs" / "emulated.toml").buses["legs"].channel)
    assert len(set(rigs)) == 2 and all(ip_address(group) in ip_network("239.74.0.0/16") for group in rigs)


def test_package_without_a_drive_has_no_line_of_one(tmp_path):
    create(tmp_path / "leg_lab")
    texts = {path: path.read_text() for path in tmp_path.rglob("*") if path.is_file()}
    assert len(texts) == 12 and not any("drive.family" in text or "with --drive" in text for text in texts.values())


@pytest.mark.parametrize(
    "name, message",
    [
        ("My-Lab", "'My-Lab' cannot name a package: use lower-case letters"),
        ("class", "'class' cannot name a package"),
        ("numpy", "a package or module 'numpy' is installed already"),
        ("graph", "a package or module 'graph' is installed already"),
        ("leg_lab", "leg_lab exists already"),
    ],
)
def test_name_that_a_package_cannot_have_is_reported(name, message, tmp_path):
    (tmp_path / "leg_lab").mkdir()
    with pytest.raises(BadInput, match=message):
        create(tmp_path / name)


def test_folder_that_exists_is_reported_as_such_beside_it_too(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "leg_lab").mkdir()
    with pytest.raises(BadInput, match="leg_lab exists already: choose another name, or remove it"):
        create(tmp_path / "leg_lab")


def test_package_that_cannot_be_written_is_reported(tmp_path):
    (tmp_path / "notes").write_text("")
    with pytest.raises(BadInput, match="cannot write .*notes/leg_lab: Not a directory"):
        create(tmp_path / "notes" / "leg_lab")
