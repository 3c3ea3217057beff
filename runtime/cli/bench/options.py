"""Options that the commands of `bench` share."""

from runtime.base.options import count, number


def add_options(parser, seconds=None, repeats=None, realtime=False, seconds_limit=60.0):
    """Add --json, and those of --seconds, --repeats and --realtime that a command has.

    seconds, repeats : their defaults, None where the command has no such option
    seconds_limit : largest value of --seconds
    """
    if seconds is not None:
        parser.add_argument(
            "--seconds",
            type=number("--seconds", "seconds", seconds_limit),
            default=seconds,
            metavar="S",
            help=f"duration of each measurement (default {seconds:g})",
        )
    if repeats is not None:
        parser.add_argument(
            "--repeats",
            type=count("--repeats"),
            default=repeats,
            metavar="N",
            help=f"measurements of each row, taken in turn (default {repeats})",
        )
    if realtime:
        parser.add_argument(
            "--realtime", choices=("off", "try", "require"), default="off", help="the same as for `run` (default: off)"
        )
    parser.add_argument("--json", action="store_true", help="print the results as JSON")
