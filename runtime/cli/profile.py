"""`profile FILE`: run a diagram and tell where the time of a tick goes."""

from pathlib import Path

from runtime.cli.parsing import LONGEST, Parser, add_diagram, add_pace, number, settings
from runtime.cli.run import carried_out, profiled
from runtime.console.terminal import tell
from runtime.report import summary
from runtime.report.profile import picture
from runtime.session.run import Request


def main(arguments):
    parser = Parser("profile", "Run a diagram in simulation, and tell where the time of a tick goes, block by block.")
    add_diagram(parser)
    parser.add_argument(
        "--duration",
        type=number("--duration", "seconds", LONGEST),
        default=5.0,
        metavar="S",
        help="stop after S seconds (default: 5)",
    )
    parser.add_argument("--fast", action="store_true", help="virtual time: as fast as the machine can")
    parser.add_argument(
        "-o", "--output", type=Path, metavar="NAME", help="picture to write (default: the diagram's name, _profile.png)"
    )
    add_pace(parser)
    options = parser.parse_args(arguments)
    result = carried_out(
        Request(
            file=options.file,
            rate=options.rate,
            duration=options.duration,
            fast=options.fast,
            settings=settings(options.settings),
            no_record=True,
            overrun=options.overrun,
            spin=options.spin,
            profile=True,
        )
    )
    tell(summary.summary(result))
    tell(profiled(result))
    if result.outcome.signal:  # it ends the command, and a picture takes a second
        return summary.exit_code(result.outcome)
    tell([f"picture: {picture(result, options.output or Path(f'{options.file.stem}_profile.png'))}"])
    return summary.exit_code(result.outcome)
