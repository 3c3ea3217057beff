"""Who is on a bus: every drive and IMU that answers, without arming anything.

First it is only listened. Where somebody commands drives nothing is asked, since the question takes torque away. Then,
in this order:

    J1939 nodes         address claim, software version
    RobStride family    get id to each id; of those that answer stop and version (both take torque away), and readings
    V3.0 boards         disable to each id
    MIT mode            disable to each id (blocks.actuators.cubemars.asking says why that)
"""

import time
from dataclasses import asdict, dataclass, field

from blocks.actuators.cubemars import asking as cubemars
from blocks.actuators.queries import Answer
from blocks.actuators.robstride import asking as robstride
from blocks.actuators.robstride import frames
from blocks.actuators.robstride.parameters import PARAMETERS
from runtime.base.errors import BadInput
from runtime.commissioning import openimu
from runtime.commissioning.bus import PAUSE

NEWCOMER = robstride.NEWCOMER  # no id of a drive: what ends so is a RobStride's answer
LISTEN = 0.1  # s before one drive is asked
SETTLE = 0.08  # s after the last question of a round
COMMANDS = (frames.OPERATION, frames.ENABLE, frames.WRITE)
SERVO_PACKETS = 8  # the last of a CubeMars in servo mode, force control of V3 boards
CURE_OF_SILENCE = (
    "is its supply on, CAN_H to CAN_H, 120 Ω at both ends? At another bitrate nobody is heard: drives have 1 Mbit/s, "
    "an OpenIMU as it is "
    "sold has 250 kbit/s"
)


@dataclass
class Report:
    """What was found on a bus.

    drives : blocks.actuators.queries.Answer; nodes : openimu.Node; commanded : ids that somebody else commands
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
    """The Report of a ToolBus. ids : that are asked; listen : s before anything is asked"""
    about = bus.bus
    report = Report(about.name, about.interface, about.channel, about.bitrate, remarks=list(bus.remarks))
    before = bus.listen(listen)
    nodes = openimu.broadcasts(before, listen)
    report.drives += servo_drives(before).values()
    report.commanded = commanded(before, ids)
    if report.commanded:
        report.remarks.append(
            f"somebody else commands {', '.join(map(str, report.commanded))} here: nothing was asked, since the "
            "question takes torque "
            "away; end that program first"
        )
    else:
        ask_nodes(bus, nodes)
        report.drives += private_drives(bus, ids)
        boards = servo_drives(before) | servo_drives(
            ask_all(bus, ids, cubemars.question_of_v3, "disable of V3.0 boards")
        )
        report.drives = [
            drive for drive in report.drives if drive.can_id not in boards or drive.family != cubemars.SERVO
        ]
        report.drives += [*boards.values(), *mit_drives(bus, ids, before)]
    report.drives.sort(key=lambda drive: drive.can_id)
    report.nodes = [nodes[address] for address in sorted(nodes)]
    report.others = others(before, report)
    report.refused, report.errors = bus.refused, bus.errors
    report.remarks += troubles(bus, report)
    report.sent = bus.sent
    return report


def commanded(heard, ids):
    """Ids that somebody sends commands to. In MIT mode what does not begin with the id is no answer; servo mode has
    packets 0 to 8.
    """
    found = set()
    for identifier, extended, data in heard:
        if extended:
            private = identifier >> 24 in COMMANDS and openimu.parts(identifier, extended)[0] not in openimu.DATA
            if (private or identifier >> 8 <= SERVO_PACKETS) and identifier & 0xFF in ids:
                found.add(identifier & 0xFF)
        elif identifier in ids and len(data) == 8 and data[0] != identifier:
            found.add(identifier)
    return sorted(found)


def refuse_company(bus):
    """BadInput where somebody else commands drives on a bus."""
    others = commanded(bus.listen(LISTEN), range(1, 256))
    if others:
        raise BadInput(
            f"somebody else commands id {', '.join(map(str, others))} on this bus: end that program first, since "
            "asking would take torque "
            "away; nothing was sent"
        )


def servo_drives(heard):
    """{id: the newest status} of drives in servo mode or with a V3.0 board, that to a disable before others."""
    found = {}
    for frame in heard:
        answer = cubemars.servo_status(*frame)
        if (
            answer is not None
            and answer.can_id != NEWCOMER
            and getattr(found.get(answer.can_id), "family", "") != cubemars.V3
        ):
            found[answer.can_id] = answer
    return found


def ask_nodes(bus, nodes):
    bus.send(openimu.request(openimu.CLAIM), "address claim of J1939 nodes")
    openimu.learn(nodes, bus.listen(SETTLE))
    for address in sorted(nodes):
        bus.send(openimu.request(openimu.VERSION, address), "software version of J1939 nodes")
    if nodes:
        openimu.learn(nodes, bus.listen(SETTLE))


def ask_all(bus, ids, question, why):
    """What is heard while each id is asked once."""
    heard = []
    for can_id in ids:
        if not bus.send(question(can_id), why) and bus.refused > 3:
            break  # nobody takes frames: the rest would only wait
        heard += bus.listen(PAUSE)
    return heard + bus.listen(SETTLE)


def private_drives(bus, ids):
    heard = ask_all(bus, [can_id for can_id in ids if can_id <= 127], robstride.get_id, "get id of RobStride drives")
    found = []
    for can_id in ids:
        unique = [identity for frame in heard if (identity := robstride.identity(*frame, can_id)) is not None]
        if len(unique) > 1:
            found.append(
                Answer(robstride.EITHER, can_id, unique=" and ".join(unique), remarks=[two(len(unique), can_id)])
            )
        elif unique:
            found.append(about(bus, can_id, unique[0]))
    return found


def about(bus, can_id, unique=""):
    """The Answer of a drive in the private protocol, once it has been asked for all that it tells."""
    found = bus.ask(
        robstride.stop(can_id), "stop of RobStride drives", lambda *frame: robstride.feedback(*frame, can_id)
    )
    found = found or Answer(
        robstride.EITHER, can_id, remarks=["it does not answer a stop: temperature and faults are not known"]
    )
    found.unique = unique
    found.firmware = (
        bus.ask(
            robstride.version(can_id),
            "stop and version of RobStride drives",
            lambda *frame: robstride.firmware(*frame, can_id),
        )
        or ""
    )
    found.family = robstride.ROBSTRIDE if found.firmware else robstride.EITHER
    for name, key in (("mechPos", "position"), ("mechVel", "velocity"), ("VBUS", "voltage")):
        value = read(bus, can_id, PARAMETERS[name])
        if value is not None:
            setattr(found, key, value)
    return found


def read(bus, can_id, parameter, is_cybergear=False):
    """The value of a parameter, None where the drive does not give it."""
    answer = bus.ask(
        robstride.read(parameter.index, can_id),
        "readings of RobStride drives",
        lambda *frame: robstride.reading(*frame, parameter.index, can_id),
    )
    return parameter.value_of(answer[1], is_cybergear) if answer and answer[0] else None


def mit_drives(bus, ids, before):
    heard = ask_all(bus, ids, cubemars.question, "disable of drives in MIT mode")
    found = []
    for can_id in ids:
        unasked = any(cubemars.answer(*frame, can_id) for frame in before)
        answers = [answer for frame in heard if (answer := cubemars.answer(*frame, can_id)) is not None]
        for family in (cubemars.MIT, cubemars.ROBSTRIDE_MIT):
            same = [answer for answer in answers if answer.family == family]
            if same:
                if len(same) > 1 and not unasked:
                    same[0].remarks.append(two(len(same), can_id))
                found.append(same[0])
        if len({answer.family for answer in answers}) > 1:
            found[-1].remarks.append(two(len(answers), can_id))
        named = {name for frame in heard if (name := cubemars.other_id(*frame, can_id)) is not None}
        if named and not answers:
            found.append(
                Answer(
                    cubemars.MIT,
                    can_id,
                    fault=None,
                    remarks=[
                        f"replies with id {' and '.join(map(str, sorted(named)))} in byte 0: the drive is configured "
                        "to "
                        "answer with another id, and no "
                        f"block reads it"
                    ],
                )
            )
    return found


def two(count, can_id):
    return (
        f"{count} answers to one question: {count} drives have id {can_id}; take all but one off the bus, and give "
        "it another. Enable none: "
        f"in MIT mode each takes the other's answers for commands"
    )


def others(heard, report):
    """Identifiers that were heard and are nobody's here."""
    known = {node.address for node in report.nodes}
    found = []
    for identifier, extended, data in heard:
        ours = cubemars.servo_status(identifier, extended, data) is not None
        if extended and (identifier & 0xFF) in known:
            ours = True
        if not ours:
            found.append(f"{identifier:08X}" if extended else f"{identifier:03X}")
    return sorted(set(found))


def troubles(bus, report):
    """Lines on what is wrong with the bus itself."""
    silent = not (report.drives or report.nodes or report.commanded)
    if bus.wire.trouble:
        return [f"the interface failed: {bus.wire.trouble[1]}"]
    if silent and report.others:
        return [f"frames are heard, and nobody answers: {', '.join(report.others[:8])}"]
    if silent and (bus.errors or bus.refused):
        return [
            f"nobody is understood ({bus.errors} error frames, {bus.refused} frames that nobody took): most likely "
            "the bitrate, which is "
            f"{report.bitrate} bit/s here; {CURE_OF_SILENCE}; {retry(report)}"
        ]
    if silent:
        return [f"nobody answers: {CURE_OF_SILENCE}; {retry(report)}"]
    return [f"{bus.errors} error frames: wires, 120 Ω at both ends, or two drives with one id"] if bus.errors else []


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
