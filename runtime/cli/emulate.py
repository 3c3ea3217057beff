"""`python -m runtime emulate FILE --rig RIG`: the other side of a rig, in a terminal of its own."""

import sys
from pathlib import Path

from runtime.base.errors import FAULT, OK, BadInput
from runtime.cli.parsing import Parser, add_options
from runtime.console.terminal import complain, program, tell
from runtime.session.request import Request

SIDE_BY_SIDE = "a drive that is really there would take such an answer for a command, and move"


def main(arguments):
    """Returns the exit code: 0 too after Ctrl-C, which is how it is meant to end."""
    options = parse(arguments)
    from runtime.diagrams.file import load
    from runtime.diagrams.simulation import plant_of
    from runtime.emulation.buses import PlantBuses
    from runtime.emulation.lines import PtyLines, on_terminals
    from runtime.emulation.serving import Service
    from runtime.rig import read

    rig = read(options.rig)
    file, robot = load(options.file, options.settings, rig)
    diagram, schedule, _ = plant_of(file, robot)
    if schedule is None or not schedule.buses:
        raise BadInput(f"{options.file}: {robot.name} has nothing on a bus that could be emulated")
    terminals = on_terminals(robot, schedule)
    stranger = next((name for name in schedule.buses if name not in rig.buses and name not in terminals), None)
    if stranger is not None:
        raise BadInput(
            f"{options.rig}: the plant emulates a device on bus {stranger!r}, and the rig has no [bus.{stranger}]"
        )
    buses = PlantBuses(rig, [name for name in schedule.buses if name not in terminals])
    lines = PtyLines(terminals, options.lines)
    try:
        complain(buses.remarks)
        consent(buses.real, options.yes)
        tell(introduction(options, diagram, schedule, rig, file.has_plant, lines))
        ends = dict(zip(buses.names, buses.ends())) | {name: lines.end(name) for name in terminals}
        service = Service(schedule, [ends[name] for name in schedule.buses], options.bitrate)
        outcome = service.run(options.duration)
        if outcome.faulted:
            complain(fault(outcome, buses))
        tell(summary(service.statistics, schedule))
        return FAULT if outcome.faulted else OK
    finally:
        lines.close()
        buses.close()


def parse(arguments):
    parser = Parser(
        "emulate",
        "Play the plant of a diagram on the real buses of a rig, for a robot that another terminal runs there.",
    )
    add_options(
        parser,
        Request,
        "file",
        "rig",
        "settings",
        "duration",
        "bitrate",
        "yes",
        file={"help": "the robot's diagram file; its plant(), or every device emulated"},
        rig={"required": True, "help": "the rig file that the robot runs with"},
        bitrate={"help": "delay each reply by the time of its bits at N bit/s (default: reply at once)"},
        yes={"help": "on real CAN: do not ask whether every real drive is disconnected"},
    )
    parser.add_argument(
        "--lines",
        type=Path,
        metavar="DIR",
        help="an existing folder for links to the terminals of sensors on serial lines",
    )
    return parser.parse_args(arguments)


def consent(real, given):
    """On a bus that is not this machine's alone somebody says that no real drive is there. BadInput"""
    if not real or given:
        return
    if not (sys.stdin is not None and sys.stdin.isatty()):
        raise BadInput(f"{', '.join(real)}: real drives may be there, and {SIDE_BY_SIDE}; where none is, say --yes")
    complain(
        [
            f"{', '.join(real)}: take every real drive off first: {SIDE_BY_SIDE}",
            "Enter: there is none; Ctrl-C ends this",
        ]
    )
    if sys.stdin.readline() == "":
        raise BadInput("nobody has said that no real drive is there")


def introduction(options, diagram, schedule, rig, given, serial):
    kind = "the plant of the file" if given else "every device, each actuator on a free inertia"
    lines = [f"{schedule.name}: {kind}, at {schedule.rate:g} Hz"]
    for index, name in enumerate(schedule.buses):
        here = [diagram[device.name] for device in schedule.devices if device.bus == index]
        lines.append(
            f"  {name:<12}terminal {serial.paths[name]}"
            if name in serial.paths
            else f"  {name:<12}{rig.buses[name].interface} {rig.buses[name].channel}"
        )
        lines += [f"    {title(block)}" for block in here]
    found = f"TICKWORK_PORTS={':'.join(serial.paths.values())} " if serial.paths else ""
    return [*lines, f"in another terminal: {found}{program()} {options.file} --rig {options.rig}", "Ctrl-C ends it"]


def title(block):
    ids = ", ".join(f"{identifier:X}h" if extended else str(identifier) for identifier, extended in block.addresses())
    words = [block.path, getattr(block, "model", ""), f"id {ids}" if ids else ""]
    return "  ".join(filter(None, words))


def fault(outcome, buses):
    where = outcome.culprit or ", ".join(buses.names)
    why = buses.explain(where) if where in buses.cans else str(outcome.error or "")
    return [f"tickwork: the emulation ended: {outcome.status} at {where}" + (f": {why}" if why else "")]


def summary(statistics, schedule):
    frames, seconds = statistics["frames"], (statistics["last_tick"] + 1) / schedule.rate
    return [
        f"{schedule.name}: {seconds:.1f} s at {schedule.rate:g} Hz, {statistics['missed']} steps missed",
        f"  buses       {frames['received']} frames heard, {frames['sent']} sent",
    ]
