"""Every drive and sensor that responds on a CAN bus, without enabling a motor.

First the scan only listens. Where another controller commands drives nothing is asked, because the queries take torque
away. Then, in this order: address claim and software version of J1939 nodes; the queries of the device families.
"""

import time
from dataclasses import asdict, dataclass, field

from blocks.actuators.queries import same_id
from blocks.families import families
from runtime.base.errors import BadInput
from runtime.commissioning import j1939
from runtime.commissioning.bus import PAUSE

LISTEN_TIME = 0.1  # s before one drive is asked
SETTLE_TIME = 0.08  # s after the last question of a round
REMEDY_OF_SILENCE = (
    "is its supply on, CAN_H to CAN_H, 120 Ω at both ends? At another bitrate no node is understood: drives have "
    "1 Mbit/s"
)


@dataclass
class Report:
    """What was found on a bus.

    drives : graph.family.Answer; nodes : j1939.Node; commanded : ids that another controller commands
    others : identifiers of frames that belong to none of those, as candump writes them; chips : of an I2C bus,
        runtime.commissioning.chips.Chip; sent : counts of what was sent, by why
    """

    bus: str
    interface: str
    channel: str
    bitrate: int
    drives: list = field(default_factory=list)
    nodes: list = field(default_factory=list)
    commanded: list = field(default_factory=list)
    others: list = field(default_factory=list)
    remarks: list = field(default_factory=list)
    sent: list = field(default_factory=list)
    refused: int = 0
    errors: int = 0
    chips: list = field(default_factory=list)


def scan(bus, ids, listen):
    """Return the Report of a ToolBus. ids : to ask; listen : s before anything is asked"""
    about = bus.bus
    report = Report(about.name, about.interface, about.channel, about.bitrate, remarks=list(bus.remarks))
    before = bus.listen(listen)
    nodes = j1939.broadcasts(before, listen)
    report.commanded = commanded(before, ids)
    if report.commanded:
        for family in families():
            report.drives += family.reports(before).values()
        report.remarks.append(
            f"another controller commands {', '.join(map(str, report.commanded))} here: nothing was sent, because the "
            "queries take torque away; end that program first"
        )
    else:
        ask_nodes(bus, nodes)
        for shared in merged(query for family in families() for query in family.queries):
            report.drives += ask_drives(bus, ids, shared, before)
    report.drives.sort(key=lambda drive: drive.can_id)
    report.nodes = [nodes[address] for address in sorted(nodes)]
    report.others = others(before, report)
    report.refused, report.errors = bus.refused, bus.errors
    report.remarks += troubles(bus, report)
    report.sent = bus.sent
    return report


def commanded(frames, ids):
    """Return the ids of drives that another controller sends commands to."""
    frames = [frame for frame in frames if j1939.measured(*frame) is None]
    found = {family.commanded(*frame) for frame in frames for family in families()}
    return sorted(can_id for can_id in found if can_id is not None and can_id in ids)


def refuse_company(bus):
    """BadInput where another controller commands drives on a bus."""
    others = commanded(bus.listen(LISTEN_TIME), range(1, 256))
    if others:
        raise BadInput(
            f"another controller commands id {', '.join(map(str, others))} on this bus: end that program first, "
            "because the queries take torque away; nothing was sent"
        )


def ask_nodes(bus, nodes):
    bus.send(j1939.request(j1939.CLAIM), "address claim of J1939 nodes")
    j1939.learn(nodes, bus.listen(SETTLE_TIME))
    for address in sorted(nodes):
        bus.send(j1939.request(j1939.VERSION, address), "software version of J1939 nodes")
    if nodes:
        j1939.learn(nodes, bus.listen(SETTLE_TIME))


def merged(queries):
    """Return lists of queries that send the same frames, each where its last query stands."""
    shared = {}
    for query in queries:
        key = query.frame, query.why
        shared[key] = [*shared.pop(key, ()), query]
    return list(shared.values())


def merged_stop_queries(can_id, model):
    """Return [(frame, reader)] of every family for one id: drives that report first, a shared frame once."""
    readers: dict = {None: []}
    for query in (query for family in families() for query in family.stop_queries(can_id, model)):
        readers[query.frame] = [
            *(readers.pop(query.frame, ()) if query.frame is not None else readers[None]),
            query.read,
        ]

    def first_of(reads):
        return lambda *frame: next((answer for read in reads if (answer := read(*frame)) is not None), None)

    return [(frame, first_of(reads)) for frame, reads in readers.items()]


def ask_drives(bus, ids, queries, before):
    """Return the Answers to queries that send the same frames: each id is asked once."""
    received = []
    for can_id in ids:
        if (frame := queries[0].frame(can_id)) is None:
            continue
        if not bus.send(frame, queries[0].why) and bus.refused > 3:
            break  # no node acknowledges: the rest would only wait
        received += bus.listen(PAUSE)
    received += bus.listen(SETTLE_TIME)
    found = {}
    for query in queries:
        for answer in query.answers(received, ids, before):
            if query.details is not None:
                answer = bus.converse(query.details(answer))
            found.setdefault(answer.can_id, []).append(answer)
    for can_id, answers in found.items():
        if len(answers) > 1:
            answers[-1].remarks.append(same_id(len(answers), can_id))
    return [answer for answers in found.values() for answer in answers]


def others(frames, report):
    """Return identifiers that were received and belong to nothing that was found."""
    nodes = {node.address for node in report.nodes}
    found = []
    for identifier, extended, data in frames:
        known = extended and identifier & 0xFF in nodes
        if not known and not any(family.reports([(identifier, extended, data)]) for family in families()):
            found.append(f"{identifier:08X}" if extended else f"{identifier:03X}")
    return sorted(set(found))


def troubles(bus, report):
    """Lines on what is wrong with the bus itself."""
    silent = not (report.drives or report.nodes or report.commanded)
    if bus.wire.trouble:
        return [f"the interface failed: {bus.wire.trouble[1]}"]
    if silent and report.others:
        return [f"frames are received, and no device answers: {', '.join(report.others[:8])}"]
    if silent and (bus.errors or bus.refused):
        return [
            f"no node is understood ({bus.errors} error frames, {bus.refused} frames not acknowledged): most likely "
            "the bitrate, which is "
            f"{report.bitrate} bit/s here; {remedy_of_silence()}; {retry(report)}"
        ]
    if silent:
        return [f"no device answers: {remedy_of_silence()}; {retry(report)}"]
    return [f"{bus.errors} error frames: wires, 120 Ω at both ends, or two drives with one id"] if bus.errors else []


def remedy_of_silence():
    return ", ".join([REMEDY_OF_SILENCE, *(family.bus_hint for family in families() if family.bus_hint)])


def retry(report):
    other = 250_000 if report.bitrate != 250_000 else 1_000_000
    if report.interface != "socketcan":
        return f"try --bitrate {other}"
    return (
        f"try: sudo ip link set {report.channel} down && sudo ip link set {report.channel} type can bitrate "
        f"{other} restart-ms 100 up"
    )


def plain(report):
    """For machines: a dict."""
    found = asdict(report)
    for node, row in zip(report.nodes, found["nodes"]):
        row["family"] = node.family
    found["sent"] = [
        {"id": identifier, "extended": extended, "data": data.hex().upper(), "why": why}
        for identifier, extended, data, why in report.sent
    ]
    return found


def clock():
    return time.strftime("%Y-%m-%d %H:%M")
