"""OpenIMU and other nodes of SAE J1939 on a CAN bus: what they send by themselves, and how they are asked who they are.

Requests are PGN 59904 with the wanted PGN, least significant byte first. Ours come from address 0xF9, a service tool's,
so that their identifiers end in a byte that is no drive's id. (SAE J1939-21, J1939-81; Aceinna OpenIMU300RI and 335RI,
CAN messages.)
"""

from dataclasses import dataclass, field

from blocks.imus.openimu.frames import (
    ACCELERATION,
    ANGULAR_RATE,
    CLAIM,
    EVERYBODY,
    MAGNETIC_FIELD,
    OURS,
    REQUEST,
    SLOPE,
)

VERSION, ECU = 65242, 64965
DATA = {
    SLOPE: "slope",
    ANGULAR_RATE: "angular rate",
    ACCELERATION: "acceleration",
    MAGNETIC_FIELD: "magnetic field",
    61459: "slope",
}
ACEINNA, INERTIAL = 823, 131  # manufacturer and function of a NAME
OPENIMU, NODE = "OpenIMU", "J1939 node"
LOWEST = 128  # address that an OpenIMU may have, and its default


@dataclass
class Node:
    """address : of the node; sends : {what: Hz}; manufacturer, function : of its NAME, None where it did not say;
    others in words
    """

    address: int
    sends: dict = field(default_factory=dict)
    manufacturer: int | None = None
    function: int | None = None
    unique: str = ""
    firmware: str = ""
    remarks: list = field(default_factory=list)

    @property
    def family(self):
        return OPENIMU if self.manufacturer == ACEINNA or (self.manufacturer is None and self.sends) else NODE


def request(pgn, destination=EVERYBODY):
    return 6 << 26 | REQUEST << 8 | destination << 8 | OURS, True, pgn.to_bytes(3, "little")


def parts(identifier, extended):
    """(PGN, source address) of a frame, None for one of another kind. PGNs with a destination come without it."""
    if not extended:
        return None
    pgn = identifier >> 8 & 0x3FFFF
    return (pgn & 0x3FF00 if (pgn >> 8 & 0xFF) < 240 else pgn), identifier & 0xFF


def broadcasts(frames, seconds):
    """{address: Node} of those that send measurements by themselves. frames : heard in that time"""
    found = {}
    for identifier, extended, _ in frames:
        pgn, address = parts(identifier, extended) or (None, None)
        if pgn in DATA and address >= LOWEST:
            sends = found.setdefault(address, Node(address)).sends
            sends[DATA[pgn]] = sends.get(DATA[pgn], 0.0) + 1.0 / seconds
    return found


def learn(found, frames):
    """Add what nodes have answered. found : {address: Node}"""
    for identifier, extended, data in frames:
        pgn, address = parts(identifier, extended) or (None, None)
        if pgn == CLAIM and len(data) == 8:
            name = int.from_bytes(data, "little")
            node = found.setdefault(address, Node(address))
            node.manufacturer, node.function = name >> 21 & 0x7FF, name >> 40 & 0xFF
            if node.unique not in ("", data.hex().upper()):
                node.remarks.append(
                    f"two nodes have address {address}: {node.unique} and {data.hex().upper()}; give one another"
                )
            node.unique = data.hex().upper()
        elif pgn == VERSION and address in found:
            found[address].firmware = ".".join(map(str, data[:5]))
