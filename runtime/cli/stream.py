"""`stream actuator ID`: one drive live, without torque; `stream imu SERIAL...`, `stream i2c ADDRESS...` and `stream
NAME ADDRESS`, for the sensors on CAN of a device family: sensors.
"""

from blocks.families import example_models, families
from runtime.base.errors import CHECK_FAILED, OK, BadInput
from runtime.base.options import TIME_LIMIT, number
from runtime.cli.configure import drive_id
from runtime.cli.move import add_model, model_of
from runtime.cli.parsing import Parser, add_bus, add_options
from runtime.commissioning.bus import i2c_bus, opened, single_bus
from runtime.commissioning.streaming import Watched, stream
from runtime.console.terminal import tell
from runtime.recording.files import make_folder
from runtime.session.request import Request

FASTEST = 500.0  # Hz: Python asks and waits
EPILOG = """\
  stream actuator 3 --channel can0 --model {0} --plotjuggler 127.0.0.1:9870
  stream actuator 9 --rig lab.toml --bus legs --record recordings
  stream imu 133931 --channels accel,gyro --rate 500
  stream imu --rerun                    every sensor that answers, in Rerun's viewer
{1}  stream i2c 0x68 0x70.3:0x48 --channel /dev/i2c-1

Nothing is armed: the drive is asked with the frame that disables or stops it, and can be moved by hand. Ctrl-C ends it.
"""


def main(arguments):
    kinds = {"imu": imu, "i2c": i2c}
    nodes = {kind.name.lower(): kind for family in families() for kind in family.nodes}
    if arguments and arguments[0] in nodes:
        return node(nodes[arguments[0]], arguments[1:])
    if arguments and arguments[0] in kinds:
        return kinds[arguments[0]](arguments[1:])
    parser = Parser(
        "stream",
        "Show one drive live: position, velocity, torque and temperature, without torque.",
        EPILOG.format(
            example_models()[0], "".join(f"  stream {name} 128 --channel can1 --bitrate 250000\n" for name in nodes)
        ),
    )
    parser.add_argument(
        "kind", metavar="actuator", help="what is shown: actuator; `stream imu --help` tells of sensors"
    )
    parser.add_argument("can_id", metavar="ID", help="of the drive; `scan` tells who is there")
    add_bus(parser)
    add_model(parser, "as in {}; without it velocity and torque are not known")
    add_showing(parser)
    options = parser.parse_args(arguments)
    if options.kind != "actuator":
        raise BadInput(
            f"stream {options.kind}: expected stream actuator ID, or stream imu, {', '.join(nodes)} or i2c; what a "
            "whole robot measures is shown by a run"
        )
    can_id = drive_id(options.can_id)
    model = model_of(options)[1] if options.model else None
    with opened(single_bus(options)) as bus:
        drive = Watched(bus, can_id, model)
        tell(
            [
                f"id {can_id} on {bus.bus.channel}: {drive.family}, without torque"
                + ("" if model else "; velocity and torque need --model")
            ]
        )
        result = show(drive, f"actuator_{can_id}", options)
    return ended(result, f"{result.answers} answers to {result.asked} queries")


def add_showing(parser):
    """How often, for how long and where it is shown."""
    parser.add_argument(
        "--rate", type=number("--rate", "Hz", FASTEST), default=100.0, metavar="HZ", help="default: 100"
    )
    parser.add_argument(
        "--duration",
        type=number("--duration", "seconds", TIME_LIMIT),
        metavar="S",
        help="stop after S seconds (default: Ctrl-C)",
    )
    add_options(
        parser,
        Request,
        *("record", "plotjuggler", "rerun"),
        record={"help": "write a CSV file into this folder"},
        rerun={"help": "show them in Rerun's viewer; or WHERE, as of `run`"},
    )


def show(watched, name, options):
    """Stream as the options of `add_showing` select. Returns a StreamResult."""
    try:
        if options.record is not None:
            make_folder(options.record)
        folder = None if options.record is None else str(options.record)
        return stream(watched, name, options.rate, options.duration, folder, options.plotjuggler, options.rerun)
    except OSError as error:
        raise BadInput(f"{error.filename or 'stream'}: {error.strerror or error}") from None


def ended(result, what):
    """Print the counts and files of a stream. Returns the exit code."""
    lost = f"; {result.lost} datagrams were not sent" if result.lost else ""
    tell([f"{what}{lost}", *(f"written: {file}" for file in result.files)])
    return OK if result.answers else CHECK_FAILED


def comma_separated(text):
    return tuple(name.strip() for name in text.split(",")) if text else ()


def imu(arguments):
    """`stream imu`: sensors that are found by the last digits of their serial numbers."""
    from runtime.commissioning.imus import WatchedImus

    kinds = [kind for family in families() for kind in family.sensors]
    names = " and ".join(f"{kind.sensor}s" for kind in kinds)
    standard = ",".join(kinds[0].parameters["channels"].default)
    parser = Parser("stream imu", f"Show {names} live, each set up as asked. Ctrl-C ends it.")
    parser.add_argument(
        "serials",
        nargs="*",
        metavar="SERIAL",
        help="last digits of a serial number (default: every sensor that answers)",
    )
    parser.add_argument("--channels", default=standard, metavar="NAME,...", help=f"default: {standard}")
    parser.add_argument(
        "--attitude",
        choices=("filter", "sensor"),
        default="filter",
        help="what tells quaternion and euler (default: filter)",
    )
    add_showing(parser)
    options = parser.parse_args(arguments)
    watched = WatchedImus(options.serials, comma_separated(options.channels), options.rate, options.attitude)
    try:
        tell([f"{interface.bus.channel}: {name}" for name, (interface, _) in watched.lines.lines.items()])
        result = show(watched, "imu", options)
    finally:
        watched.close()
    tell(watched.summary())
    return ended(result, f"{result.answers} rows")


def node(kind, arguments):
    """`stream NAME`: one sensor on a CAN bus, by its source address. kind : graph.family.Node"""
    from runtime.commissioning.watched_node import WatchedNode

    parser = Parser(
        f"stream {kind.name.lower()}",
        f"Show one {kind.name} on CAN live, set up as a run would, until its power is gone. Ctrl-C ends it.",
    )
    parser.add_argument(
        "address",
        metavar="ADDRESS",
        type=number("ADDRESS", "", 247.0),
        help="its source address, 128 as it is sold; `scan` tells who is there",
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
    with opened(single_bus(options)) as bus:
        watched = WatchedNode(bus, kind, int(options.address), **parameters)
        tell([f"{kind.name} {getattr(watched.block, 'model', '')} at address {options.address:g} on {bus.bus.channel}"])
        result = show(watched, watched.block.path, options)
    return ended(result, f"{result.answers} rows")


def i2c(arguments):
    """`stream i2c`: sensors on an I2C bus, by their addresses."""
    from runtime.commissioning.watched_chips import WatchedChips, chip_names, place_of

    parser = Parser(
        "stream i2c", f"Show {', '.join(chip_names())} live, each recognised and set up as for a run. Ctrl-C ends it."
    )
    parser.add_argument(
        "places",
        nargs="*",
        metavar="ADDRESS",
        type=place_of,
        help="0x68, or behind a multiplexer 0x70.3:0x68 (default: every one that is known; that touches each address)",
    )
    add_bus(parser)
    parser.add_argument(
        "--channels",
        default="",
        metavar="NAME,...",
        help="as in accel,gyro,mag,a0,force (default: all that is measured)",
    )
    texts = {"help": "set a parameter of the blocks, as in accel_range=16 or capacity=200; `blocks NAME` lists them"}
    add_options(parser, Request, "settings", settings=texts)
    add_showing(parser)
    options = parser.parse_args(arguments)
    watched = WatchedChips(
        i2c_bus(options), options.places, comma_separated(options.channels), options.rate, options.settings
    )
    try:
        tell([f"{watched.interface.bus.channel}: {fed.block.path}, {fed.block.kind}" for fed in watched.fed])
        result = show(watched, "i2c", options)
        tell(watched.summary())
    finally:
        watched.close()
    return ended(result, f"{result.answers} rows")
