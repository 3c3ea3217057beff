"""`blocks [NAME]`: the blocks that are installed."""

from collections.abc import Sequence

from runtime.cli.parsing import Parser
from runtime.host.console.terminal import print_lines
from runtime.host.errors import OK
from runtime.robot.loading.catalog import catalog


def main(arguments: Sequence[str]) -> int:
    """Run the command. Returns the exit code; raises BadInput for an unknown block or library."""
    parser = Parser("blocks", "List the installed blocks, or describe one.")
    parser.add_argument(
        "name",
        nargs="?",
        metavar="NAME",
        help="a block, such as TorqueLimiter, or a family of blocks, such as limiters",
    )
    parser.add_argument(
        "--from", dest="library", metavar="LIBRARY", help="list the blocks of this library, with its version and author"
    )
    parser.add_argument(
        "--actuators",
        action="store_true",
        help="list the actuator models with their rated, peak and encoded torque ranges",
    )
    options = parser.parse_args(arguments)
    print_lines(catalog(options.name, options.library, options.actuators))
    return OK
