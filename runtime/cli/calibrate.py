"""`calibrate FILE [SENSOR]`: find bias, offset and scale of one IMU from readings in many orientations."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from runtime.cli.parsing import Parser, add_number, add_options
from runtime.host.console.terminal import print_lines, print_to_stderr
from runtime.host.ending import Interrupted, forget_interrupt
from runtime.host.errors import CHECK_FAILED, OK, BadInput
from runtime.host.replaced_file import replacement, write
from runtime.session.request import Request

if TYPE_CHECKING:
    from argparse import Namespace

    from blocks.imus.calibration import Calibration
    from graph.device import Device
    from runtime.setup.commissioning.calibration.measuring import OnRig, Readings
    from runtime.setup.commissioning.calibration.result import Result

EPILOG = """\
examples:
  calibrate diagrams/leg.py left/shank_imu --rig lab.toml
  calibrate diagrams/leg.py --only gyroscope --duration 10 --rig lab.toml

On a rig: rest the sensor on a table on each of its six sides for two seconds; then turn it slowly in all directions,
away from iron. The command reports its progress and ends when it has enough readings, or on Ctrl-C. No actuator is
armed. Without a rig, the file's plant turns an emulated sensor.
"""
PARTS = ("gyroscope", "accelerometer", "magnetometer")
DURATION_LIMIT = 600.0  # s
REPORT_PERIOD = 2.0  # s between progress reports


def main(arguments: Sequence[str]) -> int:
    """Run the command. Returns the exit code: 1 if a part could not be calibrated."""
    parser = Parser(
        "calibrate", "Find bias, offset and scale of an IMU, and write them to a TOML file for its block.", EPILOG
    )
    add_options(parser, Request, "file", "rate", "settings", "rig")
    parser.add_argument(
        "sensor", nargs="?", metavar="SENSOR", help="path of the IMU's block, if the diagram has several"
    )
    parser.add_argument(
        "--only",
        type=parts,
        default=PARTS,
        metavar="PARTS",
        help="calibrate only these: gyroscope,accelerometer,magnetometer",
    )
    add_number(
        parser,
        "--duration",
        "seconds",
        "S",
        "duration (default: 60 in simulation; on a rig until all parts are calibrated, at most 120)",
        maximum=DURATION_LIMIT,
    )
    parser.add_argument(
        "--out", type=Path, default=Path("calibration"), metavar="DIR", help="output folder (default: calibration)"
    )
    options = parser.parse_args(arguments)
    from runtime.setup.commissioning.calibration.result import find

    sensor, readings = measure_sensor(options)
    result = find(readings, options.only)
    print_lines(
        [
            f"{sensor.path}: {readings.time[-1]:.0f} s, {len(result.rates)} positions at rest"
            + (f" ({', '.join(result.faces)} up)" if result.faces else ""),
            *result.lines(),
        ]
    )
    if not result.parts:
        print_to_stderr(["tickwork: no part could be calibrated; no file was written"])
        return CHECK_FAILED
    print_lines(write_result(options.out, sensor, result))
    return OK if not result.missing else CHECK_FAILED


def parts(text: str) -> tuple[str, ...]:
    """Convert the text of --only. Raises BadInput."""
    names = tuple(word.strip() for word in text.split(","))
    unknown = next((word for word in names if word not in PARTS), None)
    if unknown is not None:
        from runtime.host.suggestions import suggestion

        raise BadInput(f"--only {unknown}: {suggestion(unknown, PARTS) or 'expected ' + ', '.join(PARTS)}")
    return names


def measure_sensor(options: Namespace) -> tuple[Device, Readings]:
    """Measure on the rig or in simulation. Returns (sensor, Readings)."""
    from runtime.robot.loading.file import load
    from runtime.robot.rig.file import read
    from runtime.setup.commissioning.calibration.measuring import OnRig, sensor_of, simulate_readings

    rig = read(options.rig) if options.rig is not None else None
    file, diagram = load(options.file, options.settings, rig)
    if options.rate is not None:
        diagram.rate = options.rate
    sensor = sensor_of(diagram, options.sensor)
    present(file_of(options.out, sensor))  # before the operator turns the sensor
    sensor.set("calibration", "")  # measure without the present calibration
    if rig is None:
        return sensor, simulate_readings(file, diagram, sensor, options.duration or 60.0)
    with OnRig(rig, sensor) as source:
        return sensor, measure_on_rig(source, options)


def measure_on_rig(source: OnRig, options: Namespace) -> Readings:
    """Measure on a rig and report progress. Returns Readings; Ctrl-C ends the measurement early."""
    from runtime.setup.commissioning.calibration.measuring import NOTHING
    from runtime.setup.commissioning.calibration.result import find

    readings, before = NOTHING, None
    deadline = time.monotonic() + (options.duration or 120.0)
    try:
        while (left := deadline - time.monotonic()) > 0.0:
            readings = readings.plus(source.read(min(REPORT_PERIOD, max(left, 0.1))))
            result = find(readings, options.only)
            if options.duration is None and not result.missing:
                break
            now = (tuple(result.faces), tuple(result.missing.items()))
            if now != before:
                print_to_stderr([f"  {part}: {why}" for part, why in result.missing.items()])
            before = now
    except Interrupted:
        if not len(readings.time):
            raise
        forget_interrupt()
    return readings


def file_of(folder: Path, sensor: Device) -> Path:
    """Return the path of the TOML file of a sensor."""
    return folder / f"{sensor.path.replace('/', '_')}.toml"


def present(path: Path) -> tuple[Calibration, list[str]]:
    """Return (Calibration, its parts) of a TOML file, without parts if there is none. Raises BadInput."""
    from blocks.imus.calibration import Calibration

    try:
        text = path.read_text(encoding="utf-8-sig")
        return Calibration.of(text, path), Calibration.parts_of(text)
    except FileNotFoundError:
        return Calibration(), []
    except OSError as error:
        raise BadInput(f"{path}: {error.strerror}") from None
    except ValueError as error:
        raise BadInput(f"{error}; the file was not changed: correct or remove it") from None


def write_result(folder: Path, sensor: Device, result: Result) -> list[str]:
    """Write the TOML file and the picture. Returns lines for standard output.

    Parts of the present file that were not calibrated now are kept.
    """
    from runtime.setup.commissioning.calibration.picture import draw

    path = file_of(folder, sensor)
    picture = path.with_suffix(".png")
    old, parts = present(path)
    kept = [part for part in parts if part not in result.parts]
    try:
        os.makedirs(folder, exist_ok=True)
        calibration = result.calibration.with_parts(old, kept)
        about = {"name": sensor.path, "kind": type(sensor).__name__, "made": time.strftime("%Y-%m-%d %H:%M:%S")}
        text = calibration.text(about, [*result.parts, *kept])
        write(path, text)
        with replacement(picture) as file:
            draw(sensor.path, result, file)
    except OSError as error:
        raise BadInput(f"{error.filename or folder}: {error.strerror}") from None
    return [
        f"written: {path}, {picture}" + (f"; kept from before: {', '.join(kept)}" if kept else ""),
        f'in the rig: [device."{sensor.path}"] calibration = "{path}"',
    ]
