"""`check FILE`: compile a diagram and tell what was found."""

from runtime.base.errors import CHECK_FAILED, OK
from runtime.cli.parsing import Parser, add_diagram, add_rig, settings
from runtime.console.terminal import tell
from runtime.session.check import KEYS, check, told


def main(arguments):
    parser = Parser(
        "check", "Compile a diagram and tell what was found. The exit code is 1 where something is wrong.", KEYS
    )
    add_diagram(parser)
    add_rig(parser)
    parser.add_argument("--json", action="store_true", help="for machines: one JSON object with the keys below")
    options = parser.parse_args(arguments)
    found = check(options.file, settings(options.settings), options.rate, options.rig)
    tell(told(found, options.json))
    return OK if found["ok"] else CHECK_FAILED
