"""`diff A B`: compare two recordings."""

from functools import partial
from pathlib import Path

from runtime.analysis import difference_picture
from runtime.analysis.compare import compare
from runtime.base.errors import CHECK_FAILED, OK
from runtime.base.optional_dependencies import need
from runtime.cli import drawing
from runtime.cli.parsing import Parser
from runtime.cli.reading import read
from runtime.console.progress import Progress
from runtime.console.terminal import tell


def main(arguments):
    parser = Parser("diff", "Compare two recordings, tick by tick.")
    parser.add_argument("first", type=Path, metavar="A", help="the .mcap file of a recording")
    parser.add_argument("second", type=Path, metavar="B", help="the .mcap file of another recording")
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="picture of the differences (default: diff.png)"
    )
    options = parser.parse_args(arguments)
    drawing.check(options.output)
    with Progress("comparing") as progress:
        here, there = read(options.first, progress, 0.0, 0.5), read(options.second, progress, 0.5, 0.9)
        comparison = compare(here, there)
    tell(difference_picture.table(here, there, comparison))
    if comparison.differences:
        need("matplotlib.figure", "a picture")
        draw = partial(difference_picture.draw, here=here, there=there, comparison=comparison)
        tell([f"  {drawing.write(draw, options.output, 'diff')}"])
    return OK if comparison.identical else CHECK_FAILED
