"""Every drive and sensor that responds on a CAN bus, without enabling a motor.

The scan first listens. If another controller commands drives, it sends nothing, because the queries remove torque.
Otherwise it requests the address claim and software version of J1939 nodes, then sends the queries of the device
families.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Container, Iterable, Sequence
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

from blocks.actuators.queries import same_id
from blocks.families import families
from runtime.host.errors import BadInput
from runtime.robot.rig import j1939
from runtime.robot.rig.tool_bus import QUERY_INTERVAL

if TYPE_CHECKING:
    from graph.family import Answer, Drive, Query
    from runtime.robot.rig.tool_bus import ToolBus

LISTEN_TIME = 0.1  # s before a single drive is queried
SETTLE_TIME = 0.08  # s after the last query of a round
REMEDY_OF_SILENCE = (
    "check its supply, the wiring (CAN_H to CAN_H), the 120 Ω resistors at both ends and the bitrate (drives use "
    "1 Mbit/s)"
)


@dataclass
class Report:
    """Devices and traffic of a bus.

    drives : graph.family.Answer of each drive
    nodes : j1939.Node of each J1939 node
    commanded : ids that another controller commands
    others : identifiers of frames from unknown devices, in candump's notation
    remarks : problems of the bus, for the operator
    sent : (identifier, is extended, data, reason) of every frame sent
    refused, errors : numbers of frames not acknowledged and of error frames
    chips : runtime.setup.commissioning.chips.Chip of each chip of an I2C bus
    """

    bus: str
    interface: str
    channel: str
    bitrate: int
    drives: list[Answer] = field(default_factory=list)
    nodes: list[j1939.Node] = field(default_factory=list)
    commanded: list[int] = field(default_factory=list)
    others: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    sent: list[tuple[int, bool, bytes, str]] = field(default_factory=list)
    refused: int = 0
    errors: int = 0
    chips: list[Any] = field(default_factory=list)


def scan(bus: ToolBus, ids: Sequence[int], listen: float) -> Report:
    """Scan a ToolBus. Returns the Report.

    ids : drive ids to query
    listen : s of listening before the first query
    """
    about = bus.bus
    report = Report(about.name, about.interface, about.channel, about.bitrate, remarks=list(bus.remarks))
    before = bus.listen(listen)
    nodes = j1939.broadcasts(before, listen)
    report.commanded = foreign_drive_ids(before, ids)
    if report.commanded:
        for family in families():
            report.drives += family.reports(before).values()
        report.remarks.append(
            f"another controller commands id {', '.join(map(str, report.commanded))} on this bus. Nothing was sent, "
            "because the queries remove torque. End that program first"
        )
    else:
        _ask_nodes(bus, nodes)
        for shared in merge_queries(query for family in families() for query in family.queries):
            report.drives += ask_drives(bus, ids, shared, before)
    report.drives.sort(key=lambda drive: drive.can_id)
    report.nodes = [nodes[address] for address in sorted(nodes)]
    report.others = others(before, report)
    report.refused, report.errors = bus.refused, bus.errors
    report.remarks += _bus_problems(bus, report)
    report.sent = bus.sent
    return report


def foreign_drive_ids(frames: Iterable[tuple[int, bool, bytes]], ids: Container[int]) -> list[int]:
    """Return the ids of drives that another controller sends commands to."""
    frames = [frame for frame in frames if j1939.quantity_of(*frame) is None]
    commanded_ids = {family.commanded(*frame) for frame in frames for family in families()}
    return sorted(can_id for can_id in commanded_ids if can_id is not None and can_id in ids)


def refuse_company(bus: ToolBus) -> None:
    """Raise BadInput if another controller commands drives on a bus."""
    others = foreign_drive_ids(bus.listen(LISTEN_TIME), range(1, 256))
    if others:
        raise BadInput(
            f"another controller commands id {', '.join(map(str, others))} on this bus. Nothing was sent, "
            "because the queries remove torque. End that program first"
        )


def _ask_nodes(bus: ToolBus, nodes: dict[int, j1939.Node]) -> None:
    bus.send(j1939.request(j1939.CLAIM), "address claim of J1939 nodes")
    j1939.learn(nodes, bus.listen(SETTLE_TIME))
    for address in sorted(nodes):
        bus.send(j1939.request(j1939.VERSION, address), "software version of J1939 nodes")
    if nodes:
        j1939.learn(nodes, bus.listen(SETTLE_TIME))


def merge_queries(queries: Iterable[Query]) -> list[list[Query]]:
    """Return queries grouped by the frame they send, in the order of the last query of each group."""
    shared = {}
    for query in queries:
        key = query.frame, query.why
        shared[key] = [*shared.pop(key, ()), query]
    return list(shared.values())


def merged_stop_queries(
    can_id: int, drive: Drive | None, model: Any
) -> list[tuple[tuple[int, bool, bytes] | None, Callable[..., Any]]]:
    """Return [(frame, reader)] of all families for one id: first drives that report unasked, each frame once.

    drive, model : graph.family.Drive and its model, which decode the replies of their own family only; or None
    """
    readers: dict[Any, list[Any]] = {None: []}
    own = [(family, model if drive in family.drives else None) for family in families()]
    for query in (query for family, known in own for query in family.stop_queries(can_id, known)):
        readers[query.frame] = [
            *(readers.pop(query.frame, ()) if query.frame is not None else readers[None]),
            query.read,
        ]

    def first_of(reads):
        return lambda *frame: next((answer for read in reads if (answer := read(*frame)) is not None), None)

    return [(frame, first_of(reads)) for frame, reads in readers.items()]


def ask_drives(
    bus: ToolBus, ids: Sequence[int], queries: Sequence[Query], before: Sequence[tuple[int, bool, bytes]]
) -> list[Answer]:
    """Return the Answers to queries that send the same frame. Each id is queried once.

    before : frames received before the first query
    """
    received = []
    for can_id in ids:
        if (frame := queries[0].frame(can_id)) is None:
            continue
        if not bus.send(frame, queries[0].why) and bus.refused > 3:
            break  # no node acknowledges: further queries would only time out
        received += bus.listen(QUERY_INTERVAL)
    received += bus.listen(SETTLE_TIME)
    answers_of = {}
    for query in queries:
        for answer in query.answers(received, list(ids), list(before)):
            if query.details is not None:
                answer = bus.converse(query.details(answer))
            answers_of.setdefault(answer.can_id, []).append(answer)
    for can_id, answers in answers_of.items():
        if len(answers) > 1:
            answers[-1].remarks.append(same_id(len(answers), can_id))
    return [answer for answers in answers_of.values() for answer in answers]


def others(frames: Iterable[tuple[int, bool, bytes]], report: Report) -> list[str]:
    """Return the received identifiers that belong to no known device."""
    nodes = {node.address for node in report.nodes}
    unknown = []
    for identifier, extended, data in frames:
        known = extended and identifier & 0xFF in nodes
        if not known and not any(family.reports([(identifier, extended, data)]) for family in families()):
            unknown.append(f"{identifier:08X}" if extended else f"{identifier:03X}")
    return sorted(set(unknown))


def _bus_problems(bus: ToolBus, report: Report) -> list[str]:
    """Return lines about problems of the bus itself."""
    silent = not (report.drives or report.nodes or report.commanded)
    if bus.wire.trouble:
        return [f"the interface failed: {bus.wire.trouble[1]}"]
    if silent and (corrupt := bus.wire.counts.get("corrupt")):
        return [
            f"{corrupt} frames could not be decoded: check the adapter and its driver's settings, such as tty_baudrate "
            f"in `options`, and the bitrate, {report.bitrate} bit/s"
        ]
    if silent and report.others:
        return [f"frames are received, but no known device responds: {', '.join(report.others[:8])}"]
    if silent and (bus.errors or bus.refused):
        return [
            f"no valid frames ({bus.errors} error frames, {bus.refused} frames not acknowledged). The most likely "
            f"cause is the bitrate, {report.bitrate} bit/s; {_remedy_of_silence()}; {_retry(report)}"
        ]
    if silent:
        return [f"no device responds: {_remedy_of_silence()}; {_retry(report)}"]
    return (
        [f"{bus.errors} error frames: check the wiring, the 120 Ω resistors at both ends, and drive ids"]
        if bus.errors
        else []
    )


def _remedy_of_silence() -> str:
    return ", ".join([REMEDY_OF_SILENCE, *(family.bus_hint for family in families() if family.bus_hint)])


def _retry(report: Report) -> str:
    other = 250_000 if report.bitrate != 250_000 else 1_000_000
    if report.interface != "socketcan":
        return f"try --bitrate {other}"
    return (
        f"try: sudo ip link set {report.channel} down && sudo ip link set {report.channel} type can bitrate "
        f"{other} restart-ms 100 up"
    )


def plain(report: Report) -> dict[str, Any]:
    """Return a Report as a dict for JSON."""
    row_of_report = asdict(report)
    for node, row in zip(report.nodes, row_of_report["nodes"]):
        row["family"] = node.family
    row_of_report["sent"] = [
        {"id": identifier, "extended": extended, "data": data.hex().upper(), "why": why}
        for identifier, extended, data, why in report.sent
    ]
    return row_of_report


def clock() -> str:
    """Return the local date and time, such as '2026-11-21 10:00'."""
    return time.strftime("%Y-%m-%d %H:%M")
