"""`configure`: set up a drive on a bus, or find the offset, sign and range of a joint."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from blocks.families import families
from graph import Device
from graph.family import Request
from runtime.cli.parsing import Parser, add_bus
from runtime.host.console.confirm import confirm
from runtime.host.console.terminal import print_lines, print_to_stderr
from runtime.host.errors import CHECK_FAILED, OK, BadInput
from runtime.host.suggestions import suggestion
from runtime.robot.loading.file import compile_diagram, load
from runtime.robot.rig.file import parse, read
from runtime.robot.rig.overrides import override
from runtime.setup.commissioning import rig_edit
from runtime.setup.commissioning.bus import open_bus, plain, single_bus
from runtime.setup.commissioning.configure import apply, joint

if TYPE_CHECKING:
    from argparse import Namespace

EPILOG = """\
examples:
  configure 127 --channel can0 --set-id 3      set the id of a new drive
  configure 3 --channel can0 --zero --save     zero at the present position
  configure 3 --channel can0 --read all        read every parameter
  configure 3 --channel can0 --write limit_torque=10
                                               write one parameter
  configure --joint left/knee --rig lab.toml knee.py
                                               measure offset, sign and range

The command stops the drive and asks for confirmation before it changes anything. It does not change a running drive.
Changes that are not saved are lost when the drive is switched off.
"""


def main(arguments: Sequence[str]) -> int:
    """Run the command. Returns the exit code: 1 if the drive did not confirm a change."""
    parser = Parser(
        "configure",
        "Set up a drive, or find the offset, sign and range of a joint.",
        "\n".join([EPILOG, *(family.configure_note for family in families() if family.configure_note), ""]),
    )
    parser.add_argument("what", nargs="?", metavar="ID", help="CAN id of the drive; with --joint the diagram file")
    add_bus(parser)
    parser.add_argument("--set-id", type=drive_id, metavar="N", help="new id of the drive, 1 to 127, unused on the bus")
    parser.add_argument("--zero", action="store_true", help="set the zero of the drive to its present position")
    parser.add_argument(
        "--protocol", metavar="NAME", help="set the protocol from the next power-on: private, mit or canopen"
    )
    parser.add_argument("--read", nargs="+", default=[], metavar="NAME", help="print parameters; all: every parameter")
    parser.add_argument("--write", nargs="+", default=[], metavar="NAME=VALUE", help="change parameters")
    parser.add_argument(
        "--save", action="store_true", help="save the changes in the drive's non-volatile memory, if it has one"
    )
    parser.add_argument(
        "--joint", metavar="PATH", help="find the mounting of this actuator of the diagram, such as left/knee"
    )
    parser.add_argument("--yes", action="store_true", help="do not ask for confirmation")
    options = parser.parse_args(arguments)
    return configure_joint(options) if options.joint else drive(options)


def drive(options: Namespace) -> int:
    """Set up a drive. Returns the exit code."""
    if options.what is None:
        raise BadInput(
            "no drive given: pass its id, as in configure 127 --channel can0 --set-id 3; `scan` lists the ids of a bus"
        )
    can_id = drive_id(options.what)
    request = Request(
        can_id, tuple(options.read), tuple(options.write), options.zero, options.protocol, options.set_id, options.save
    )
    if request.new_id == can_id:
        raise BadInput(f"--set-id {can_id}: the drive already has this id")
    if not request.other_than():
        raise BadInput("nothing to do: pass --read, --write, --set-id, --zero, --protocol or --save (see --help)")
    apply.check(request)
    with open_bus(single_bus(options)) as bus:
        return OK if apply.carry_out(bus, request, options.yes) else CHECK_FAILED


def configure_joint(options: Namespace) -> int:
    """Find the mounting of a joint and write it to the rig file. Returns the exit code."""
    if options.what is None or options.rig is None:
        raise BadInput("--joint needs the rig and the diagram: configure --joint left/knee --rig lab.toml knee.py")
    if options.set_id or options.zero or options.protocol or options.read or options.write or options.save:
        raise BadInput("--joint only writes the rig file: omit the options that set up a drive")
    rig = read(options.rig)
    file, diagram = load(Path(options.what), (), rig)
    compile_diagram(Path(options.what), diagram)
    block = diagram.blocks.get(options.joint)
    devices = {block.path: block for block in diagram if isinstance(block, Device)}
    if block is None or not isinstance(block, Device):
        hint = suggestion(options.joint, devices) or f"its devices are {', '.join(sorted(devices)) or 'none'}"
        raise BadInput(f"--joint {options.joint}: {diagram.name} has no such device; {hint}")
    with open_bus(rig.buses[block.bus]) as bus:
        mounting = joint.find(joint.Motor(bus, block))
    before = rig.devices.get(block.path, {})
    text = rig_edit.change_device(options.rig, rig.text, block.path, mounting)
    _, again = load(Path(options.what), ())
    override(parse(options.rig, text), again)
    compile_diagram(Path(options.what), again)  # errors are reported before the file is written
    print_lines([f'[device."{block.path}"] of {options.rig}:'])
    print_lines(
        [
            f"  {name}: {plain(before[name]) if name in before else 'not set'} -> {plain(value)}"
            for name, value in mounting.items()
        ]
    )
    if not confirm(f"write this to {options.rig}", options.yes):
        print_to_stderr(["nothing was written"])
        return OK
    rig_edit.write(options.rig, rig.text, text)
    print_lines([f"written: {options.rig}"])
    return OK


def drive_id(text: str) -> int:
    """Convert the text of a CAN id. Raises BadInput."""
    if not text.isdecimal() or not 1 <= int(text) <= 127:
        program = next((family.vendor_program for family in families() if family.recognises(text)), "")
        if program:
            raise BadInput(f"{text}: {program}")
        raise BadInput(f"{text}: expected an id from 1 to 127; `scan` lists the ids of a bus")
    return int(text)
