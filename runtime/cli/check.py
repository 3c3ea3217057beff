"""`check FILE`: compile a diagram and report on it."""

from collections.abc import Sequence

from runtime.cli.parsing import Parser, add_options
from runtime.host.console.terminal import print_lines
from runtime.host.errors import CHECK_FAILED, OK
from runtime.session.check.report import KEYS, check
from runtime.session.check.text import report_lines
from runtime.session.request import Request

RIG = "check the robot of this rig file, such as lab.toml: its buses, devices and joints"


def main(arguments: Sequence[str]) -> int:
    """Run the command. Returns the exit code: 1 if the diagram has an error."""
    parser = Parser("check", "Compile a diagram and report on it. The exit code is 1 if it has an error.", KEYS)
    add_options(parser, Request, "file", "rate", "settings", "rig", "subject", rig={"help": RIG})
    parser.add_argument("--json", action="store_true", help="print one JSON object with the keys below")
    options = parser.parse_args(arguments)
    report = check(options.file, options.settings, options.rate, options.rig, options.subject)
    print_lines(report_lines(report, options.json))
    return OK if report["ok"] else CHECK_FAILED
