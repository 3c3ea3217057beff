"""`emulate FILE --rig RIG`: emulate the devices of a diagram on the buses of a rig."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from runtime.cli.parsing import Parser, add_options
from runtime.host.console.confirm import discard_typed
from runtime.host.console.terminal import print_lines, print_to_stderr, program
from runtime.host.errors import BadInput
from runtime.session.request import Request

if TYPE_CHECKING:
    from argparse import Namespace

    from blocks.chips import ChipDevice
    from cext.schedule.outcome import Outcome
    from graph import Diagram, Schedule
    from runtime.robot.emulation.buses import PlantBuses
    from runtime.robot.emulation.lines import EmulatedLines
    from runtime.robot.rig.file import RigFile

DANGER = "a real drive would interpret emulated replies as commands, and move"


def main(arguments: Sequence[str]) -> int:
    """Run the command. Returns the exit code, for a signal that of `run`."""
    options = parse(arguments)
    from graph import StreamDevice
    from runtime.record.report.summary import exit_code, stop_reason
    from runtime.robot.emulation.buses import PlantBuses
    from runtime.robot.emulation.gpio_server import GpioServer
    from runtime.robot.emulation.lines import GPIO, NETWORK, TERMINALS, EmulatedLines, lines_of
    from runtime.robot.emulation.network_senders import NetworkSender
    from runtime.robot.emulation.serving import Service
    from runtime.robot.loading.file import load
    from runtime.robot.loading.simulation import plant_of
    from runtime.robot.rig.file import read

    if options.lines is not None:
        try:
            options.lines.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise BadInput(f"--lines {options.lines}: cannot create the folder: {error.strerror}") from None
    rig = read(options.rig)
    file, robot = load(options.file, options.settings, rig)
    for device in robot:
        if isinstance(device, StreamDevice):
            device.on_emulated_line = True
    diagram, schedule, _ = plant_of(file, robot)
    if diagram is None or schedule is None or not schedule.buses:
        raise BadInput(f"{options.file}: {robot.name} has no device on a bus that can be emulated")
    terminals, networks = lines_of(robot, schedule, *TERMINALS), lines_of(robot, schedule, NETWORK)
    pins = lines_of(robot, schedule, GPIO)
    on_lines = {**terminals, **networks, **pins}
    missing = next((name for name in schedule.buses if name not in rig.buses and name not in on_lines), None)
    if missing is not None:
        raise BadInput(
            f"{options.rig}: the plant emulates a device on bus {missing!r}, but the rig has no [bus.{missing}]"
        )
    emulators = {block.bus: block for block in diagram if isinstance(block, StreamDevice)}
    senders = {
        name: NetworkSender(**device.opening(), message_bytes=emulators[name].message_bytes)
        for name, device in networks.items()
    }
    buses = PlantBuses(rig, [name for name in schedule.buses if name not in on_lines], chips=_chips_of(robot, diagram))
    servers = {name: GpioServer(device.path, **device.opening()) for name, device in pins.items()}
    lines = EmulatedLines(terminals, options.lines, senders, servers)
    try:
        print_to_stderr(buses.remarks)
        consent(buses.real, options.yes)
        print_lines(_introduction(options, diagram, schedule, rig, file.has_plant, lines))
        ends = dict(zip(buses.names, buses.ends())) | {name: lines.end(name) for name in on_lines}
        fast = [rig.buses[name].data_bitrate if name in rig.buses else 0.0 for name in schedule.buses]
        service = Service(schedule, [ends[name] for name in schedule.buses], options.bitrate, fast)
        outcome = service.run(options.duration)
        if outcome.faulted:
            print_to_stderr(_fault(outcome, buses))
        elif reason := stop_reason(outcome):
            print_to_stderr([reason])
        print_lines(summary(service.statistics, schedule))
        return exit_code(outcome)
    finally:
        lines.close()
        buses.close()


def _chips_of(robot: Diagram, plant: Diagram) -> dict[str, list[tuple[ChipDevice, ChipDevice]]]:
    """Return {name of an I2C or SPI bus: [(device of the robot, its emulator)]}."""
    from blocks.chips import ChipDevice

    def places(diagram: Diagram) -> dict[tuple[str, int, int], ChipDevice]:
        devices = [block for block in diagram if isinstance(block, ChipDevice)]
        return {(block.bus, block.place, block.address): block for block in devices}

    emulators, chips = places(plant), {}
    for place, device in places(robot).items():
        if place in emulators:
            chips.setdefault(device.bus, []).append((device, emulators[place]))
    return chips


def parse(arguments: Sequence[str]) -> Namespace:
    """Parse the arguments. Raises BadInput."""
    parser = Parser(
        "emulate", "Emulate the devices of a diagram on the real buses of a rig, for a run in another terminal."
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
        file={"help": "the robot's diagram file; without a plant() every device is emulated"},
        rig={"required": True, "help": "the rig file of the run"},
        bitrate={"help": "delay each reply by the time of its bits at N bit/s (default: reply at once)"},
        yes={"help": "on real CAN: do not ask whether every real drive is disconnected"},
    )
    parser.add_argument(
        "--lines",
        type=Path,
        metavar="DIR",
        help="folder for links to the terminals of emulated serial sensors; created if it is missing",
    )
    return parser.parse_args(arguments)


def consent(real: Sequence[str], given: bool) -> None:
    """Ask the operator to confirm that no real drive is connected. Raises BadInput.

    real : names of the buses that are not virtual
    given : whether --yes has confirmed it
    """
    if not real or given:
        return
    if not (sys.stdin is not None and sys.stdin.isatty()):
        raise BadInput(
            f"{', '.join(real)}: cannot ask whether real drives are connected, as standard input is not a terminal: "
            f"{DANGER}. Disconnect every real drive and pass --yes"
        )
    print_to_stderr(
        [
            f"{', '.join(real)}: disconnect every real drive first: {DANGER}",
            "Press Enter to confirm that none is connected, Ctrl-C to end",
        ]
    )
    discard_typed()
    if sys.stdin.readline() == "":
        raise BadInput("standard input ended before the confirmation that no real drive is connected")


def _introduction(
    options: Namespace, diagram: Diagram, schedule: Schedule, rig: RigFile, given: bool, serial: EmulatedLines
) -> list[str]:
    kind = "the plant of the file" if given else "every device, each actuator on a free inertia"
    lines = [f"{schedule.name}: {kind}, at {schedule.rate:g} Hz"]
    width = max([12, *(len(name) + 2 for name in schedule.buses)])
    for index, name in enumerate(schedule.buses):
        here = [diagram[device.name] for device in schedule.devices if device.bus == index]
        bus = rig.buses.get(name)
        place = serial.place(name) if bus is None else f"{bus.interface} {bus.channel}"
        lines.append(f"  {name:<{width}}{place}")
        lines += [f"    {_title(block)}" for block in here]
    variable = f"TICKWORK_PORTS={':'.join(serial.paths.values())} " if serial.paths else ""
    return [*lines, f"in another terminal: {variable}{program()} {options.file} --rig {options.rig}", "Ctrl-C ends it"]


def _title(block: Any) -> str:
    ids = ", ".join(map(str, block.displayed_addresses()))
    words = [block.path, getattr(block, "model", ""), f"id {ids}" if ids else ""]
    return "  ".join(filter(None, words))


def _fault(outcome: Outcome, buses: PlantBuses) -> list[str]:
    where = outcome.culprit or ", ".join(buses.names)
    why = buses.explain(where) if where in buses.cans else str(outcome.error or "")
    return [f"tickwork: the emulation ended: {outcome.status} at {where}" + (f": {why}" if why else "")]


def summary(statistics: Mapping[str, Any], schedule: Schedule) -> list[str]:
    """Return the lines at the end. statistics : statistics of the shared state"""
    frames, seconds = statistics["frames"], (statistics["last_tick"] + 1) / schedule.rate
    return [
        f"{schedule.name}: {seconds:.1f} s at {schedule.rate:g} Hz, {statistics['missed']} steps missed",
        f"  buses       {frames['received']} frames received, {frames['sent']} sent",
    ]
