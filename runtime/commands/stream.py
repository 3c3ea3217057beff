"""`stream actuator ID`: one drive live, without torque."""

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

Nothing is armed: the drive is asked with the frame that disables or stops it, and can be moved by hand. Ctrl-C ends it.
"""


def main(arguments):
    parser = Parser("stream", "Show one drive live: position, velocity, torque and temperature, without torque.", EPILOG)
    parser.add_argument("kind", metavar="actuator", help="what is shown: actuator")
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
        raise BadInput(f"stream {options.kind}: expected stream actuator ID; what a whole robot measures is shown by a run")
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
