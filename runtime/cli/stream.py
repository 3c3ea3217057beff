"""`stream`: show a drive or sensors live.

`stream actuator ID` shows one drive without torque; `stream imu SERIAL...`, `stream i2c ADDRESS...` and `stream NAME
ADDRESS`, for the CAN sensors of a device family, show sensors.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from blocks.families import example_models, families
from runtime.cli.configure import drive_id
from runtime.cli.move import add_model, model_of
from runtime.cli.parsing import Parser, add_bus, add_number, add_options
from runtime.host.console.terminal import print_lines
from runtime.host.errors import CHECK_FAILED, OK, BadInput
from runtime.host.options import TIME_LIMIT, number
from runtime.record.storage.files import make_folder
from runtime.session.request import Request
from runtime.setup.commissioning.bus import i2c_bus, open_bus, single_bus
from runtime.setup.commissioning.streaming import Watched, stream

if TYPE_CHECKING:
    from argparse import Namespace

    from graph.family import Node
    from runtime.setup.commissioning.streaming import StreamResult

RATE_LIMIT = 500.0  # Hz; each query waits for its reply
EPILOG = """\
examples:
  stream actuator 3 --channel can0 --model {0}
  stream actuator 3 --channel can0 --plotjuggler 127.0.0.1:9870
  stream actuator 9 --rig lab.toml --bus legs --record recordings
  stream imu 133931 --channels accel,gyro --rate 500
  stream imu --rerun
  stream imu --sync GPIO22 --record recordings --duration 30
{1}  stream i2c 0x68 0x70.3:0x48 --channel /dev/i2c-1

No motor is enabled: the drive is queried with its disable or stop frame and can be moved by hand. Press Ctrl-C to end.
"""


def main(arguments: Sequence[str]) -> int:
    """Run the command. Returns the exit code: 1 without any answer."""
    kinds = {"imu": imu, "i2c": i2c}
    nodes = {kind.name.lower(): kind for family in families() for kind in family.nodes}
    if arguments and arguments[0] in nodes:
        return node(nodes[arguments[0]], arguments[1:])
    if arguments and arguments[0] in kinds:
        return kinds[arguments[0]](arguments[1:])
    parser = Parser(
        "stream",
        "Show position, velocity, torque and temperature of one drive live, without enabling it.",
        EPILOG.format(
            example_models()[0], "".join(f"  stream {name} 128 --channel can1 --bitrate 250000\n" for name in nodes)
        ),
    )
    parser.add_argument(
        "kind", metavar="actuator", help="the word actuator; for sensors see `stream imu --help`, `stream i2c --help`"
    )
    parser.add_argument("can_id", metavar="ID", help="CAN id of the drive; `scan` lists those that respond")
    add_bus(parser)
    add_model(parser, "model of the actuator, such as {}; required for velocity and torque")
    add_showing(parser)
    options = parser.parse_args(arguments)
    if options.kind != "actuator":
        raise BadInput(
            f"stream {options.kind}: expected stream actuator ID, or stream imu, {', '.join(nodes)} or i2c. To show "
            "all devices of a robot, run its diagram"
        )
    can_id = drive_id(options.can_id)
    kind, model = model_of(options) if options.model else (None, None)
    with open_bus(single_bus(options)) as bus:
        drive = Watched(bus, can_id, kind, model)
        print_lines(
            [
                f"id {can_id} on {bus.bus.channel}: {drive.family}, without torque"
                + ("" if model else "; velocity and torque need --model")
            ]
        )
        totals = show(drive, f"actuator_{can_id}", options)
    return print_totals(totals, f"{totals.answers} replies to {totals.asked} queries")


def add_showing(parser: Parser) -> None:
    """Add the options of rate, duration and viewers."""
    add_number(parser, "--rate", "Hz", "HZ", "samples per second", default=100.0, maximum=RATE_LIMIT)
    add_number(parser, "--duration", "seconds", "S", "stop after S seconds (default: Ctrl-C)", maximum=TIME_LIMIT)
    add_options(
        parser,
        Request,
        *("record", "plotjuggler", "rerun"),
        record={"help": "write a CSV file to this folder"},
        rerun={"help": "show in Rerun's viewer; WHERE: see `run --help`"},
    )


def show(watched: Any, name: str, options: Namespace) -> StreamResult:
    """Stream to the viewers that the options name. Returns the counts.

    watched : as in runtime.setup.commissioning.streaming.stream
    name : name of the device in files
    """
    try:
        if options.record is not None:
            make_folder(options.record)
        folder = None if options.record is None else str(options.record)
        return stream(watched, name, options.rate, options.duration, folder, options.plotjuggler, options.rerun)
    except OSError as error:
        raise BadInput(f"{error.filename or 'stream'}: {error.strerror or error}") from None


def print_totals(totals: StreamResult, text: str) -> int:
    """Print the totals of a stream. Returns the exit code."""
    lost = f"; {totals.lost} datagrams were lost" if totals.lost else ""
    print_lines([f"{text}{lost}", *(f"written: {file}" for file in totals.files)])
    return OK if totals.answers else CHECK_FAILED


def _comma_separated(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(",")) if text else ()


def imu(arguments: Sequence[str]) -> int:
    """Run `stream imu`: sensors selected by the last digits of their serial numbers. Returns the exit code."""
    from runtime.setup.commissioning.imus import WatchedImus

    kinds = [kind for family in families() for kind in family.sensors]
    names = " and ".join(f"{kind.sensor}s" for kind in kinds)
    standard = ",".join(kinds[0].parameters["channels"].default)
    parser = Parser("stream imu", f"Configure {names} and show them live. Press Ctrl-C to end.")
    parser.add_argument(
        "serials",
        nargs="*",
        metavar="SERIAL",
        help="last digits of a serial number (default: every sensor that responds)",
    )
    parser.add_argument(
        "--channels", default=standard, metavar="NAME,...", help=f"channels to show (default: {standard})"
    )
    parser.add_argument(
        "--attitude",
        choices=("filter", "sensor"),
        default="filter",
        help="source of quaternion and euler: the estimation filter, or the complementary filter of the sensor "
        "(default: filter)",
    )
    parser.add_argument(
        "--sync",
        action="append",
        default=[],
        metavar="PIN",
        help="show level and edges of a GPIO input beside the samples: GPIO22 or /dev/gpiochip4:GPIO22; repeatable",
    )
    add_showing(parser)
    options = parser.parse_args(arguments)
    watched = WatchedImus(
        options.serials, _comma_separated(options.channels), options.rate, options.attitude, options.sync
    )
    try:
        print_lines([f"{interface.bus.channel}: {name}" for name, (interface, _) in watched.lines.lines.items()])
        totals = show(watched, "imu", options)
    finally:
        watched.close()
    print_lines(watched.summary())
    return print_totals(totals, f"{totals.answers} rows")


def node(kind: Node, arguments: Sequence[str]) -> int:
    """Run `stream NAME`: one sensor on a CAN bus, by its source address. Returns the exit code."""
    from runtime.setup.commissioning.watched_node import WatchedNode

    parser = Parser(
        f"stream {kind.name.lower()}",
        f"Configure one {kind.name} on CAN, until its next power-off, and show it live. Press Ctrl-C to end.",
    )
    parser.add_argument(
        "address",
        metavar="ADDRESS",
        type=number("ADDRESS", "", 247.0),
        help="source address, 128 as delivered; `scan` lists those that respond",
    )
    add_bus(parser)
    for option, (name, text) in kind.options.items():
        parameter = kind.block.parameters[name]
        if parameter.default is True:
            parser.add_argument(f"--{option}", dest=name, action="store_false", help=text)
        else:
            default = parameter.default
            text = f"{text} (default: {default})"
            parser.add_argument(f"--{option}", dest=name, choices=parameter.choices, default=default, help=text)
    add_showing(parser)
    options = parser.parse_args(arguments)
    if options.address != int(options.address) or options.address < 128:
        raise BadInput(f"ADDRESS: expected a whole number from 128 to 247, got {options.address:g}")
    parameters = {name: getattr(options, name) for name, _ in kind.options.values()}
    with open_bus(single_bus(options)) as bus:
        watched = WatchedNode(bus, kind, int(options.address), **parameters)
        print_lines(
            [f"{kind.name} {getattr(watched.block, 'model', '')} at address {options.address:g} on {bus.bus.channel}"]
        )
        totals = show(watched, watched.block.path, options)
    return print_totals(totals, f"{totals.answers} rows")


def i2c(arguments: Sequence[str]) -> int:
    """Run `stream i2c`: sensors on an I2C bus, by their addresses. Returns the exit code."""
    from runtime.setup.commissioning.watched_chips import WatchedChips, chip_names, place_of

    parser = Parser("stream i2c", f"Configure {', '.join(chip_names())} and show them live. Press Ctrl-C to end.")
    parser.add_argument(
        "places",
        nargs="*",
        metavar="ADDRESS",
        type=place_of,
        help="0x68, or behind a multiplexer 0x70.3:0x68 (default: scan all addresses for known chips)",
    )
    add_bus(parser)
    parser.add_argument(
        "--channels",
        default="",
        metavar="NAME,...",
        help="channels to show, such as accel,gyro,mag,a0,force (default: all)",
    )
    texts = {"help": "set a parameter of a block, such as accel_range=16; `blocks NAME` lists the parameters"}
    add_options(parser, Request, "settings", settings=texts)
    add_showing(parser)
    options = parser.parse_args(arguments)
    watched = WatchedChips(
        i2c_bus(options), options.places, _comma_separated(options.channels), options.rate, options.settings
    )
    try:
        print_lines([f"{watched.interface.bus.channel}: {fed.block.path}, {fed.block.kind}" for fed in watched.fed])
        totals = show(watched, "i2c", options)
        print_lines(watched.summary())
    finally:
        watched.close()
    return print_totals(totals, f"{totals.answers} rows")
