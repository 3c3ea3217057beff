"""The bridge of XSENSOR insoles: what it sends from an export and from the library is what the block measures.

The vendor's library runs on Windows alone. A stand-in has the functions of its header XSCore90.h.
"""

import csv
import shutil
import signal
import socket
import subprocess
import sys

import numpy as np
import pytest

from blocks.sensors import Insole
from tests.blocks.actuators.wire import TAKEN, Wired
from tests.blocks.sensors.test_insole import hear
from tests.checkout import ROOT

BRIDGE = ROOT / "docs" / "sketches" / "xsensor_bridge.py"
ROWS, COLUMNS, LENGTH, BREADTH = 31, 9, 0.27, 0.09
AREA = LENGTH * BREADTH / (ROWS * COLUMNS)
PSI = 6894.757  # Pa

LIBRARY = r"""
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <unistd.h>

static int taken = 0, unit = -1;
static bool opened = false;

extern "C" {
bool XS_InitLibrary(bool threaded) { return !threaded; }
bool XS_ExitLibrary() { printf("exit\n"); return true; }
const char *XS_GetLastErrorCodeAsString() { return "no sensor"; }
void XS_SetCalibrationFolderUTF8(const char *folder) { printf("calibration %s\n", folder); }
void XS_SetAllowX4(bool) {}
void XS_SetAllowX4Wireless(bool) {}
void XS_SetX4Mode8Bit(bool) {}
void XS_SetSampleAverageCount(uint16_t) {}
uint32_t XS_EnumSensors() { return getenv("NO_INSOLES") ? 0 : 2; }
bool XS_AutoConfig(uint8_t pressure_unit, float target) { unit = pressure_unit; return target == -1.0f; }
uint32_t XS_ConfigSensorCount() { return 2; }
uint64_t XS_ConfigSensorPID(uint32_t index) { return 0x123456789ABC0000ull + index; }
bool XS_IsX4FootSensor(uint64_t sensor, bool &foot, bool &left) {
    foot = true;
    left = (sensor & 1) == 0 && sensor >> 32 == 0x12345678;
    return true;
}
bool XS_GetSensorDimensions(uint64_t, uint16_t &rows, uint16_t &columns) { rows = 31; columns = 9; return true; }
bool XS_OpenConnection(uint32_t) { return opened = true; }
bool XS_CloseConnection() { opened = false; return true; }
bool XS_Sample() { usleep(5000); taken++; return opened && taken <= 1000; }
bool XS_GetPressure(uint64_t sensor, float *cells) {
    for (int row = 0; row < 31; row++)
        for (int column = 0; column < 9; column++)
            cells[9 * row + column] = row == 30 && column == 0 ? -1.0f :
                unit == 8 ? 100.0f * row + 10.0f * column + ((sensor & 1) ? 5000.0f : 0.0f) : 0.0f;
    return true;
}
}
"""


class Receiver:
    """UDP port of one insole, and its block."""

    def __init__(self, side):
        self.end = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.end.bind(("127.0.0.1", 0))
        self.end.settimeout(20.0)
        self.address = f"127.0.0.1:{self.end.getsockname()[1]}"
        self.block = Wired(Insole, side=side, rows=ROWS, columns=COLUMNS, length=LENGTH, breadth=BREADTH)

    def take(self):
        """Receive a frame, and return the pressures in it."""
        data = self.end.recv(2048)
        assert TAKEN in hear(self.block, data)
        raw = np.frombuffer(data[16:-2], "<u2").reshape(ROWS, COLUMNS).astype(float)
        return np.where(raw == 65535, np.nan, 10.0 * raw)

    def close(self):
        self.end.close()


@pytest.fixture
def feet():
    receivers = {side: Receiver(side) for side in ("left", "right")}
    yield receivers
    for receiver in receivers.values():
        receiver.close()


def bridge(feet, *arguments, **options):
    targets = [text for side, receiver in feet.items() for text in (f"--{side}", receiver.address)]
    return subprocess.Popen(
        [sys.executable, BRIDGE, *map(str, arguments), *targets],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **options,
    )


def write_export(path, samples):
    """Write pressures of each foot as XSENSOR's software does. samples : [{side: rows from the toes, in psi}]"""
    sides = list(samples[0])
    places = {side: np.argwhere(np.isfinite(samples[0][side])) for side in sides}
    head = ["Frame", "Date", "Time", "Units", "Threshold", "Note"]
    for side in sides:
        head += ["Sensor", "Insole Side", "Rows", "Columns", "Est. Load (lbf)"]
        head += [f"S_{row + 1}_{column + 1}" for row, column in places[side]]
    with path.open("w", newline="", encoding="utf-8-sig") as file:
        table = csv.writer(file)
        table.writerow(["XSENSOR export"])
        table.writerow(head)
        for number, sample in enumerate(samples):
            row = [number + 1, "2026-01-01", f"10:02:{3 + 0.01 * number:06.3f} AM", "PSI", 0.1, ""]
            for side in sides:
                row += ["HX210", side.title(), ROWS, COLUMNS, 0.0]
                row += [f"{sample[side][tuple(place)]:.6f}" for place in places[side]]
            table.writerow(row)


def pressures(seed):
    """Rows from the toes, in psi; a corner has no cell."""
    random = np.random.default_rng(seed).uniform(0.0, 30.0, (ROWS, COLUMNS))
    random[0, :3] = np.nan
    return random


def test_an_export_is_sent_in_pascal_from_the_heel_at_its_times(feet, tmp_path):
    samples = [{"left": pressures(2 * n), "right": pressures(2 * n + 1)} for n in range(5)]
    write_export(tmp_path / "walk.csv", samples)
    process = bridge(feet, tmp_path / "walk.csv")
    for sample in samples:
        for side, receiver in feet.items():
            expected = sample[side][::-1] * PSI
            np.testing.assert_allclose(receiver.take(), expected, atol=5.1)
            assert receiver.block["force"] == pytest.approx(np.nansum(expected) * AREA, rel=1e-3)
            assert receiver.block["dead"] == 3
    out, err = process.communicate(timeout=20)
    assert process.returncode == 0 and out == "sent: 5 frames left, 5 frames right\n", err
    assert feet["left"].block["received"] == 5 and feet["left"].block["lost"] == 0


def test_rows_and_columns_can_be_reversed(feet, tmp_path):
    sample = {"left": pressures(1), "right": pressures(2)}
    write_export(tmp_path / "walk.csv", [sample])
    process = bridge(feet, tmp_path / "walk.csv", "--flip", "--mirror", "left")
    np.testing.assert_allclose(feet["left"].take(), sample["left"][:, ::-1] * PSI, atol=5.1)
    np.testing.assert_allclose(feet["right"].take(), sample["right"] * PSI, atol=5.1)
    process.communicate(timeout=20)


@pytest.mark.parametrize(
    "text, said",
    [
        ("a,b\n1,2\n", "no line begins with Frame and has a column Sensor"),
        ("Frame,Time,Units,Sensor,Insole Side,S_1_1\n1,0.0,furlong,HX,Left,3\n", "the unit 'furlong' is not known"),
        ("Frame,Time,Units,Sensor,Insole Side,S_1_1\n1,0.0,psi,HX,Both,3\n", "expected Left or Right"),
    ],
)
def test_another_file_is_rejected(feet, tmp_path, text, said):
    (tmp_path / "walk.csv").write_text(text)
    _, err = bridge(feet, tmp_path / "walk.csv").communicate(timeout=20)
    assert said in err and "Traceback" not in err


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    if shutil.which("g++") is None:
        pytest.skip("needs a C++ compiler")
    folder = tmp_path_factory.mktemp("library")
    (folder / "library.cpp").write_text(LIBRARY)
    subprocess.run(
        ["g++", "-shared", "-fPIC", folder / "library.cpp", "-o", folder / "XSCore90.so"], check=True, timeout=120
    )
    return folder / "XSCore90.so"


def test_insoles_of_the_library_are_sent_until_ctrl_c(feet, library):
    process = bridge(feet, library, "--calibration", "folder")
    row, column = np.mgrid[0:ROWS, 0:COLUMNS]
    for _ in range(10):
        for side, receiver in feet.items():
            expected = 100.0 * row + 10.0 * column + 5000.0 * (side == "right")
            expected[30, 0] = np.nan
            np.testing.assert_allclose(receiver.take(), expected[::-1])
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=20)
    assert process.returncode == 0 and "left: 31 rows, 9 columns" in out and "calibration folder\n" in out, err
    assert out.count("exit\n") == 1 and "frames left" in out


def test_a_library_without_insoles_is_reported(feet, library):
    process = bridge(feet, library, env={"NO_INSOLES": "1"})
    _, err = process.communicate(timeout=20)
    assert process.returncode == 1 and err == "xsensor_bridge: XS_EnumSensors: no sensor\n"
