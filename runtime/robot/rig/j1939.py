"""SAE J1939 nodes on a CAN bus: cyclic measurements, NAME and software version.

Requests are PGN 59904 with the requested PGN, least significant byte first. Their source address is 0xF9,
that of a service tool, so that their identifiers end in a byte that is not the id of a drive. (SAE J1939-21, J1939-81.)
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from blocks.families import families

if TYPE_CHECKING:
    from graph import family

ALL, TOOL = 0xFF, 0xF9  # addresses
REQUEST, CLAIM, VERSION = 0xEA00, 0xEE00, 65242
UNKNOWN = "J1939 node"
LOWEST_ADDRESS = 128  # of a node other than a drive


@dataclass
class Node:
    """J1939 node.

    address : source address
    sends : {measured quantity: Hz}
    manufacturer, function : fields of its NAME, None if not reported
    unique : its NAME in hexadecimal, "" if not reported
    firmware : software version, "" if not reported
    remarks : problems, for the operator
    """

    address: int
    sends: dict[str, float] = field(default_factory=dict)
    manufacturer: int | None = None
    function: int | None = None
    unique: str = ""
    firmware: str = ""
    remarks: list[str] = field(default_factory=list)

    @property
    def family(self) -> str:
        """Name of its family; UNKNOWN without a block."""
        return self.kind.name if self.kind is not None else UNKNOWN

    @property
    def kind(self) -> family.Node | None:
        """The graph.family.Node of its block, or None for a node without a block."""
        for kind in _kinds():
            if self.manufacturer == kind.manufacturer:
                return kind
            if self.manufacturer is None and any(name in kind.groups.values() for name in self.sends):
                return kind
        return None


def _kinds() -> list[family.Node]:
    return [kind for family in families() for kind in family.nodes]


def request(pgn: int, destination: int = ALL) -> tuple[int, bool, bytes]:
    """Return the frame (identifier, is extended, data) that requests a PGN.

    destination : address of the node; ALL for every node
    """
    return 6 << 26 | REQUEST << 8 | destination << 8 | TOOL, True, pgn.to_bytes(3, "little")


def parts(identifier: int, extended: bool) -> tuple[int, int] | None:
    """Return (PGN without destination, source address) of a frame, or None if it is not a J1939 frame."""
    if not extended:
        return None
    pgn = identifier >> 8 & 0x3FFFF
    return (pgn & 0x3FF00 if (pgn >> 8 & 0xFF) < 240 else pgn), identifier & 0xFF


def quantity_of(identifier: int, extended: bool, data: bytes = b"") -> str | None:
    """Return the quantity measured by a frame of a known kind of node, or None for another frame."""
    pgn, _ = parts(identifier, extended) or (None, None)
    return next((kind.groups[pgn] for kind in _kinds() if pgn in kind.groups), None)


def broadcasts(frames: Iterable[tuple[int, bool, bytes]], seconds: float) -> dict[int, Node]:
    """Return {address: Node} of the nodes that send measurements unasked.

    frames : frames received within `seconds`
    """
    nodes = {}
    for frame in frames:
        what, address = quantity_of(*frame), frame[0] & 0xFF
        if what is not None and address >= LOWEST_ADDRESS:
            sends = nodes.setdefault(address, Node(address)).sends
            sends[what] = sends.get(what, 0.0) + 1.0 / seconds
    return nodes


def learn(nodes: dict[int, Node], frames: Iterable[tuple[int, bool, bytes]]) -> None:
    """Add the nodes' replies to requests.

    nodes : {address: Node}, which receives a node for each address claim
    frames : frames received after the requests
    """
    for identifier, extended, data in frames:
        pgn, address = parts(identifier, extended) or (None, 0)
        if pgn == CLAIM and len(data) == 8:
            name = int.from_bytes(data, "little")
            node = nodes.setdefault(address, Node(address))
            node.manufacturer, node.function = name >> 21 & 0x7FF, name >> 40 & 0xFF
            if node.unique not in ("", data.hex().upper()):
                node.remarks.append(
                    f"two nodes have address {address}: {node.unique} and {data.hex().upper()}; change one of them"
                )
            node.unique = data.hex().upper()
        elif pgn == VERSION and address in nodes:
            nodes[address].firmware = ".".join(map(str, data[:5]))
