"""`calibrate FILE [SENSOR]`: bias, offset and scale of one IMU."""

import os
import time
from pathlib import Path

from runtime.base.ending import Interrupted, handled
from runtime.base.errors import CHECK_FAILED, OK, BadInput
from runtime.base.options import number
from runtime.cli.parsing import Parser, add_options
from runtime.console.terminal import complain, tell
from runtime.session.request import Request

EPILOG = """\
  calibrate diagrams/leg.py left/shank_imu --rig lab.toml
  calibrate diagrams/leg.py --only gyroscope --duration 10 --rig lab.toml

On a rig: rest the sensor on a table on each of its six sides for two seconds; then turn it slowly in all directions,
away from iron. The command reports its progress and ends when it has enough readings, or on Ctrl-C. No actuator is
armed. Without a rig, the file's plant turns an emulated sensor.
"""
PARTS = ("gyroscope", "accelerometer", "magnetometer")
DURATION_LIMIT = 600.0  # s
REPORT_INTERVAL = 2.0  # s of readings between two progress reports


def main(arguments):
    parser = Parser(
        "calibrate", "Find bias, offset and scale of an IMU, and keep them in a TOML file that its block reads.", EPILOG
    )
    add_options(parser, Request, "file", "rate", "settings", "rig")
    parser.add_argument("sensor", nargs="?", metavar="SENSOR", help="path of its block, where the diagram has several")
    parser.add_argument(
        "--only", type=parts, default=PARTS, metavar="PARTS", help="some of gyroscope,accelerometer,magnetometer"
    )
    parser.add_argument(
        "--duration",
        type=number("--duration", "seconds", DURATION_LIMIT),
        metavar="S",
        help="duration of the readings (default: on a rig until complete, at most 120; in simulation 60)",
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("calibration"),
        metavar="DIR",
        help="folder of the files (default: calibration)",
    )
    options = parser.parse_args(arguments)
    from runtime.commissioning.calibration.result import find

    sensor, readings = measured(options)
    found = find(readings, options.only)
    tell(
        [
            f"{sensor.path}: {readings.time[-1]:.0f} s, {len(found.rates)} positions at rest"
            + (f" ({', '.join(found.faces)} up)" if found.faces else ""),
            *found.lines(),
        ]
    )
    if not found.parts:
        complain(["tickwork: no part could be calibrated; nothing was written"])
        return CHECK_FAILED
    tell(written(options.out, sensor, found))
    return OK if not found.missing else CHECK_FAILED


def parts(text):
    found = tuple(word.strip() for word in text.split(","))
    stranger = next((word for word in found if word not in PARTS), None)
    if stranger is not None:
        from graph.names import suggestion

        raise BadInput(f"--only {stranger}: {suggestion(stranger, PARTS) or 'expected ' + ', '.join(PARTS)}")
    return found


def measured(options):
    """(sensor, Readings)"""
    from runtime.commissioning.calibration.measuring import OnRig, sensor_of, simulated
    from runtime.diagrams.file import load
    from runtime.rig import read

    rig = read(options.rig) if options.rig is not None else None
    file, diagram = load(options.file, options.settings, rig)
    if options.rate is not None:
        diagram.rate = options.rate
    sensor = sensor_of(diagram, options.sensor)
    sensor.set("calibration", "")  # readings without an earlier calibration
    if rig is None:
        return sensor, simulated(file, diagram, sensor, options.duration or 60.0)
    with OnRig(rig, sensor) as rig_sensor:
        return sensor, watched(rig_sensor, options)


def watched(rig_sensor, options):
    """Return the Readings on a rig and report progress. Ctrl-C ends the readings; those so far are used."""
    from runtime.commissioning.calibration.measuring import NOTHING
    from runtime.commissioning.calibration.result import find

    readings, before = NOTHING, None
    deadline = time.monotonic() + (options.duration or 120.0)
    try:
        while (left := deadline - time.monotonic()) > 0.0:
            readings = readings.plus(rig_sensor.read(min(REPORT_INTERVAL, max(left, 0.1))))
            found = find(readings, options.only)
            if options.duration is None and not found.missing:
                break
            now = (tuple(found.faces), tuple(found.missing.items()))
            if now != before:
                complain([f"  {part}: {why}" for part, why in found.missing.items()])
            before = now
    except Interrupted:
        if not len(readings.time):
            raise
        handled()
    return readings


def written(folder, sensor, found):
    """Write the file and the plot. Returns the lines to print. Parts calibrated earlier but not now are kept."""
    from blocks.imus.calibration import Calibration
    from runtime.commissioning.calibration.picture import draw

    name = sensor.path.replace("/", "_")
    path, picture = folder / f"{name}.toml", folder / f"{name}.png"
    try:
        os.makedirs(folder, exist_ok=True)
        calibration, kept = found.calibration, []
        if path.exists():
            old = Calibration.read(path)
            kept = [part for part in old.parts_of(path.read_text(encoding="utf-8")) if part not in found.parts]
            calibration = calibration.with_parts(old, kept)
        about = {"name": sensor.path, "kind": type(sensor).__name__, "made": time.strftime("%Y-%m-%d %H:%M:%S")}
        text = calibration.text(about, [*found.parts, *kept])
        new = path.with_suffix(".new")
        new.write_text(text, encoding="utf-8")
        os.replace(new, path)
        with open(picture, "wb") as file:
            draw(sensor.path, found, file)
    except OSError as error:
        raise BadInput(f"{error.filename or folder}: {error.strerror}") from None
    except ValueError as error:
        raise BadInput(f"{error}; it is left as it is") from None
    return [
        f"written: {path}, {picture}" + (f"; kept from before: {', '.join(kept)}" if kept else ""),
        f'in the rig: [device."{sensor.path}"] calibration = "{path}"',
    ]
