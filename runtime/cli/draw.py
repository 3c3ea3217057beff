"""`draw FILE`: draw a diagram as SVG, PNG, Mermaid or an HTML page, or its robot as URDF."""

from collections.abc import Sequence

from runtime.cli.parsing import Parser, add_options
from runtime.host.console.terminal import print_lines, print_to_stderr
from runtime.host.errors import OK
from runtime.robot.loading.draw import FORMATS, draw_file
from runtime.session.request import Request


def main(arguments: Sequence[str]) -> int:
    """Run the command. Returns the exit code; raises BadInput if the drawing cannot be made."""
    parser = Parser("draw", "Draw a diagram from left to right. Lines of loops without an actuator are dashed.")
    add_options(parser, Request, "file", "rate", "settings")
    parser.add_argument(
        "-o", "--output", metavar="NAME", help="output file, or - for standard output (default: the diagram's name)"
    )
    parser.add_argument(
        "--format",
        choices=list(FORMATS),
        help="svg: for papers; png; mermaid: for Markdown; html: an interactive page; urdf: the robot itself, for RViz "
        "and simulators (default: by the ending of NAME, or svg)",
    )
    parser.add_argument("--all-ports", action="store_true", help="also show unconnected ports")
    parser.add_argument("--whole", action="store_true", help="show the blocks of both sides of a symmetric robot")
    options = parser.parse_args(arguments)
    lines, remarks = draw_file(
        options.file, options.settings, options.rate, options.output, options.format, options.all_ports, options.whole
    )
    print_to_stderr(remarks)
    print_lines(lines)
    return OK
