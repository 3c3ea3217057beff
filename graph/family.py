"""A device family as a plug-in: one folder, and one object that an entry point of the group `tickwork.families` names.

The commands that commission devices (`scan`, `move`, `stream`, `configure`, `blocks --actuators`, `rate`) work with the
Family objects alone. Whatever talks to a device is a dialogue (graph.dialogue) or a pure function of frames; a frame is
(arbitration id, is extended, data).
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from graph.dialogue import Dialogue, Frame, Reader, Rejected

ENTRY_POINTS = "tickwork.families"


@dataclass
class Answer:
    """State of one drive, from one answer while it has no torque.

    family : how its frames are read, in words; can_id : its own; block : class name of its block
    position in rad, velocity in rad/s, torque in N·m, current in A, temperature in °C, voltage in V: None where not
        reported
    fault : in words, "" for none, None where not reported; enabled : None where not reported
    unique : distinguishes it from every other drive, "" where not reported; firmware likewise
    remarks : what is wrong; notes : what is good to know; settings : {parameter: value} that its block needs and that
        differ from the defaults
    """

    family: str
    can_id: int
    position: float | None = None
    velocity: float | None = None
    torque: float | None = None
    current: float | None = None
    temperature: float | None = None
    voltage: float | None = None
    fault: str | None = ""
    enabled: bool | None = None
    unique: str = ""
    firmware: str = ""
    remarks: list = field(default_factory=list)
    notes: list = field(default_factory=list)
    settings: dict = field(default_factory=dict)
    block: str = ""


@dataclass(frozen=True)
class Query:
    """One frame to every id of a bus, which enables nothing, and how its answers are read.

    A frame that the queries of several families share (the same function, the same purpose) is sent once.

    frame : returns the frame for an id, or None for an id that this family cannot have; why : purpose, for the report
    answers : (received, can_ids, before) -> list of Answer. received : frames during this query; before : frames
        received before any query
    details : dialogue(answer) that asks one drive for more, and returns the Answer to report; None for nothing more
    """

    frame: Callable[[int], Frame | None]
    why: str
    answers: Callable[[list[Frame], list[int], list[Frame]], list[Answer]]
    details: Callable[[Answer], Dialogue] | None = None


@dataclass(frozen=True)
class StopQuery:
    """The frame that takes the torque of one drive away, and how the answer is read.

    frame : None for a drive that reports without being asked; read : (arbitration id, is extended, data) -> Answer, or
        None for another frame
    """

    frame: Frame | None
    read: Reader


@dataclass(frozen=True)
class Drive:
    """One actuator block of a family, and how the command `move` commands it.

    block : class; find : returns the model of a name, raises ValueError
    option : name of the option that selects it, as in "servo" for --servo, "" where the model's name decides; help : of
        that option
    movements : among torque, position and velocity, those that `move` can command; bounded : those whose torque the
        block's `limit` bounds
    settings : (movement, target, speed in rad/s, rise in s) -> parameters of the block
    wire : (block, movement, target, wave) wires its inputs; None: torque, stiffness and damping commands. wave :
        {"times", "values"} of the target

    A model has name, gear, rated, peak, torque_constant, and wire_torque, wire_velocity, wire_position, wire_stiffness,
    wire_damping: None or 0 where it has none.
    """

    block: type
    find: Callable[[str], Any]
    option: str = ""
    help: str = ""
    movements: tuple = ("torque", "position", "velocity")
    bounded: tuple = ("torque", "position", "velocity")
    settings: Callable[[str, float, float, float], dict] | None = None
    wire: Callable[[Any, str, float, dict], None] | None = None


@dataclass(frozen=True)
class Table:
    """Models for `blocks --actuators`. title : of the table; usage : the blocks that take these names, in words"""

    title: str
    usage: str
    models: dict


@dataclass(frozen=True)
class Node:
    """Sensors on CAN that follow SAE J1939.

    manufacturer : in their NAME; groups : {parameter group: what it measures}; options : {option: (parameter, help)} of
        the command `stream`, where a parameter of truth makes an option that switches it off
    channels : (block) -> names of the outputs to show; set_up : (block) -> frames that set the unit up
    silent : what to do where a unit does not return its settings
    """

    block: type
    name: str
    manufacturer: int
    groups: dict
    options: dict
    channels: Callable[[Any], list[str]]
    set_up: Callable[[Any], list[Frame]]
    silent: str = ""


@dataclass(frozen=True)
class Chip:
    """A kind of chip on I2C.

    addresses : that it can have; registers : (register, {value: name}, mask) that identify it; name : where its
        addresses alone identify it
    block : class, None for a chip that is recognised but has no block
    """

    addresses: tuple
    registers: tuple = ()
    block: type | None = None
    name: str = ""

    @property
    def rig_name(self):
        return self.block.__name__.lower() if self.block is not None else ""


@dataclass(frozen=True)
class Benchmark:
    """A typical device of a family, with which `bench` and `rate` measure.

    block, emulator : classes; parameters : of both, as {"model": ...}
    stream : (samples, rate in Hz) -> bytes that the device sends on a serial line; parse : decodes them in Python
    """

    block: type
    emulator: type
    parameters: dict = field(default_factory=dict)
    stream: Callable[[int, float], bytes] | None = None
    parse: Callable[[bytes], Any] | None = None


@dataclass(frozen=True)
class Request:
    """What `configure` is asked to do with one drive.

    reads : names of parameters, "all" for every one; writes : texts NAME=VALUE; zero : the present position becomes 0
    protocol : name of another protocol, or None; new_id : or None; save : keep the settings without power
    """

    can_id: int
    reads: tuple = ()
    writes: tuple = ()
    zero: bool = False
    protocol: str | None = None
    new_id: int | None = None
    save: bool = False

    def other_than(self, *allowed: str) -> list[str]:
        """Return the options of this request that are not among `allowed`."""
        asked = {
            "--read": self.reads,
            "--write": self.writes,
            "--zero": self.zero,
            "--protocol": self.protocol,
            "--set-id": self.new_id,
            "--save": self.save,
        }
        return [name for name, value in asked.items() if value and name not in allowed]


class Family:
    """Base of a device family: subclass it, and name an instance as the entry point.

    name : in messages; drives : Drive; tables : Table; table_note : what the tables need to be read
    queries : Query, in the order of `scan`; nodes : Node; chips : Chip; sensors : classes on a line "dialogue"
    bus_hint : what else to check where a CAN bus is silent; vendor_program : what cannot be set up on the bus, and how
        else, "" for nothing; configure_note : for `configure --help`
    precedence : families with a higher one are asked first: their queries change nothing, and identify a drive for
        certain
    benchmark : Benchmark, or None
    """

    name: str = ""
    precedence: int = 0
    drives: tuple[Drive, ...] = ()
    tables: tuple[Table, ...] = ()
    table_note: str = ""
    queries: tuple[Query, ...] = ()
    nodes: tuple[Node, ...] = ()
    chips: tuple[Chip, ...] = ()
    sensors: tuple[type, ...] = ()
    bus_hint: str = ""
    vendor_program: str = ""
    configure_note: str = ""
    benchmark: Benchmark | None = None

    def recognises(self, text: str) -> bool:
        """Return whether a text begins as the name of this family does, or as one of its models: AK, RS."""
        models = [model for table in self.tables for model in table.models]
        names = [self.name, *(re.split(r"[\W\d]", model)[0] for model in models)]
        plain = re.sub(r"\W", "", str(text)).upper()
        return any(name and plain.startswith(name.upper()) for name in names)

    def reports(self, frames: list[Frame]) -> dict[int, Answer]:
        """Return {id: newest Answer} of the drives that report without being asked."""
        return {}

    def commanded(self, identifier: int, extended: bool, data: bytes) -> int | None:
        """Return the id of the drive that a frame of another controller commands; None for another frame."""
        return None

    def stop_queries(self, can_id: int, model: Any = None) -> tuple[StopQuery, ...]:
        """Return every StopQuery for an id, in the order to try them. model : None where it is not known"""
        return ()

    def stop_query(self, block: Any) -> StopQuery:
        """Return the StopQuery of a block of this family."""
        raise NotImplementedError

    def check(self, request: Request) -> None:
        """Raise Rejected for a Request that no drive of this family can carry out, before anything is sent."""
        refused = request.other_than("--zero")
        if refused:
            raise Rejected(f"{refused[0]}: a {self.name} drive cannot do that")

    def set_up(self, request: Request) -> Dialogue:
        """Dialogue that carries a Request out.

        Returns whether everything was confirmed, None where the id is no drive of this family. Raises Rejected.
        """
        return None
        yield
