"""`analyse FILE --loop INPUT`: margins of a loop that is opened at an input, as a table and a picture."""

from collections.abc import Sequence
from pathlib import Path

from runtime.cli import drawing
from runtime.cli.parsing import Parser, add_options
from runtime.host.console.terminal import print_lines
from runtime.host.errors import CHECK_FAILED, OK
from runtime.session.loop import Loop
from runtime.session.request import Request


def main(arguments: Sequence[str]) -> int:
    """Run the command. Returns the exit code, CHECK_FAILED for an unstable loop; raises BadInput or DiagramError."""
    parser = Parser(
        "analyse",
        "Open a loop of a diagram at an input, linearise it, and print its margins. The diagram contains controller "
        "and plant, without devices. Needs python-control.",
    )
    add_options(parser, Request, "file", "settings")
    parser.add_argument("--loop", metavar="INPUT", required=True, help="input of a block, such as pendulum.torque")
    parser.add_argument(
        "--at", type=float, default=0.0, metavar="S", help="time in s of the run about which it is linearised"
    )
    parser.add_argument(
        "-o", "--output", type=Path, metavar="NAME", help="picture file (default: the diagram's name with _loop.png)"
    )
    options = parser.parse_args(arguments)
    drawing.check(options.output)
    loop = Loop(options.file, options.loop, options.at, options.settings)
    print_lines(loop.lines())
    output = options.output or Path(f"{options.file.stem}_loop.png")
    print_lines([f"picture: {drawing.write(loop.draw, output, '')}"])
    return OK if loop.margins["pole"] < 1.0 else CHECK_FAILED
