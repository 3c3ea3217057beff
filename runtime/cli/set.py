"""`set PID PATH=VALUE ...`: change live parameters of a run that goes on."""

from runtime.base.errors import OK, BadInput
from runtime.cli.parsing import Parser, settings
from runtime.cli.set_parameters import set_live
from runtime.console.terminal import program, tell


def main(arguments):
    parser = Parser(
        "set", "Change live parameters of a run that goes on, or list them. The exit code is 0 once the run has them."
    )
    parser.add_argument("pid", metavar="PID", help="process number of the run")
    parser.add_argument(
        "settings",
        nargs="*",
        metavar="PATH=VALUE",
        help="a live parameter: left/impedance.stiffness=40, wall.angle='60 deg', "
        "'*/profile.scale=0.5' for both legs; @FILE reads such lines",
    )
    options = parser.parse_args(arguments)
    if not options.pid.isdecimal():
        raise BadInput(
            f"set {options.pid}: expected the process number of a run, as in {program()} set 1234 "
            "left/impedance.stiffness=40"
        )
    tell(set_live(int(options.pid), settings(options.settings, "")))
    return OK
