"""`commission RIG FILE`: a guided hour on the bench, which finds what is wrong and leaves a record of each device."""

from __future__ import annotations

import datetime
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from runtime.cli.parsing import Parser, add_number, add_options
from runtime.host.console.terminal import print_lines
from runtime.host.errors import CHECK_FAILED, OK, BadInput
from runtime.host.options import finite
from runtime.host.suggestions import suggestion
from runtime.session.request import Request

if TYPE_CHECKING:
    from argparse import Namespace

    from runtime.robot.rig.file import RigFile
    from runtime.robot.rig.records import Record
    from runtime.setup.commissioning.guided.bench import Bench
    from runtime.setup.commissioning.guided.home import Home

EPILOG = """\
examples:
  commission lab.toml knee.py
  commission lab.toml knee.py --device left/knee --again turn
  commission lab.toml knee.py --only identity bus state
  commission lab.toml knee.py --device left/knee --only home --toward lower --torque 0.4 --travel 60
  commission lab.toml knee.py --device left/knee --only dynamics
  commission lab.toml knee.py --device left/knee --only stops

Take the drives off the person and hold the switch of their power. Each step prints what it does, what could move, and
what it found. Steps without torque come first; a drive gets torque, at most 5 % of rated, only if they found nothing.
Records are written beside the rig, in RIG.records/. A step with a fresh record is not repeated.
"""
ANGLE = 90.0  # degrees
SPEED = 60.0  # degrees/s


def main(arguments: Sequence[str]) -> int:
    """Run the command. Returns the exit code: 1 if a device differs."""
    from runtime.setup.commissioning.guided.steps import BUTTON_STEPS, INSOLE_STEPS, SENSOR_STEPS, STEPS

    names = [step.name for step in (*STEPS, *SENSOR_STEPS, *INSOLE_STEPS, *BUTTON_STEPS)]
    parser = Parser("commission", "Find what is wrong with each device of a rig, step by step, and record it.", EPILOG)
    parser.add_argument("rig", type=Path, metavar="RIG", help="rig file, such as lab.toml")
    add_options(parser, Request, "file", "settings")
    parser.add_argument("--device", action="append", metavar="PATH", help="only this device; may be repeated")
    parser.add_argument(
        "--only", nargs="+", choices=names, metavar="STEP", help=f"only these steps: {', '.join(names)}"
    )
    parser.add_argument(
        "--again", nargs="*", choices=names, metavar="STEP", help="repeat steps with a fresh record; alone: all of them"
    )
    add_number(parser, "--angle", "degrees", "DEG", "angle between the two marks", default=ANGLE, maximum=360.0)
    parser.add_argument(
        "--pose",
        type=finite("--pose", "degrees"),
        default=0.0,
        metavar="DEG",
        help="angle at which the step `pose` holds the joint",
    )
    parser.add_argument("--name", metavar="NAME", help="your name, for the records (default: asked)")
    add_number(
        parser, "--travel", "degrees", "DEG", "motion in the steps home and dynamics", default=ANGLE, maximum=720.0
    )
    homing = parser.section("homing against a stop, with --only home")
    homing.add_argument("--toward", choices=("lower", "upper"), help="end of the range to which the joint is driven")
    add_number(homing, "--torque", "N·m", "T", "largest torque, at most 5 %% of rated; required")
    add_number(homing, "--speed", "degrees/s", "V", "speed beyond which the run ends", default=SPEED, maximum=180.0)
    homing.add_argument(
        "--at",
        type=finite("--at", "degrees"),
        metavar="DEG",
        help="angle of the joint at this stop (default: the end of its range)",
    )
    return commission(parser.parse_args(arguments))


def commission(options: Namespace) -> int:
    """Commission the devices that the options select. Returns the exit code."""
    from runtime.record.recorder import can_ask
    from runtime.robot.loading.file import compile_diagram, load
    from runtime.robot.rig.file import read
    from runtime.setup.commissioning.guided.bench import Bench, ask

    if not can_ask():
        raise BadInput("the operator answers at each step: run commission in a terminal, without pipes")
    rig = read(options.rig)
    file, diagram = load(options.file, options.settings, rig)
    compile_diagram(file.path, diagram)
    with Bench(file.path, rig, diagram, options.settings) as bench:
        devices = selected(bench, options.device)
        home = home_of(options, devices)
        name = options.name or ask("Your name, for the records")
        if not name:
            raise BadInput("a record is signed: enter a name, or pass --name")
        differs, cures = False, {}
        for number, block in enumerate(devices, 1):
            print_lines(["", f"{block.path}: {place_of(block)} ({number} of {len(devices)})"])
            record, cures[block.path] = commission_device(bench, block, options, name, home)
            differs = differs or bool(record.findings)
    offer(rig, cures)
    return CHECK_FAILED if differs else OK


def selected(bench: Bench, paths: Sequence[str] | None) -> list[Any]:
    """Return the devices to commission. Raises BadInput for a path without one."""
    known = {block.path: block for block in (*bench.drives, *bench.sensors, *bench.insoles, *bench.buttons)}
    for path in paths or ():
        if path not in known:
            hint = suggestion(path, known) or f"its devices are {', '.join(known) or 'none'}"
            raise BadInput(f"--device {path}: {bench.diagram.name} has no such device; {hint}")
    return [block for path, block in known.items() if not paths or path in paths]


def place_of(block: Any) -> str:
    """Return the model of a device, and where it is, as text."""
    if hasattr(block, "can_id"):
        return f"{getattr(block, 'model', type(block).__name__)}, id {block.can_id} on {block.bus}"
    where = getattr(block, "serial", "") or getattr(block, "address", "") or getattr(block, "port", "")
    return f"{type(block).__name__} {where}".rstrip()


def home_of(options: Namespace, devices: Sequence[Any]) -> Home | None:
    """Return the Home of the options, None without that step. Raises BadInput for one without limits."""
    from runtime.setup.commissioning.guided.home import Home, check_limits

    if "home" not in (options.only or ()):
        return None
    if len(devices) != 1:
        raise BadInput("--only home: one joint at a time, select it with --device")
    if options.toward is None or options.torque is None:
        raise BadInput("--only home: pass --toward lower or upper, and --torque, the largest torque in N·m")
    direction = -1.0 if options.toward == "lower" else 1.0
    at = None if options.at is None else math.radians(options.at)
    home = Home(direction, options.torque, math.radians(options.speed), math.radians(options.travel), at)
    check_limits(devices[0], home)
    return home


def commission_device(
    bench: Bench, block: Any, options: Namespace, name: str, home: Home | None = None
) -> tuple[Record, dict[str, Any]]:
    """Carry out the steps of one device and write its record after each. Returns (Record, cures for the rig)."""
    from runtime.robot.rig.records import StepRecord, file_of, write
    from runtime.setup.commissioning.guided.bench import Given
    from runtime.setup.commissioning.guided.steps import steps_of

    record, cures = record_for(bench, block), {}
    angle, pose, travel = (math.radians(value) for value in (options.angle, options.pose, options.travel))
    picture = file_of(bench.rig.path, record).with_suffix(".png")
    given = Given(angle, pose, travel, home, picture, record.steps)
    steps = [step for step in steps_of(block) if (step.name in options.only if options.only else not step.on_request)]
    for number, step in enumerate(steps, 1):
        again = options.again is not None and (not options.again or step.name in options.again)
        repeat = again or step.on_request
        if step.name in record.steps and not repeat:
            print_lines([f"{number}/{len(steps)} {step.name}: recorded {record.steps[step.name].when}"])
            continue
        print_lines([f"{number}/{len(steps)} {step.name}: {step.does}; {step.moves}"])
        given.before = record.steps.pop(step.name, None)
        if step.driven and (why := off_because(record)):
            print_lines([f"  not carried out: the motor stays off, because {why}"])
            continue
        result = step.of(bench, block, given)
        print_lines([f"  {line}" for line in result.says])
        print_lines([f"  ! {fault}: {text}" for fault, text in result.findings])
        when = datetime.datetime.now()
        record.signed = {"name": name, "date": f"{when:%Y-%m-%d}"}
        record.steps[step.name] = StepRecord(
            f"{when:%Y-%m-%d %H:%M}",
            result.verdict,
            {key: float(f"{value:.6g}") for key, value in result.measured.items()},
            result.says,
            result.findings,
        )
        cures |= result.cures
        write(bench.rig.path, record)
        if step.vital and result.findings:
            print_lines(["  the other steps need a drive that responds alone and as its block expects"])
            break
    return record, cures


def off_because(record: Record) -> str:
    """Return why the device of a record gets no torque, "" if nothing prevents it."""
    from runtime.robot.rig.records import AGREES, BEFORE_TORQUE

    missing = [name for name in BEFORE_TORQUE if name not in record.steps or record.steps[name].verdict != AGREES]
    if record.findings:
        return f"of what was found: {', '.join(dict.fromkeys(fault for fault, _ in record.findings))}"
    return f"these steps come first: {', '.join(missing)}" if missing else ""


def record_for(bench: Bench, block: Any) -> Record:
    """Return the record of the unit behind a drive: the fresh one, or a new one."""
    from runtime.record.storage.provenance import machine, versions
    from runtime.robot.rig.identity import identities
    from runtime.robot.rig.records import Record, records_of, settings_of
    from runtime.setup.commissioning.guided.bench import ask

    unique = firmware = ""
    if block in bench.drives:
        answers = [drive for drive in bench.report(block.bus).drives if drive.can_id == block.can_id]
        if len(answers) == 1:
            unique, firmware = answers[0].unique, answers[0].firmware
    elif len(units := identities(bench.rig, [block], bench.buses).get(block.path, {})) == 1:
        [(unique, firmware)] = units.items()
    records = {record.serial: record for record in records_of(bench.rig.path).values()}
    known = next((record.serial for record in records.values() if record.device == block.path), "")
    serial = unique
    if not serial:
        default = known or block.path.replace("/", "_")
        serial = ask(f"Serial number on the label of {block.path} (empty: {default})") or default
    record = records.get(serial)
    if record is not None:
        reasons = record.mismatches(block)
        if firmware and record.firmware != firmware:
            reasons.append(f"has firmware {record.firmware or 'unknown'}, now {firmware}")
        if not reasons:
            return record
        print_lines([f"  its record {'; '.join(reasons)}: every step is repeated"])
    bus = bench.rig.buses.get(block.bus)
    here = machine()
    about = {
        "computer": f"{here['processor'] or here['architecture']}, {here['system']}",
        "adapter": "its own line" if bus is None else f"{bus.interface}, {bus.bitrate / 1e3:g} kbit/s",
        "tickwork": versions().get("tickwork", "unknown"),
    }
    model = getattr(block, "model", "")
    return Record(serial, block.path, type(block).__name__, model, firmware, about, settings_of(block))


def offer(rig: RigFile, cures: dict[str, dict[str, Any]]) -> None:
    """Offer to write hardware parameters that were found to the rig file."""
    from runtime.setup.commissioning import rig_edit
    from runtime.setup.commissioning.bus import plain
    from runtime.setup.commissioning.guided.bench import confirmed

    text = rig.text
    lines = []
    for path, values in cures.items():
        if values:
            text = rig_edit.change_device(rig.path, text, path, values)
            lines += [f'  [device."{path}"] {name} = {plain(value)}' for name, value in values.items()]
    if not lines:
        return
    print_lines(["", f"{rig.path} would agree with what was found with", *lines])
    if confirmed(f"write this to {rig.path}"):
        rig_edit.write(rig.path, rig.text, text)
        print_lines([f"written: {rig.path}; commission the changed devices again"])
