"""`configure`: set up a drive on a bus, or find how a motor sits at its joint."""

from pathlib import Path

from blocks.families import families
from graph import Device
from graph.family import Request
from graph.names import suggestion
from runtime.base.errors import CHECK_FAILED, OK, BadInput
from runtime.cli.parsing import Parser, add_bus
from runtime.commissioning import rig_edit
from runtime.commissioning.bus import opened, single_bus
from runtime.commissioning.configure import apply, joint
from runtime.console.confirm import confirm
from runtime.console.terminal import complain, tell
from runtime.diagrams.file import compiled, load
from runtime.rig import read
from runtime.rig.file import parse
from runtime.rig.overrides import override

EPILOG = """\
  configure 127 --channel can0 --set-id 3                   a new drive gets its id
  configure 3 --channel can0 --zero --save                  here is zero, also after power off
  configure 3 --channel can0 --read all                     every parameter
  configure 3 --channel can0 --write limit_torque=10        one of them
  configure --joint left/knee --rig lab.toml knee.py        offset, sign and range of a joint, into lab.toml

The command stops the drive and asks for confirmation before it changes anything. It does not change a drive that runs.
Changes that are not saved are lost when the drive is switched off.
"""


def main(arguments):
    parser = Parser(
        "configure",
        "Set up a drive, or find how a motor sits at its joint.",
        "\n".join([EPILOG, *(family.configure_note for family in families() if family.configure_note), ""]),
    )
    parser.add_argument("what", nargs="?", metavar="ID", help="id of a drive; with --joint the diagram file")
    add_bus(parser)
    parser.add_argument("--set-id", type=drive_id, metavar="N", help="new id of the drive, 1 to 127, unused on the bus")
    parser.add_argument("--zero", action="store_true", help="its position is zero where it is")
    parser.add_argument("--protocol", metavar="NAME", help="private, mit or canopen, from its next power on")
    parser.add_argument("--read", nargs="+", default=[], metavar="NAME", help="parameters to tell; all for every one")
    parser.add_argument("--write", nargs="+", default=[], metavar="NAME=VALUE", help="parameters to change")
    parser.add_argument(
        "--save", action="store_true", help="keep what was set when the power goes, where the drive can"
    )
    parser.add_argument("--joint", metavar="PATH", help="block of an actuator in the diagram, as in left/knee")
    parser.add_argument("--yes", action="store_true", help="change without asking, for scripts")
    options = parser.parse_args(arguments)
    return configure_joint(options) if options.joint else drive(options)


def drive(options):
    if options.what is None:
        raise BadInput(
            "which drive? name its id, as in configure 127 --channel can0 --set-id 3; `scan` tells the ids of a bus"
        )
    can_id = drive_id(options.what)
    request = Request(
        can_id, tuple(options.read), tuple(options.write), options.zero, options.protocol, options.set_id, options.save
    )
    if request.new_id == can_id:
        raise BadInput(f"--set-id {can_id}: that is its id already")
    if not request.other_than():
        raise BadInput(
            "what shall be done? --read, --write, --set-id, --zero, --protocol or --save (--help tells of them)"
        )
    apply.check(request)
    with opened(single_bus(options)) as bus:
        return OK if apply.carry_out(bus, request, options.yes) else CHECK_FAILED


def configure_joint(options):
    if options.what is None or options.rig is None:
        raise BadInput("--joint needs the rig and the diagram: configure --joint left/knee --rig lab.toml knee.py")
    if options.set_id or options.zero or options.protocol or options.read or options.write or options.save:
        raise BadInput("--joint writes the rig file alone: leave out what sets up a drive")
    rig = read(options.rig)
    file, diagram = load(Path(options.what), (), rig)
    compiled(Path(options.what), diagram)
    block = diagram.blocks.get(options.joint)
    devices = {block.path: block for block in diagram if isinstance(block, Device)}
    if block is None or not isinstance(block, Device):
        hint = suggestion(options.joint, devices) or f"its devices are {', '.join(sorted(devices)) or 'none'}"
        raise BadInput(f"--joint {options.joint}: {diagram.name} has no such device; {hint}")
    with opened(rig.buses[block.bus]) as bus:
        found = joint.find(joint.Motor(bus, block))
    before = rig.devices.get(block.path, {})
    text = rig_edit.changed(options.rig, rig.text, block.path, found)
    _, again = load(Path(options.what), ())
    override(parse(options.rig, text), again)
    compiled(Path(options.what), again)  # what it would break is told before it is written
    tell([f'[device."{block.path}"] of {options.rig}:'])
    tell([f"  {name}: {before.get(name, 'not set')} -> {value}" for name, value in found.items()])
    if not confirm(f"write that into {options.rig}", options.yes):
        complain(["nothing was written"])
        return OK
    rig_edit.write(options.rig, rig.text, text)
    tell([f"written: {options.rig}"])
    return OK


def drive_id(text):
    if not text.isdecimal() or not 1 <= int(text) <= 127:
        program = next((family.vendor_program for family in families() if family.recognises(text)), "")
        if program:
            raise BadInput(f"{text}: {program}")
        raise BadInput(f"{text}: expected an id from 1 to 127; `scan` tells the ids of a bus")
    return int(text)
