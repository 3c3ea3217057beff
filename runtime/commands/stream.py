"""`stream actuator ID`: one drive live, without torque; `stream imu SERIAL...`: inertial sensors; `stream openimu ADDRESS`: one on CAN."""

import os

from runtime.commands.configure import drive_id
from runtime.commands.move import model_of
from runtime.commands.parsing import LONGEST, Parser, folder, host_and_port, number
from runtime.errors import CHECK_FAILED, OK, BadInput
from runtime.terminal import tell
from runtime.tools.bus import add_bus, opened, single_bus
from runtime.tools.streaming import Watched, stream

FASTEST = 500.0                 # Hz: Python asks and waits
EPILOG = """\
  stream actuator 3 --channel can0 --model AK80-9 --plotjuggler 127.0.0.1:9870
  stream actuator 9 --rig lab.toml --bus legs --record recordings
  stream imu 133931 --channels accel,gyro --rate 500
  stream openimu 128 --channel can1 --bitrate 250000

Nothing is armed: the drive is asked with the frame that disables or stops it, and can be moved by hand. Ctrl-C ends it.
"""


def main(arguments):
    if arguments[:1] == ["imu"]:
        return imu(arguments[1:])
    if arguments[:1] == ["openimu"]:
        return openimu(arguments[1:])
    parser = Parser("stream", "Show one drive live: position, velocity, torque and temperature, without torque.", EPILOG)
    parser.add_argument("kind", metavar="actuator", help="what is shown: actuator; `stream imu --help` tells of sensors")
    parser.add_argument("can_id", metavar="ID", help="of the drive; `scan` tells who is there")
    add_bus(parser)
    parser.add_argument("--model", metavar="NAME", help="as in AK80-9 or RS02; without it velocity and torque cannot be told")
    how = parser.add_mutually_exclusive_group()
    how.add_argument("--mit", action="store_true", help="a RobStride that is set to its MIT protocol")
    how.add_argument("--servo", action="store_true", help="a CubeMars in servo mode, which reports by itself")
    parser.add_argument("--rate", type=number("--rate", "Hz", FASTEST), default=100.0, metavar="HZ", help="default: 100")
    parser.add_argument("--duration", type=number("--duration", "seconds", LONGEST), metavar="S",
                        help="stop after S seconds (default: Ctrl-C)")
    parser.add_argument("--record", type=folder, metavar="DIR", help="write a CSV file into this folder")
    parser.add_argument("--plotjuggler", type=host_and_port, metavar="HOST:PORT", help="where PlotJuggler listens")
    options = parser.parse_args(arguments)
    if options.kind != "actuator":
        raise BadInput(f"stream {options.kind}: expected stream actuator ID, or stream imu SERIAL; what a whole robot measures is shown by a run")
    can_id = drive_id(options.can_id)
    model = model_of(options)[1] if options.model else None
    with opened(single_bus(options)) as bus:
        drive = Watched(bus, can_id, model)
        tell([f"id {can_id} on {bus.bus.channel}: {drive.family}, without torque" +
              ("" if model else "; velocity and torque need --model")])
        try:
            if options.record is not None:
                os.makedirs(options.record, exist_ok=True)
            told = stream(drive, f"actuator_{can_id}", options.rate, options.duration,
                          None if options.record is None else str(options.record), options.plotjuggler)
        except OSError as error:
            raise BadInput(f"{error.filename or 'stream'}: {error.strerror or error}") from None
    lost = f"; {told.lost} datagrams were not taken" if told.lost else ""
    tell([f"{told.answers} answers to {told.asked} questions{lost}", *(f"written: {file}" for file in told.files)])
    return OK if told.answers else CHECK_FAILED


def imu(arguments):
    """`stream imu`: sensors that are found by the last digits of their serial numbers."""
    from blocks.imus.microstrain.block import STANDARD
    from runtime.tools.imus import WatchedImus

    parser = Parser("stream imu", "Show MicroStrain sensors live, each set up as asked. Ctrl-C ends it.")
    parser.add_argument("serials", nargs="*", metavar="SERIAL", help="last digits of a serial number (default: every sensor that answers)")
    parser.add_argument("--channels", default=",".join(STANDARD), metavar="NAME,...", help=f"default: {','.join(STANDARD)}")
    parser.add_argument("--attitude", choices=("filter", "sensor"), default="filter", help="what tells quaternion and euler (default: filter)")
    parser.add_argument("--rate", type=number("--rate", "Hz", FASTEST), default=100.0, metavar="HZ", help="default: 100")
    parser.add_argument("--duration", type=number("--duration", "seconds", LONGEST), metavar="S",
                        help="stop after S seconds (default: Ctrl-C)")
    parser.add_argument("--record", type=folder, metavar="DIR", help="write a CSV file into this folder")
    parser.add_argument("--plotjuggler", type=host_and_port, metavar="HOST:PORT", help="where PlotJuggler listens")
    options = parser.parse_args(arguments)
    watched = WatchedImus(options.serials, tuple(name.strip() for name in options.channels.split(",")), options.rate, options.attitude)
    try:
        tell([f"{interface.bus.channel}: {name}" for name, (interface, _) in watched.lines.lines.items()])
        if options.record is not None:
            os.makedirs(options.record, exist_ok=True)
        told = stream(watched, "imu", options.rate, options.duration, None if options.record is None else str(options.record), options.plotjuggler)
    except OSError as error:
        raise BadInput(f"{error.filename or 'stream'}: {error.strerror or error}") from None
    finally:
        watched.close()
    lost = f"; {told.lost} datagrams were not taken" if told.lost else ""
    tell([*watched.summary(), f"{told.answers} rows{lost}", *(f"written: {file}" for file in told.files)])
    return OK if told.answers else CHECK_FAILED


def openimu(arguments):
    """`stream openimu`: one OpenIMU on a CAN bus, by its source address."""
    from runtime.tools.watched_openimu import WatchedOpenImu

    parser = Parser("stream openimu", "Show one OpenIMU on CAN live, set up as a run would, until its power is gone. Ctrl-C ends it.")
    parser.add_argument("address", metavar="ADDRESS", type=number("ADDRESS", "", 247.0),
                        help="its source address, 128 as it is sold; `scan` tells who is there")
    add_bus(parser)
    parser.add_argument("--model", choices=("300RI", "335RI"), default="300RI", help="default: 300RI")
    parser.add_argument("--axes", choices=("printed", "z up"), default="printed", help="frame of what is shown (default: printed)")
    parser.add_argument("--untold", action="store_true", help="set nothing, and read it in the axes in which it speaks")
    parser.add_argument("--rate", type=number("--rate", "Hz", FASTEST), default=100.0, metavar="HZ", help="default: 100")
    parser.add_argument("--duration", type=number("--duration", "seconds", LONGEST), metavar="S", help="stop after S seconds (default: Ctrl-C)")
    parser.add_argument("--record", type=folder, metavar="DIR", help="write a CSV file into this folder")
    parser.add_argument("--plotjuggler", type=host_and_port, metavar="HOST:PORT", help="where PlotJuggler listens")
    options = parser.parse_args(arguments)
    if options.address != int(options.address) or options.address < 128:
        raise BadInput(f"ADDRESS: expected a whole number from 128 to 247, got {options.address:g}")
    with opened(single_bus(options)) as bus:
        watched = WatchedOpenImu(bus, int(options.address), model=options.model, axes=options.axes, told=not options.untold)
        tell([f"OpenIMU {options.model} at address {options.address:g} on {bus.bus.channel}"])
        try:
            if options.record is not None:
                os.makedirs(options.record, exist_ok=True)
            told = stream(watched, watched.block.path, options.rate, options.duration, None if options.record is None else str(options.record),
                          options.plotjuggler)
        except OSError as error:
            raise BadInput(f"{error.filename or 'stream'}: {error.strerror or error}") from None
    lost = f"; {told.lost} datagrams were not taken" if told.lost else ""
    tell([f"{told.answers} rows{lost}", *(f"written: {file}" for file in told.files)])
    return OK if told.answers else CHECK_FAILED
