"""`calibrate`: a sensor that is off by known amounts is turned, and the file that comes out puts it right."""

from pathlib import Path

import numpy as np
import pytest

from blocks.imus import MPU9250
from blocks.imus.calibration import Calibration
from graph import Diagram
from runtime.host.errors import BAD_INPUT, CHECK_FAILED, OK
from runtime.robot.rig.file import parse
from runtime.setup.commissioning.calibration import fits, measuring, stillness
from runtime.setup.commissioning.calibration.measuring import OnRig
from tests.runtime.robot.rig.wires import MemoryI2c, Wires, add_mpu
from tests.runtime.runs import write
from tests.runtime.setup.commissioning.calibration import table
from tests.runtime.setup.commissioning.calibration.table import BIAS, FIELD, IRON, OFFSET, SCALE, SOFT, G

TABLE = Path(table.__file__)
CODE = (8 * G / 32768, np.radians(1000.0) / 32768, 4912 / 32760)  # of the emulated sensor: m/s², rad/s, µT


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory):
    """(folder, what the command said) of one run in virtual time."""
    import contextlib
    import io

    from runtime.cli.main import main

    folder, said = tmp_path_factory.mktemp("calibration"), io.StringIO()
    with contextlib.redirect_stdout(said):
        assert main(["calibrate", str(TABLE), "--duration", "45", "--out", str(folder)]) == OK
    return folder, said.getvalue()


def test_calibration_recovers_the_simulated_errors(calibrated):
    """Means over hundreds of codes: half a code of each quantity is the tolerance, of the matrices what that is of g
    and of the field.
    """
    folder, said = calibrated
    found = Calibration.read(folder / "shank.toml")
    assert found.gyro_bias == pytest.approx(BIAS, abs=CODE[1])
    assert found.accel_offset == pytest.approx(OFFSET, abs=CODE[0]) and np.diag(found.accel_matrix) == pytest.approx(
        SCALE, abs=CODE[0] / G
    )
    sphere = SOFT / np.linalg.det(SOFT) ** (1 / 3)  # its size is not to be known: that of the ellipsoid is kept
    assert np.array(found.mag_matrix) == pytest.approx(
        sphere, abs=CODE[2] / 48.0
    ) and found.mag_offset == pytest.approx(IRON, abs=CODE[2])
    assert (
        "6 positions at rest (+x, -x, +y, -y, +z, -z up)" in said and f'calibration = "{folder / "shank.toml"}"' in said
    )


def test_calibration_draws_the_state_before_and_after(calibrated):
    folder, _ = calibrated
    data = (folder / "shank.png").read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n" and len(data) > 20_000


def test_the_calibration_file_corrects_the_measurements_of_a_block(calibrated, command_line):
    folder, _ = calibrated
    code, out, err = command_line(
        TABLE,
        "--fast",
        "--duration",
        "2",
        "--set",
        f"shank.calibration={folder / 'shank.toml'}",
        "--record",
        command_line.folder / "out",
    )
    assert code == OK, err
    rows = [line.split(",") for line in next((command_line.folder / "out").glob("*.csv")).read_text().splitlines()]
    column = {name.split(" [")[0]: place for place, name in enumerate(rows[0])}

    def vector(name):
        return np.array([[float(row[column[f"shank.{name}[{axis}]"]]) for axis in range(3)] for row in rows[20:180]])

    assert vector("accel") == pytest.approx(np.tile((0.0, 0.0, G), (160, 1)), abs=2 * CODE[0])
    assert vector("gyro") == pytest.approx(np.zeros((160, 3)), abs=2 * CODE[1])
    strength = np.linalg.norm(vector("mag"), axis=1)
    assert strength == pytest.approx(np.full(160, strength.mean()), abs=2 * CODE[2])
    assert strength.mean() == pytest.approx(np.linalg.norm(FIELD) / np.linalg.det(SOFT) ** (1 / 3), rel=0.01)


@pytest.mark.soak
def test_parts_that_were_not_requested_are_kept(command_line):
    folder = command_line.folder
    (folder / "shank.toml").write_text("[magnetometer]\noffset = [1.0, 2.0, 3.0]\n")
    code, out, err = command_line("calibrate", TABLE, "--only", "gyroscope", "--duration", "6", "--out", folder)
    assert code == OK and "kept from before: magnetometer" in out, err
    found = Calibration.read(folder / "shank.toml")
    assert (
        found.mag_offset == (1.0, 2.0, 3.0)
        and found.gyro_bias == pytest.approx(BIAS, abs=CODE[1])
        and found.accel_offset == (0.0,) * 3
    )


def test_damaged_file_is_reported_before_the_sensor_is_turned(command_line, monkeypatch):
    monkeypatch.setattr(measuring, "simulate_readings", lambda *arguments: pytest.fail("measured"))
    write(command_line.folder, "gyroscope\n", "shank.toml")
    said = command_line.refused("calibrate", TABLE, "--out", command_line.folder)
    assert said.startswith("shank.toml: invalid TOML") and said.endswith(
        "the file was not changed: correct or remove it"
    )


def test_parts_without_readings_are_reported_and_the_rest_is_written(command_line):
    code, out, err = command_line("calibrate", TABLE, "--duration", "8", "--out", command_line.folder)
    assert code == CHECK_FAILED
    assert "accelerometer  not calibrated: no rest with +x, -x, -y up" in out and "magnetometer   not calibrated" in out
    assert "gyroscope      bias" in out and (command_line.folder / "shank.toml").exists()


def test_scan_writes_no_rig_file_without_findings(command_line):
    code, out, err = command_line(
        "calibrate", TABLE, "--only", "magnetometer", "--duration", "1", "--out", command_line.folder
    )
    assert (
        code == CHECK_FAILED
        and "no part could be calibrated" in err
        and not (command_line.folder / "shank.toml").exists()
    )


@pytest.mark.parametrize(
    "words, said",
    [
        (("thigh",), "thigh is not a sensor that can be calibrated; available: shank"),
        (("--only", "gyroscop"), "did you mean 'gyroscope'?"),
    ],
)
def test_invalid_arguments_are_rejected(command_line, words, said):
    code, out, err = command_line("calibrate", TABLE, *words)
    assert code == BAD_INPUT and said in err


def test_on_a_rig_the_sensor_alone_is_opened_and_read(tmp_path, monkeypatch):
    """The rest of the robot, a drive on CAN among it, is neither opened nor armed."""
    from blocks.actuators import CubeMars
    from runtime.robot.rig.chips import Chips

    wires = MemoryI2c()
    number, _ = add_mpu(wires)
    wires.write(number, 0x3B, b"\x00\x00\x00\x00\x10\x00" + bytes(8))
    monkeypatch.setattr("runtime.robot.rig.i2c.open_adapter", lambda bus: (Chips(Wires(wires)), wires))
    rig = parse(
        tmp_path / "lab.toml",
        '[bus.imus]\ninterface = "i2c"\nchannel = '
        '"/dev/i2c-99"\n[bus.legs]\ninterface = "socketcan"\nchannel = "nocan"\n',
    )
    with Diagram("robot", rate=200) as robot:
        MPU9250(name="shank", bus="imus")
        CubeMars("AK80-9", bus="legs", can_id=1)(torque_command=0.0)
    with OnRig(rig, robot["shank"]) as there:
        first = there.read(0.1)
        both = first.plus(there.read(0.1))
    # a busy machine skips ticks
    assert 0 < len(first.time) <= 20 and len(both.time) > len(first.time) and np.all(np.diff(both.time) > 0.0)
    assert both.accel[-1] == pytest.approx([0.0, 0.0, G], rel=1e-12)


# The fits


def directions(count):
    """Points of a sphere, evenly."""
    k = np.arange(count) + 0.5
    z, turn = 1.0 - 2.0 * k / count, np.pi * (1.0 + 5.0**0.5) * k
    return np.column_stack([np.sqrt(1.0 - z * z) * np.cos(turn), np.sqrt(1.0 - z * z) * np.sin(turn), z])


def rests(accel, gyro=(0.0, 0.0, 0.0)):
    return [stillness.Rest(np.asarray(row, float), np.asarray(gyro, float), 1.0) for row in accel]


def test_twelve_positions_calibrate_non_orthogonal_axes():
    """Exact to rounding, as there is no noise."""
    matrix = np.array(((1.02, 0.01, -0.02), (0.01, 0.98, 0.015), (-0.02, 0.015, 1.01)))
    offset = np.array((0.2, -0.3, 0.1))
    positions = np.vstack([np.eye(3), -np.eye(3), directions(12)]) * G
    found = fits.accelerometer(rests(positions @ np.linalg.inv(matrix).T + offset))
    assert found[0] == pytest.approx(offset, abs=1e-7) and found[1] == pytest.approx(matrix, abs=1e-8)


def test_six_positions_may_be_tilted():
    """Within 20° of each side: what counts is that gravity is as long in all."""
    tilted = np.vstack([np.eye(3), -np.eye(3)]) + 0.2 * np.array([[0.3, -1, 0.5], [1, 0.2, -0.4], [-0.6, 0.7, 0.1]] * 2)
    tilted = G * tilted / np.linalg.norm(tilted, axis=1, keepdims=True)
    offset, matrix = fits.accelerometer(rests(tilted / SCALE + OFFSET))
    assert offset == pytest.approx(OFFSET, abs=1e-6) and np.diag(matrix) == pytest.approx(SCALE, abs=1e-7)


def test_an_ellipsoid_becomes_a_sphere_of_its_volume():
    field = 50.0 * directions(400) @ np.linalg.inv(SOFT).T + IRON
    offset, matrix = fits.magnetometer(field)
    assert offset == pytest.approx(IRON, abs=1e-9) and matrix == pytest.approx(
        SOFT / np.linalg.det(SOFT) ** (1 / 3), abs=1e-10
    )
    assert np.linalg.norm((field - offset) @ matrix.T, axis=1) == pytest.approx(
        np.full(400, 50.0 / np.linalg.det(SOFT) ** (1 / 3)), rel=1e-12
    )


def test_an_ellipsoid_is_found_in_noise():
    """0.5 µT of noise in 2000 measurements: the centre to 0.1 µT, four standard errors."""
    noise = np.random.default_rng(3).normal(0.0, 0.5, (2000, 3))
    offset, matrix = fits.magnetometer(50.0 * directions(2000) + IRON + noise)
    assert offset == pytest.approx(IRON, abs=0.1) and matrix == pytest.approx(np.eye(3), abs=0.01)


@pytest.mark.parametrize(
    "field",
    [
        50.0 * directions(400)[:100],
        50.0 * directions(400) * (1.0, 1.0, 0.0),
        np.zeros((400, 3)),
        np.tile((20.0, 0.0, -44.0), (400, 1)),
        50.0 * directions(30),
    ],
)
def test_a_magnetometer_with_too_few_directions_is_not_calibrated(field):
    with pytest.raises(fits.Unfit):
        fits.magnetometer(field)


def test_a_constant_rotation_is_neither_rest_nor_bias():
    """As fast as a bias could be, about the vertical, so that nothing else tells it: the median of the rests does."""
    time = np.arange(0.0, 10.0, 0.01)
    accel = np.tile((0.0, 0.0, G), (len(time), 1))
    gyro = np.tile((0.01, 0.0, 0.0), (len(time), 1))
    gyro[700:900, 2] = 0.2
    found = stillness.rests(time, accel, gyro)
    assert fits.gyroscope(found) == pytest.approx((0.01, 0.0, 0.0), abs=1e-12) and len(found) == 1
    with pytest.raises(fits.Unfit, match="of 2 s: leave the sensor on a table"):
        fits.gyroscope([])
