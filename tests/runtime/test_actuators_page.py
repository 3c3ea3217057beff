"""Pages of actuators and device families: joint, zero, plant and driver board run as the pages state."""

import re
import shutil
import subprocess
import sys
import sysconfig

import pytest

import runtime
from blocks.families import find_model
from runtime.host.errors import CHECK_FAILED, FAULT, OK
from tests.runtime.runs import ROOT, environment, finished, write
from tests.runtime.test_documents import python_of

PAGE = (ROOT / "docs" / "reference" / "actuators.md").read_text()
KNEE, ZERO, PLANT = python_of(PAGE)
FAMILIES = (ROOT / "docs" / "how_to" / "device_families.md").read_text()
BOARD = python_of(FAMILIES)[0]


def test_the_joint_of_the_page_runs_with_either_actuator(tmp_path):
    line, other = re.search(r"    knee = (.*)\n    # or (.*)", KNEE).groups()
    for name, text in (("one.py", KNEE), ("other.py", KNEE.replace(line, other))):
        write(tmp_path, text, name)
        process = finished(name, "--fast", "--duration", "0.2", "--no-record", cwd=tmp_path)
        assert process.returncode == OK, process.stderr


def test_the_knee_exoskeleton_swaps_its_actuator_by_one_line(tmp_path):
    text = (ROOT / "diagrams" / "knee_exo.py").read_text()
    swapped = text.replace("from blocks.actuators import CubeMars", "from blocks.actuators import RobStride").replace(
        'CubeMars("AK10-9-V2.0"', 'RobStride("RobStride03"'
    )
    assert sum(a != b for a, b in zip(text.splitlines(), swapped.splitlines())) == 2, "the line, and the import"
    write(tmp_path, swapped, "knee_exo.py")
    process = finished("knee_exo.py", "--fast", "--duration", "5", "--no-record", cwd=tmp_path)
    assert process.returncode == OK and "confirmed by left/knee, right/knee" in process.stdout, process.stderr


def test_the_zero_of_the_page_is_set_during_arming(tmp_path):
    process = finished(write(tmp_path, ZERO), "--fast", "--duration", "0.1", "--no-record", cwd=tmp_path)
    assert process.returncode == OK and "  zero        knee: set 1 time, refused 0 times\n" in process.stdout


def test_the_plant_of_the_page_ends_the_run(tmp_path):
    write(tmp_path, KNEE + "\n\n" + PLANT, "deaf.py")
    process = finished("deaf.py", "--fast", "--duration", "2", "--no-record", cwd=tmp_path)
    assert process.returncode == FAULT and "knee" in process.stderr, process.stderr
    seconds = float(re.search(r"frames are lost from ([\d.]+) s on", PLANT)[1])
    trial = runtime.run(tmp_path / "deaf.py", 2.0)
    period = trial.time[1] - trial.time[0]
    fresh = trial.time[trial["knee.age"] < 1.5 * period]
    assert seconds - 0.02 < fresh.max() < seconds + 0.02 and len(fresh) == pytest.approx(seconds / period, abs=4)


def test_the_names_of_the_page_are_accepted():
    [line] = re.findall(r"^\* Names are accepted.*?:\s(.*?)\.$", PAGE, re.DOTALL | re.MULTILINE)
    names = re.findall(r"`(.*?)`", line)
    assert len(names) > 4 and all(find_model(name) for name in names)


@pytest.mark.skipif(shutil.which(sysconfig.get_config_var("CC").split()[0]) is None, reason="needs a C compiler")
@pytest.mark.soak
def test_the_driver_board_of_the_page_compiles_runs_and_is_proved(tmp_path):
    [kernels] = re.findall(r"^```cython\n(.*?)^```", FAMILIES, re.DOTALL | re.MULTILINE)
    path = write(tmp_path, kernels, "board_kernels.pyx")
    compiled = subprocess.run(
        [sys.executable, "-c", "from Cython.Build.Cythonize import main; main()", "-3", "-i", str(path)],
        cwd=ROOT,
        env=environment() | {"CFLAGS": "-O0"},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert compiled.returncode == 0, compiled.stderr
    write(tmp_path, BOARD, "board.py")
    process = finished("board.py", "--fast", "--duration", "2", cwd=tmp_path)
    assert process.returncode == OK, process.stderr
    rows = next((tmp_path / "recordings").glob("*.csv")).read_text().splitlines()
    place = [name.split(" ")[0] for name in rows[0].split(",")].index("knee.position")
    assert abs(float(rows[-1].split(",")[place]) - 0.3) < 0.02, "the spring has pulled it there"
    write(tmp_path, BOARD.replace("TorqueLimiter(limit=5.0)(torque)", "TorqueLimiter(limit=6.0)(torque)"), "strong.py")
    process = finished("strong.py", "--fast", "--duration", "0.1", "--no-record", cwd=tmp_path)
    assert process.returncode == CHECK_FAILED and "knee.torque_command" in process.stderr, process.stderr
    checked = subprocess.run(
        [
            sys.executable,
            "-c",
            "import board; from graph.conformance import check_declarations\n"
            "for kind in (board.Board, board.EmulatedBoard): check_declarations(kind, {})",
        ],
        cwd=tmp_path,
        env=environment(),
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert checked.returncode == 0, checked.stderr
