"""`scan`: list the drives and sensors that respond."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from runtime.cli.parsing import Parser, add_bus
from runtime.host import replaced_file
from runtime.host.console.terminal import print_lines, print_to_stderr
from runtime.host.errors import CHECK_FAILED, OK, BadInput
from runtime.host.options import TIME_LIMIT, number
from runtime.robot.rig.errors import Refused
from runtime.robot.rig.file import I2C
from runtime.robot.rig.tool_bus import ToolBus
from runtime.setup.commissioning import imus, ports_inventory, scan_text
from runtime.setup.commissioning.bus import named_buses
from runtime.setup.commissioning.chips import look
from runtime.setup.commissioning.scan import clock, plain, scan

if TYPE_CHECKING:
    from argparse import Namespace

    from runtime.robot.rig.file import RigBus

ID_LIMIT = 255


def main(arguments: Sequence[str]) -> int:
    """Run the command. Returns the exit code: 1 if a bus has a problem or no device responds."""
    parser = Parser(
        "scan",
        "List every drive and sensor that responds: on the buses of a rig, on one bus, or on all CAN interfaces "
        "and serial ports of this machine.",
        "No motor is enabled: drives in MIT mode are queried with the disable frame, which they answer without torque. "
        "Nothing is sent on a bus where another controller commands drives. Other serial ports and GPIO chips are "
        "listed but not opened, because opening a port restarts many microcontroller boards. Devices that send over a "
        "network, such as insoles, are not listed.\n\n"
        "The exit code is 1 if a bus could not be opened, no device responds, or a problem was found.",
    )
    add_bus(parser)
    parser.add_argument(
        "--ids", type=ids, default="1-127", metavar="IDS", help="ids to query: 1-127 (default), 1-255, 3,4,10-20"
    )
    parser.add_argument(
        "--listen",
        type=number("--listen", "seconds", TIME_LIMIT),
        default=1.0,
        metavar="S",
        help="seconds to listen before the first query (default: 1, required by drives in servo mode)",
    )
    parser.add_argument(
        "--write-rig", type=Path, metavar="FILE", help="write a rig file with the buses, and the devices as comments"
    )
    parser.add_argument("--verbose", action="store_true", help="print every sent frame")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args(arguments)
    if options.write_rig is not None and options.write_rig.exists():
        raise BadInput(f"--write-rig {options.write_rig}: the file exists and is not overwritten")
    can_ids = ids(options.ids) if isinstance(options.ids, str) else options.ids
    reports, buses, refused = [], [], []
    everywhere = not (options.channel or options.interface or options.bus)
    sensors, unasked = imus.look() if everywhere else ([], [])
    others = ports_inventory.look({each.port for each in sensors}) if everywhere and options.rig is None else ([], [])
    try:
        selected = on_can(options, sensors or unasked)
    except BadInput:
        if not options.json:
            print_lines(ports_inventory.text(others))
        raise
    for about in selected:
        try:
            if about.interface == I2C:
                reports.append(look(about))
            else:
                with ToolBus(about) as bus:
                    reports.append(scan(bus, can_ids, options.listen))
            buses.append(about)
        except Refused as error:
            refused.append(error.problem)
    print_to_stderr([*map(str, refused), *unasked])
    if options.json:
        problems = [{"code": problem.code, "message": problem.message, "hint": problem.hint} for problem in refused]
        report = {
            "buses": [plain(report) for report in reports],
            "sensors": [imus.plain(each) for each in sensors],
            **ports_inventory.plain(others),
            "troubles": problems,
        }
        print_lines([json.dumps(report, indent=2, ensure_ascii=False)])
    else:
        print_lines(
            [
                *(line for report in reports for line in scan_text.text(report, options.verbose)),
                *imus.text(sensors),
                *ports_inventory.text(others),
            ]
        )
    if options.write_rig is not None and reports:
        write(options.write_rig, scan_text.rig(reports, buses, clock()))
        print_to_stderr([f"written: {options.write_rig}"])
    all_responded = all(report.drives or report.nodes or report.chips for report in reports)
    remarkable = any(
        report.remarks or any(device.remarks for device in [*report.drives, *report.nodes]) for report in reports
    )
    return OK if (reports or sensors) and all_responded and not (refused or remarkable or unasked) else CHECK_FAILED


def on_can(options: Namespace, others: Sequence[Any]) -> list[RigBus]:
    """Return the buses to scan. others : devices on other lines; with any, no bus is required"""
    try:
        return named_buses(options)
    except BadInput:
        if others and options.rig is None:
            return []
        raise


def write(path: Path, text: str) -> None:
    """Write a new rig file. Raises BadInput if the file exists or cannot be written."""
    try:
        if os.path.lexists(path):
            raise BadInput(f"--write-rig {path}: the file exists and is not overwritten")
        replaced_file.write(path, text)
    except OSError as error:
        raise BadInput(f"--write-rig {path}: {error.strerror}") from None


def ids(text: str) -> list[int]:
    """Convert the text of --ids to a sorted list. Raises BadInput."""
    selected = set()
    for part in text.split(","):
        first, _, last = part.partition("-")
        if not first.isdecimal() or (last or "0").isdecimal() is False or (part.endswith("-")):
            raise BadInput(f"--ids {text}: expected ids from 1 to {ID_LIMIT}, as in 1-127 or 3,4,10-20")
        span = range(int(first), int(last or first) + 1)
        if not span or span[0] < 1 or span[-1] > ID_LIMIT:
            raise BadInput(f"--ids {text}: expected ids from 1 to {ID_LIMIT}, as in 1-127 or 3,4,10-20")
        selected |= set(span)
    return sorted(selected)
