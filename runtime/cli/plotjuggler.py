"""`plotjuggler FILE`: write PlotJuggler's layout for a diagram; with --dummy, send test data."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from runtime.cli.parsing import Parser, add_options
from runtime.host import replaced_file
from runtime.host.console.terminal import print_lines, program
from runtime.host.ending import Interrupted, forget_interrupt
from runtime.host.errors import OK, BadInput
from runtime.host.options import host_and_port
from runtime.record.storage.files import create
from runtime.session.request import Request

DUMMY = [
    {"path": f"{side}/{signal}", "dtype": "float", "unit": unit}
    for side in ("left", "right")
    for signal, unit in (("knee.position", "rad"), ("knee.torque", "N·m"))
]
DUMMY_RATE = 200.0  # Hz of test data without a diagram
EPILOG = """\
examples:
  plotjuggler diagrams/knee_exo.py          write the layout knee_exo.xml
  plotjuggler diagrams/knee_exo.py --dummy  send its signals as sine waves
  plotjuggler --dummy 192.168.1.7:9870      send four sine waves
"""


def main(arguments: Sequence[str]) -> int:
    """Run the command. Returns the exit code."""
    parser = Parser("plotjuggler", "Write PlotJuggler's layout for a diagram, or send test data.", EPILOG)
    file, duration = {"nargs": "?"}, {"help": "with --dummy: stop after S seconds (default: Ctrl-C)"}
    add_options(parser, Request, "file", "rate", "settings", "duration", file=file, duration=duration)
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="layout file (default: the diagram's name with .xml)"
    )
    parser.add_argument(
        "--dummy", nargs="?", const="", metavar="HOST:PORT", help="send sine waves (default: to 127.0.0.1:9870)"
    )
    options = parser.parse_args(arguments)
    if options.file is None and options.dummy is None:
        raise BadInput(
            f"no diagram file given: pass one, such as diagrams/knee_exo.py, or --dummy ({program()} "
            "plotjuggler --help)"
        )
    if options.file is None:
        name, rate, signals, parameters = (
            "dummy",
            options.rate or DUMMY_RATE,
            DUMMY,
            {"host": "127.0.0.1", "port": 9870},
        )
    else:
        from runtime.record.recorder.plotjuggler_layout import columns

        name, rate, signals, block = columns(options.file, options.settings, options.rate)
        # the columns are selected already
        parameters = {name: getattr(block, name) for name in block.parameters} | {"signals": ""}
    if options.dummy is None:
        return write(name, signals, parameters, options.output)
    if options.dummy:
        parameters["host"], parameters["port"] = host_and_port(options.dummy)
    return stream(name, rate, signals, parameters, options.duration)


def write(name: str, signals: Sequence[dict[str, Any]], parameters: dict[str, Any], output: Path | None) -> int:
    """Write the layout file. Returns the exit code.

    name : name of the diagram, which names the file without -o
    signals : columns of the sink
    parameters : parameters of the PlotJuggler block
    output : file from -o, or None
    """
    from runtime.record.recorder.plotjuggler_layout import address, layout

    text = layout(name, signals, parameters["host"], parameters["port"])
    try:
        if output is None:
            path, descriptor = create(name, ".xml")
            os.close(descriptor)
            output = Path(path)
        replaced_file.write(output, text)
    except OSError as error:
        raise BadInput(f"cannot write {output or name + '.xml'}: {error.strerror}") from None
    print_lines(
        [
            f"{output}: {len(signals)} signals; in PlotJuggler: File, Load Layout; start the stream, address "
            f"{address(parameters['host'])}, port {parameters['port']}, "
            "protocol json, 'use field as timestamp': timestamp"
        ]
    )
    return OK


def stream(
    name: str, rate: float, signals: Sequence[dict[str, Any]], parameters: dict[str, Any], duration: float | None
) -> int:
    """Send sine waves, each signal at a frequency of its own."""
    from runtime.record.recorder.services.plotjuggler import PlotJugglerSender

    plan: Any = {"name": name, "rate": rate}  # the keys that this service reads
    sink: Any = {"path": "--dummy", "parameters": parameters, "columns": signals}
    sender = PlotJugglerSender(plan, sink)
    sender.say = lambda line: print_lines([line])
    try:
        sender.open()
    except OSError as error:
        raise BadInput(f"--dummy: {error.strerror}") from None
    print_lines([f"sending {len(signals)} waves to {parameters['host']} port {parameters['port']}, {rate:g} Hz"])
    began, tick = time.monotonic(), 0
    try:
        while duration is None or tick < duration * rate:
            time.sleep(max(0.0, began + tick / rate - time.monotonic()))
            at = tick / rate
            sender.row(tick, at, [wave(signal["dtype"], place, at) for place, signal in enumerate(signals)])
            tick += 1
    except Interrupted:
        forget_interrupt()
    report = sender.close()
    print_lines(
        [
            f"{report['datagrams']} datagrams sent, {report['lost']} lost"
            + (f" ({report['trouble']})" if report["trouble"] else "")
        ]
    )
    return OK


def wave(dtype: str, place: int, at: float) -> float:
    """Return the sample of a test signal. place : index of the signal; at : s"""
    value = math.sin(2.0 * math.pi * (0.2 + 0.1 * (place % 10)) * at)
    return value if dtype == "float" else float(value > 0.0) if dtype == "bool" else float(round(3.0 * value))
