"""`plotjuggler FILE`: PlotJuggler's layout for a diagram; with --dummy, a stream to try the set-up with."""

import math
import time
from pathlib import Path

from runtime.base.ending import Interrupted, handled
from runtime.base.errors import OK, BadInput
from runtime.base.options import host_and_port
from runtime.cli.parsing import Parser, add_options
from runtime.console.terminal import program, tell
from runtime.recording.files import create
from runtime.session.request import Request

DUMMY = [
    {"path": f"{side}/{signal}", "dtype": "float", "unit": unit}
    for side in ("left", "right")
    for signal, unit in (("knee.position", "rad"), ("knee.torque", "N·m"))
]
RATE = 200.0  # Hz of a stream without a diagram
EPILOG = """\
  plotjuggler diagrams/knee_exo.py                      writes knee_exo.xml: in PlotJuggler, File, Load Layout
  plotjuggler diagrams/knee_exo.py --dummy              sends waves named as its signals to 127.0.0.1, port 9870
  plotjuggler --dummy 192.168.1.7:9870                  sends four waves there
"""


def main(arguments):
    parser = Parser(
        "plotjuggler", "Make PlotJuggler's layout for a diagram, or send it a stream to try the set-up with.", EPILOG
    )
    file, duration = {"nargs": "?"}, {"help": "of the waves (default: Ctrl-C)"}
    add_options(parser, Request, "file", "rate", "settings", "duration", file=file, duration=duration)
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="of the layout (default: the diagram's name and .xml)"
    )
    parser.add_argument(
        "--dummy", nargs="?", const="", metavar="HOST:PORT", help="send waves until Ctrl-C (default: to 127.0.0.1:9870)"
    )
    options = parser.parse_args(arguments)
    if options.file is None and options.dummy is None:
        raise BadInput(
            f"which file? name a diagram file, such as diagrams/knee_exo.py, or say --dummy ({program()} "
            "plotjuggler --help)"
        )
    if options.file is None:
        name, rate, signals, parameters = "dummy", options.rate or RATE, DUMMY, {"host": "127.0.0.1", "port": 9870}
    else:
        from runtime.recorder.plotjuggler_layout import columns

        name, rate, signals, block = columns(options.file, options.settings, options.rate)
        # they are chosen already
        parameters = {name: getattr(block, name) for name in block.parameters} | {"signals": ""}
    if options.dummy is None:
        return write(name, signals, parameters, options.output)
    if options.dummy:
        parameters["host"], parameters["port"] = host_and_port(options.dummy)
    return stream(name, rate, signals, parameters, options.duration)


def write(name, signals, parameters, output):
    from runtime.recorder.plotjuggler_layout import address, layout

    text = layout(name, signals, parameters["host"], parameters["port"])
    try:
        if output is None:
            output, descriptor = create(name, ".xml")
            with open(descriptor, "w", encoding="utf-8") as file:
                file.write(text)
        else:
            output.write_text(text, encoding="utf-8")
    except OSError as error:
        raise BadInput(f"cannot write {output or name + '.xml'}: {error.strerror}") from None
    tell(
        [
            f"{output}: {len(signals)} signals; in PlotJuggler: File, Load Layout; start the stream, address "
            f"{address(parameters['host'])}, port {parameters['port']}, "
            "protocol json, 'use field as timestamp': timestamp"
        ]
    )
    return OK


def stream(name, rate, signals, parameters, duration):
    """Waves: each signal its own frequency, so that one can tell them apart."""
    from runtime.recorder.plotjuggler import PlotJugglerSender

    sender = PlotJugglerSender(
        {"name": name, "rate": rate}, {"path": "--dummy", "parameters": parameters, "columns": signals}
    )
    sender.say = lambda line: tell([line])
    try:
        sender.open()
    except OSError as error:
        raise BadInput(f"--dummy: {error.strerror}") from None
    tell([f"sending {len(signals)} waves to {parameters['host']} port {parameters['port']}, {rate:g} Hz"])
    began, tick = time.monotonic(), 0
    try:
        while duration is None or tick < duration * rate:
            time.sleep(max(0.0, began + tick / rate - time.monotonic()))
            at = tick / rate
            sender.row(tick, at, [wave(signal["dtype"], place, at) for place, signal in enumerate(signals)])
            tick += 1
    except Interrupted:
        handled()
    told = sender.close()
    tell(
        [
            f"{told['datagrams']} datagrams sent, {told['lost']} not taken"
            + (f" ({told['trouble']})" if told["trouble"] else "")
        ]
    )
    return OK


def wave(dtype, place, at):
    value = math.sin(2.0 * math.pi * (0.2 + 0.1 * (place % 10)) * at)
    return value if dtype == "float" else float(value > 0.0) if dtype == "bool" else float(round(3.0 * value))
