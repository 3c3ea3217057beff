"""`scan`: every drive and sensor that answers on a bus."""

import json
from pathlib import Path

from runtime.base.errors import CHECK_FAILED, OK, BadInput
from runtime.base.options import TIME_LIMIT, number
from runtime.cli.parsing import Parser, add_bus
from runtime.commissioning import imus, ports_inventory, scan_text
from runtime.commissioning.bus import ToolBus, named_buses
from runtime.commissioning.chips import look
from runtime.commissioning.scan import clock, plain, scan
from runtime.console.terminal import complain, tell
from runtime.rig.errors import Refused
from runtime.rig.file import I2C

HIGHEST = 255


def main(arguments):
    parser = Parser(
        "scan",
        "Tell every drive and sensor that answers, on the buses of a rig, on one, or on all CAN interfaces "
        "and serial ports here.",
        "Nothing is armed: no enable is sent, and drives in MIT mode are asked with disable, which is answered and "
        "leaves them without\n"
        "torque. Where another controller commands drives nothing is sent. The exit code is 1 where a bus could not be "
        "opened, no device\n"
        "answers, or something is wrong. Other serial ports, such as those of microcontrollers, are listed and not "
        "opened, since that restarts\n"
        "many a board; so are chips of GPIO lines. What sends over a network, as insoles do, cannot be listed: its "
        "program says to which port.",
    )
    add_bus(parser)
    parser.add_argument(
        "--ids", type=ids, default="1-127", metavar="IDS", help="ids that are asked: 1-127 (default), 1-255, 3,4,10-20"
    )
    parser.add_argument(
        "--listen",
        type=number("--listen", "seconds", TIME_LIMIT),
        default=1.0,
        metavar="S",
        help="how long to listen before anything is asked (default: 1, which a drive in servo mode may need)",
    )
    parser.add_argument(
        "--write-rig", type=Path, metavar="FILE", help="write a rig file with the buses, and what was found as remarks"
    )
    parser.add_argument("--verbose", action="store_true", help="tell every frame that was sent")
    parser.add_argument("--json", action="store_true", help="for machines: one JSON object")
    options = parser.parse_args(arguments)
    if options.write_rig is not None and options.write_rig.exists():
        raise BadInput(f"--write-rig {options.write_rig}: it is there already, and is not overwritten")
    wanted = ids(options.ids) if isinstance(options.ids, str) else options.ids
    reports, buses, refused = [], [], []
    everywhere = not (options.channel or options.interface or options.bus)
    sensors, unasked = imus.look() if everywhere else ([], [])
    others = ports_inventory.look({each.port for each in sensors}) if everywhere and options.rig is None else ([], [])
    try:
        wanted_buses = on_can(options, sensors or unasked)
    except BadInput:
        if not options.json:
            tell(ports_inventory.text(others))
        raise
    for about in wanted_buses:
        try:
            if about.interface == I2C:
                reports.append(look(about))
            else:
                with ToolBus(about) as bus:
                    reports.append(scan(bus, wanted, options.listen))
            buses.append(about)
        except Refused as trouble:
            refused.append(trouble.trouble)
    complain([*map(str, refused), *unasked])
    if options.json:
        troubles = [{"code": trouble.code, "message": trouble.message, "hint": trouble.hint} for trouble in refused]
        told = {
            "buses": [plain(report) for report in reports],
            "sensors": [imus.plain(each) for each in sensors],
            **ports_inventory.plain(others),
            "troubles": troubles,
        }
        tell([json.dumps(told, indent=2, ensure_ascii=False)])
    else:
        tell(
            [
                *(line for report in reports for line in scan_text.text(report, options.verbose)),
                *imus.text(sensors),
                *ports_inventory.text(others),
            ]
        )
    if options.write_rig is not None and reports:
        write(options.write_rig, scan_text.rig(reports, buses, clock()))
        complain([f"written: {options.write_rig}"])
    found = all(report.drives or report.nodes or report.chips for report in reports)
    strange = any(
        report.remarks or any(found.remarks for found in [*report.drives, *report.nodes]) for report in reports
    )
    return OK if (reports or sensors) and found and not (refused or strange or unasked) else CHECK_FAILED


def on_can(options, others):
    """The buses to look at. others : what else there is to tell, so that it is no mistake to have none"""
    try:
        return named_buses(options)
    except BadInput:
        if others and options.rig is None:
            return []
        raise


def write(path, text):
    try:
        with open(path, "x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise BadInput(f"--write-rig {path}: it is there already, and is not overwritten") from None
    except OSError as error:
        raise BadInput(f"--write-rig {path}: {error.strerror}") from None


def ids(text):
    """A sorted list of ids. BadInput"""
    found = set()
    for part in text.split(","):
        first, _, last = part.partition("-")
        if not first.isdecimal() or (last or "0").isdecimal() is False or (part.endswith("-")):
            raise BadInput(f"--ids {text}: expected ids from 1 to {HIGHEST}, as in 1-127 or 3,4,10-20")
        span = range(int(first), int(last or first) + 1)
        if not span or span[0] < 1 or span[-1] > HIGHEST:
            raise BadInput(f"--ids {text}: expected ids from 1 to {HIGHEST}, as in 1-127 or 3,4,10-20")
        found |= set(span)
    return sorted(found)
