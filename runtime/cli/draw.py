"""`draw FILE`: a diagram as SVG, PNG, Mermaid, or a page to explore."""

from runtime.base.errors import OK
from runtime.cli.parsing import Parser, add_options
from runtime.console.terminal import complain, tell
from runtime.diagrams.draw import FORMATS, draw_file
from runtime.session.request import Request


def main(arguments):
    parser = Parser("draw", "Draw a diagram, from left to right; feedback goes back below, dashed.")
    add_options(parser, Request, "file", "rate", "settings")
    parser.add_argument(
        "-o", "--output", metavar="NAME", help="file to write, - for standard output (default: the diagram's name)"
    )
    parser.add_argument(
        "--format",
        choices=list(FORMATS),
        help="svg, for papers; png; mermaid, for Markdown; html, a page to explore (default: what "
        "NAME ends in, or svg)",
    )
    parser.add_argument("--all-ports", action="store_true", help="show the ports that nothing is wired to as well")
    options = parser.parse_args(arguments)
    said, remarks = draw_file(
        options.file, options.settings, options.rate, options.output, options.format, options.all_ports
    )
    complain(remarks)
    tell(said)
    return OK
