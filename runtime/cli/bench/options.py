"""Options that the commands of `bench` share."""

from __future__ import annotations

from typing import TYPE_CHECKING

from runtime.cli.parsing import add_count, add_number

if TYPE_CHECKING:
    from runtime.cli.parsing import Parser


def add_options(
    parser: Parser,
    seconds: float | None = None,
    repeats: int | None = None,
    realtime: bool = False,
    seconds_limit: float = 60.0,
) -> None:
    """Add --json and optionally --seconds, --repeats and --realtime.

    seconds, repeats : default values, None to omit the option
    seconds_limit : largest value of --seconds
    """
    if seconds is not None:
        add_number(
            parser, "--seconds", "seconds", "S", "duration of each measurement", default=seconds, maximum=seconds_limit
        )
    if repeats is not None:
        add_count(parser, "--repeats", "alternating measurements of each row", default=repeats)
    if realtime:
        parser.add_argument(
            "--realtime",
            choices=("off", "try", "require"),
            default="off",
            help="real-time scheduling as in `run` (default: off)",
        )
    parser.add_argument("--json", action="store_true", help="print the results as JSON")
