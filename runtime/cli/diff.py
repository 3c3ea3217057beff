"""`diff A B`: compare two recordings."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from runtime.cli import drawing, selection
from runtime.cli.parsing import Parser
from runtime.cli.reading import read
from runtime.host.console.progress import Progress
from runtime.host.console.terminal import print_lines
from runtime.host.errors import CHECK_FAILED, OK, BadInput
from runtime.host.optional_dependencies import need
from runtime.record.analysis import condition_table, difference_picture, pictures
from runtime.record.analysis.compare import compare
from runtime.record.storage.parts import newest

if TYPE_CHECKING:
    from argparse import Namespace

    from runtime.record.analysis.trial import Trial

EPILOG = """\
examples:
  diff run.mcap replay.mcap
  diff without.mcap assisted.mcap --strides --last 20
  diff a.mcap a.mcap --strides --between start "mark 1" --between "mark 1" end
"""


def main(arguments: Sequence[str]) -> int:
    """Run the command. Returns the exit code: 1 if the recordings differ tick by tick.

    Raises BadInput if one cannot be read, or if their ticks are at different times.
    """
    parser = Parser("diff", "Compare two recordings: tick by tick, or with --strides over the gait cycle.", EPILOG)
    parser.add_argument(
        "first", type=newest, metavar="A", help="the .mcap file of a recording, or a folder: its newest"
    )
    parser.add_argument("second", type=newest, metavar="B", help="another, for example of another folder")
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="picture of the differences (default: diff.png)"
    )
    parser.add_argument(
        "--strides",
        action="store_true",
        help="compare two conditions over the gait cycle, the clearest difference first",
    )
    selection.add(parser)
    options = parser.parse_args(arguments)
    selection.check(options, options.strides)
    drawing.check(options.output)
    with Progress("comparing") as progress:
        here, there = read(options.first, progress, 0.0, 0.5), read(options.second, progress, 0.5, 0.9)
        if options.strides:
            return compare_strides(here, there, options)
        rates = [trial.about["rate"] for trial in (here, there)]
        if rates[0] != rates[1]:
            raise BadInput(
                f"{here.path} was recorded at {rates[0]:g} Hz and {there.path} at {rates[1]:g} Hz, so that their ticks "
                "are at different times: compare them over the gait cycle, with --strides"
            )
        comparison = compare(here, there)
    print_lines(difference_picture.table(here, there, comparison))
    if difference_picture.rank(comparison):
        need("matplotlib.figure", "a picture")
        draw = partial(difference_picture.draw, here=here, there=there, comparison=comparison)
        print_lines([f"  {drawing.write(draw, options.output, 'diff')}"])
    return OK if comparison.identical else CHECK_FAILED


def compare_strides(here: Trial, there: Trial, options: Namespace) -> int:
    """Print the table of two conditions and draw them. Returns OK. Raises BadInput."""
    compared = selection.conditions_of([here] if here.path == there.path else [here, there], options)
    if len(compared) != 2:
        raise BadInput(
            f"diff --strides compares 2 conditions, not {len(compared)}: pass two recordings, or one recording twice "
            "with two --between"
        )
    first, second = compared
    print_lines(condition_table.table(first, second, condition_table.compare(first, second)))
    print_lines(["", drawing.write(pictures.over_strides(compared)["strides"], options.output, "diff")])
    return OK
