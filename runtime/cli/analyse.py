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
    """Run the command. Returns the exit code; raises BadInput or DiagramError.

    The code is CHECK_FAILED for a loop that is unstable or does not respond linearly.
    """
    parser = Parser(
        "analyse",
        "Open a loop of a diagram at an input, and print its margins: of the linearised diagram, or with drives, as "
        "measured in its simulation. Needs python-control.",
    )
    add_options(parser, Request, "file", "settings")
    parser.add_argument("--loop", metavar="INPUT", required=True, help="input of a block, such as pendulum.torque")
    parser.add_argument(
        "--at", type=float, default=0.0, metavar="S", help="time in s of the run at which it is linearised"
    )
    parser.add_argument(
        "--amplitude", type=float, metavar="A", help="largest value added to a command (default: a tenth of its limit)"
    )
    parser.add_argument(
        "--tune", metavar="GAINS", help="vary these parameters, such as pid.kp,pid.ki, for the least mean sensitivity"
    )
    parser.add_argument(
        "--distance", type=float, default=0.6, metavar="D", help="least |1 + L| of a tuned loop (default: 0.6)"
    )
    parser.add_argument(
        "--damping", type=float, default=0.4, metavar="Z", help="least damping ratio of a tuned loop (default: 0.4)"
    )
    parser.add_argument(
        "-o", "--output", type=Path, metavar="NAME", help="picture file (default: the diagram's name with _loop.png)"
    )
    options = parser.parse_args(arguments)
    drawing.check(options.output)
    if options.tune:
        from runtime.session.loop_tuning import tune

        names = [name.strip() for name in options.tune.split(",")]
        given = options.distance, options.at, options.settings, options.amplitude, options.damping
        loop, gains = tune(options.file, options.loop, names, *given)
        print_lines(["tuned: " + " ".join(f"--set {name}={value:g}" for name, value in gains.items())])
    else:
        loop = Loop(options.file, options.loop, options.at, options.settings, options.amplitude)
    print_lines(loop.lines())
    output = options.output or Path(f"{options.file.stem}_loop.png")
    print_lines([f"picture: {drawing.write(loop.draw, output, '')}"])
    return OK if loop.linear and loop.margins["pole"] < 1.0 else CHECK_FAILED
