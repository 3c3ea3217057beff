"""Serial numbers and firmware that the units of a rig report now, for comparison with their records.

No motor is enabled, and none keeps its torque: some drives report their firmware in the reply to a stop.
"""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

from blocks.families import families, family_of
from graph import Actuator, StreamDevice
from graph.dialogue import Dialogue, Listen, NoReply, Send
from runtime.robot.rig import j1939, ports
from runtime.robot.rig.dialogue_line import Seen, converse
from runtime.robot.rig.errors import Refused, RigError
from runtime.robot.rig.tool_bus import ToolBus

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from runtime.robot.rig.file import RigFile

NODE_ATTEMPTS, NODE_TIMEOUT = 3, 0.15  # number, and s for a reply of a sensor that is starting or busy


def identities(rig: RigFile, devices: Iterable[Any], opened: Mapping[str, ToolBus] | None = None) -> dict[str, Any]:
    """Return {path: {serial number: firmware} of the units that respond}. Devices that report none are left out.

    The firmware is "" where only that is not reported. opened : buses that are open already; Raises RigError
    """
    found, talks, lines = {}, {}, []
    for block in devices:
        if isinstance(block, StreamDevice) and block.identify is not None:
            lines.append(block)
        elif (talk := dialogue_of(block)) is not None:
            talks[block] = talk
    try:
        with ExitStack() as stack:
            buses = dict(opened or {})
            for block, talk in talks.items():
                if block.bus not in buses:
                    buses[block.bus] = stack.enter_context(ToolBus(rig.buses[block.bus]))
                found[block.path] = buses[block.bus].converse(talk)
    except Refused as refused:
        raise RigError(rig.path, [refused.problem]) from None
    return found | of_lines(lines)


def dialogue_of(block: Any) -> Dialogue | None:
    """Return the dialogue that identifies the units at the address of a CAN device, None if it reports nothing."""
    if isinstance(block, Actuator):
        family = family_of(block)
        return None if family is None else family.identity(block)
    if any(isinstance(block, node.block) for family in families() for node in family.nodes):
        return of_node(block.address)
    return None


def of_node(address: int) -> Dialogue:
    """Dialogue that returns {NAME: software version} of the J1939 nodes with an address."""
    nodes: dict[int, j1939.Node] = {}
    for pgn, destination in ((j1939.CLAIM, j1939.ALL), (j1939.VERSION, address)):
        wanted = lambda frames, pgn=pgn: any(j1939.parts(*frame[:2]) == (pgn, address) for frame in frames)  # noqa: E731
        for _ in range(NODE_ATTEMPTS):
            yield Send(j1939.request(pgn, destination), "name and software version of sensors")
            received = yield Listen(NODE_TIMEOUT, wanted)
            j1939.learn(nodes, received)
            if wanted(received):
                break
    node = nodes.get(address)
    return {} if node is None else {node.unique: node.firmware}


def of_lines(devices: Iterable[Any]) -> dict[str, dict[str, str]]:
    """Return the identities of sensors at serial lines, at their ports or by the ends of their serial numbers."""
    found: dict[str, dict[str, str]] = {}
    unplaced = []
    for block in devices:
        found[block.path], options = {}, block.opening()
        if not options["port"]:
            unplaced.append(block)
            continue
        try:
            with ports.open_port(block.path, options["port"], options["baudrate"]) as port:
                about = converse(port, block.identify())
                found[block.path] = {about.serial: about.firmware}
        except (Refused, NoReply, ValueError, OSError):
            pass  # opening the line for the run reports the cause
    if unplaced:
        seen = Seen({type(block) for block in unplaced}).look(unplaced[0].opening()["baudrate"])
        for block in unplaced:
            abouts = [each.about for each in seen.open.values() if each.about.ends_with(block.opening()["serial"])]
            found[block.path] = {about.serial: about.firmware for about in abouts}
        seen.close()
    return found
