"""`profile FILE`: run a diagram and print where the time of a tick goes."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from runtime.cli import drawing
from runtime.cli.parsing import Parser, add_options, instance
from runtime.cli.run import carry_out, profile_lines
from runtime.host.console.terminal import print_lines
from runtime.record.report import summary
from runtime.record.report.profile import picture
from runtime.session.request import Request


def main(arguments: Sequence[str]) -> int:
    """Run the command. Returns the exit code of the run."""
    parser = Parser("profile", "Run a diagram in simulation and print the time of each block in a tick.")
    duration = {"default": 5.0, "help": "stop after S seconds (default: 5)"}
    add_options(parser, Request, "file", "rate", "settings", "duration", "fast", "overrun", "spin", duration=duration)
    parser.add_argument(
        "-o", "--output", type=Path, metavar="NAME", help="picture file (default: the diagram's name with _profile.png)"
    )
    options = parser.parse_args(arguments)
    drawing.check(options.output)
    result = carry_out(instance(Request, options, no_record=True, profile=True))
    print_lines(summary.summary(result))
    print_lines(profile_lines(result))
    if result.outcome.signal:  # end at once: drawing takes a second
        return summary.exit_code(result.outcome)
    output = options.output or Path(f"{options.file.stem}_profile.png")
    print_lines([f"picture: {drawing.write(partial(picture, result), output, '')}"])
    return summary.exit_code(result.outcome)
