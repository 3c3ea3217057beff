"""`service FILE --rig RIG --arm-on SIGNAL`: print a systemd unit that starts a robot with the computer."""

from collections.abc import Sequence

from runtime.cli.parsing import Parser, add_options, fields_of, instance
from runtime.host.console.terminal import print_lines, print_to_stderr, short_program
from runtime.host.errors import OK, BadInput
from runtime.robot.loading.file import compile_diagram, load
from runtime.robot.rig.acceptance import require_acceptance
from runtime.robot.rig.battery import require_supply
from runtime.robot.rig.file import read
from runtime.robot.rig.joints import require_ranges
from runtime.robot.rig.poses import Poses
from runtime.session.prepare import adapt, arming_slot
from runtime.session.request import Request
from runtime.session.service_unit import unit


def main(arguments: Sequence[str]) -> int:
    """Run the command. Returns the exit code; raises BadInput or DiagramError for a robot that could not run."""
    parser = Parser(
        "service",
        "Print a systemd unit that starts a robot when the computer boots, in this folder and with these options of "
        "`run`. The drives have zero torque until the operator has held a button for 1 s, even after a restart.",
    )
    add_options(parser, Request, *fields_of(Request), in_sections=True)
    request = instance(Request, parser.parse_args(arguments))
    request.check()
    if request.rig is None or request.arm_on is None:
        raise BadInput("a service needs --rig FILE and --arm-on SIGNAL, such as --arm-on button.on of a GpioInput")
    rig = read(request.rig)
    _, diagram = load(request.file, request.settings, rig)
    require_ranges(rig, diagram)
    require_supply(rig.battery, diagram, rig.path)
    adapt(diagram, request)
    schedule = compile_diagram(request.file, diagram)
    require_acceptance(rig.path, schedule.caveats, request.accept)
    Poses(diagram, schedule, request.poses)
    arming_slot(diagram, schedule, request.arm_on)
    channels = {str(bus.channel) for bus in rig.buses.values() if bus.interface == "socketcan"}
    print_lines(unit(diagram.name, channels, arguments).splitlines())
    print_to_stderr(
        [
            f"write it to /etc/systemd/system/{diagram.name}.service, then:",
            f"  sudo systemctl daemon-reload && sudo systemctl enable --now {diagram.name}",
            f"  journalctl -fu {diagram.name}     # the output of {short_program()} run",
        ]
    )
    return OK
