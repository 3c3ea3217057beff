"""SAE J1939 nodes on a CAN bus: what they send without being asked, their NAME, and their software version.

Requests are PGN 59904 with the requested PGN, least significant byte first. They are sent from address 0xF9, that of a
service tool, so that their identifiers end in a byte that is no drive's id. (SAE J1939-21, J1939-81.)
"""

from dataclasses import dataclass, field

from blocks.families import families

ALL, TOOL = 0xFF, 0xF9  # addresses
REQUEST, CLAIM, VERSION = 0xEA00, 0xEE00, 65242
UNKNOWN = "J1939 node"
LOWEST_ADDRESS = 128  # of a node that is no drive


@dataclass
class Node:
    """address : of the node; sends : {what: Hz}; manufacturer, function : of its NAME, None where not reported; unique,
    firmware, remarks : in words
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
        return self.kind.name if self.kind is not None else UNKNOWN

    @property
    def kind(self):
        """The graph.family.Node of its block, None for a node that has none."""
        for kind in kinds():
            if self.manufacturer == kind.manufacturer:
                return kind
            if self.manufacturer is None and any(name in kind.groups.values() for name in self.sends):
                return kind
        return None


def kinds():
    return [kind for family in families() for kind in family.nodes]


def request(pgn, destination=ALL):
    return 6 << 26 | REQUEST << 8 | destination << 8 | TOOL, True, pgn.to_bytes(3, "little")


def parts(identifier, extended):
    """Return (PGN, source address) of a frame, None for one of another kind. A PGN with a destination: without it."""
    if not extended:
        return None
    pgn = identifier >> 8 & 0x3FFFF
    return (pgn & 0x3FF00 if (pgn >> 8 & 0xFF) < 240 else pgn), identifier & 0xFF


def measured(identifier, extended, data=b""):
    """Return what a frame of a known kind of node measures, None for another frame."""
    pgn, _ = parts(identifier, extended) or (None, None)
    return next((kind.groups[pgn] for kind in kinds() if pgn in kind.groups), None)


def broadcasts(frames, seconds):
    """Return {address: Node} of those that send measurements without being asked.

    frames : received within `seconds`
    """
    found = {}
    for frame in frames:
        what, address = measured(*frame), frame[0] & 0xFF
        if what is not None and address >= LOWEST_ADDRESS:
            sends = found.setdefault(address, Node(address)).sends
            sends[what] = sends.get(what, 0.0) + 1.0 / seconds
    return found


def learn(found, frames):
    """Add what nodes have answered to `found`, {address: Node}."""
    for identifier, extended, data in frames:
        pgn, address = parts(identifier, extended) or (None, 0)
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
