"""Device families as plug-ins: one folder, and one object named by an entry point in the group `tickwork.families`.

The commands that commission devices (`scan`, `move`, `stream`, `configure`, `blocks --actuators`, `rate`) work with the
Family objects alone. Communication with a device is a dialogue (graph.dialogue) or a pure function of frames. A frame
is (arbitration id, is extended, data).
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from msgspec import Struct

from graph.dialogue import Dialogue, Frame, Reader, Rejected

ENTRY_POINTS = "tickwork.families"


@dataclass
class Answer:
    """State of one drive, from one reply while it has no torque. None and "" mark values that it does not report.

    family : name of the protocol; can_id : CAN id of the drive; block : class name of its block
    position : rad; velocity : rad/s; torque : N·m; current : A; temperature : °C; voltage : V
    fault : text of the fault, "" for no fault; enabled : whether the drive is enabled
    unique : identifier that no other drive has; firmware : version
    remarks : problems; notes : further information
    settings : {parameter: value} required by its block and different from the defaults
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
    remarks: list[str] = field(default_factory=list[str])
    notes: list[str] = field(default_factory=list[str])
    settings: dict[str, Any] = field(default_factory=dict[str, Any])
    block: str = ""


class Query(Struct, frozen=True):
    """A request frame to every id of a bus, which enables no drive, and the parser of its replies.

    A frame that the queries of several families share (the same function and purpose) is sent once.

    frame : returns the frame for an id, or None for an id outside the range of this family
    why : purpose, for the report
    answers : (received, can_ids, before) -> list of Answer. received : frames during this query; before : frames
        received before the first query
    details : dialogue(answer) that requests further data of one drive and returns the Answer to report, or None
    """

    frame: Callable[[int], Frame | None]
    why: str
    answers: Callable[[list[Frame], list[int], list[Frame]], list[Answer]]
    details: Callable[[Answer], Dialogue] | None = None


class StopQuery(Struct, frozen=True):
    """The frame that removes the torque of one drive, and the parser of its reply.

    frame : None for a drive that reports without a request; read : (arbitration id, is extended, data) -> Answer, or
        None for another frame
    """

    frame: Frame | None
    read: Reader


class Drive(Struct, frozen=True):
    """One actuator block of a family, and its use by the command `move`.

    block : class; find : returns the model of a name, raises ValueError
    option : name of the option that selects it, as in "servo" for --servo, "" if the model's name selects it
    help : help text of that option
    endings : further words at the end of a name that select it, as in "MODEL mit"
    movements : those of torque, position and velocity that `move` can command
    bounded : the movements whose torque the block's `limit` bounds
    settings : (movement, target, speed in rad/s, rise in s) -> parameters of the block
    wire : (block, movement, target, wave) wires its inputs; None: torque, stiffness and damping commands. wave :
        {"times", "values"} of the target

    A model has name, gear, rated, peak, torque_constant, and wire_torque, wire_velocity, wire_position, wire_stiffness,
    wire_damping; None or 0 for a quantity that it does not have.
    """

    block: type[Any]
    find: Callable[[str], Any]
    option: str = ""
    help: str = ""
    movements: tuple[str, ...] = ("torque", "position", "velocity")
    bounded: tuple[str, ...] = ("torque", "position", "velocity")
    settings: Callable[[str, float, float, float], dict[str, Any]] | None = None
    wire: Callable[[Any, str, float, dict[str, Any]], None] | None = None
    endings: tuple[str, ...] = ()


class Table(Struct, frozen=True):
    """Models for `blocks --actuators`. title : heading; usage : text that lists the blocks that accept these names"""

    title: str
    usage: str
    models: dict[str, Any]


class Node(Struct, frozen=True):
    """Sensors on CAN that follow SAE J1939.

    manufacturer : code in the NAME; groups : {parameter group: measured quantity}
    options : {option: (parameter, help)} of the command `stream`; the option of a bool parameter sets it to False
    channels : (block) -> names of the outputs to show; set_up : (block) -> frames that configure the unit
    silent : remedy if a unit does not return its settings
    """

    block: type[Any]
    name: str
    manufacturer: int
    groups: dict[int, str]
    options: dict[str, tuple[str, str]]
    channels: Callable[[Any], list[str]]
    set_up: Callable[[Any], list[Frame]]
    silent: str = ""


class Chip(Struct, frozen=True):
    """A type of chip on I2C.

    addresses : possible addresses; registers : (register, {value: name}, mask) that identify it
    name : name of a chip that its address identifies
    block : class, None for a chip that is recognised but has no block
    """

    addresses: tuple[int, ...]
    registers: tuple[int, dict[int, str], int] | tuple[()] = ()
    block: type[Any] | None = None
    name: str = ""

    @property
    def rig_name(self) -> str:
        """Name of the block in lower case, "" without a block."""
        return self.block.__name__.lower() if self.block is not None else ""


class Benchmark(Struct, frozen=True):
    """A typical device of a family, for measurements by `bench` and `rate`.

    block, emulator : classes; parameters : parameters of both classes, such as {"model": ...}
    stream : (samples, rate in Hz) -> bytes that the device sends on a serial line; parse : decodes them in Python
    """

    block: type[Any]
    emulator: type[Any]
    parameters: dict[str, Any] = {}
    stream: Callable[[int, float], bytes] | None = None
    parse: Callable[[bytes], Any] | None = None


class Request(Struct, frozen=True):
    """Changes to one drive that `configure` requests.

    reads : names of parameters, "all" for all of them; writes : texts NAME=VALUE
    zero : set the present position to 0; protocol : name of the new protocol, or None; new_id : new CAN id, or None
    save : store the settings in non-volatile memory
    """

    can_id: int
    reads: tuple[str, ...] = ()
    writes: tuple[str, ...] = ()
    zero: bool = False
    protocol: str | None = None
    new_id: int | None = None
    save: bool = False

    def other_than(self, *allowed: str) -> list[str]:
        """Return the options of this request that are not among `allowed`."""
        asked: dict[str, object] = {
            "--read": self.reads,
            "--write": self.writes,
            "--zero": self.zero,
            "--protocol": self.protocol,
            "--set-id": self.new_id,
            "--save": self.save,
        }
        return [name for name, value in asked.items() if value and name not in allowed]


class Family:
    """Base class of a device family. An entry point names an instance of a subclass.

    name : name in messages; drives : Drives; tables : Tables; table_note : text below the tables
    queries : Queries, in the order of `scan`; nodes : Nodes; chips : Chips
    sensors : block classes on a line of kind "dialogue"
    bus_hint : further check to suggest if a CAN bus is silent
    vendor_program : settings that need the vendor's program, "" for none; configure_note : text in `configure --help`
    precedence : families with a higher one are queried first: their queries only read, and identify a drive reliably
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
    sensors: tuple[type[Any], ...] = ()
    bus_hint: str = ""
    vendor_program: str = ""
    configure_note: str = ""
    benchmark: Benchmark | None = None

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if cls.drives and cls.stop_query is Family.stop_query:
            raise TypeError(f"{cls.__name__} has drives: define stop_query(self, block), which returns a StopQuery")

    def recognises(self, text: str) -> bool:
        """Return whether a text begins with the name of this family or the letters of one of its models: AK, RS."""
        models = [model for table in self.tables for model in table.models]
        names = [self.name, *(re.split(r"[\W\d]", model)[0] for model in models)]
        plain = re.sub(r"\W", "", str(text)).upper()
        return any(name and plain.startswith(name.upper()) for name in names)

    def reports(self, received: list[Frame]) -> dict[int, Answer]:
        """Return {id: newest Answer} of the drives that report without a request."""
        return {}

    def commanded(self, identifier: int, extended: bool, data: bytes) -> int | None:
        """Return the id of the drive that a frame of another controller commands; None for another frame."""
        return None

    def stop_queries(self, can_id: int, model: Any = None) -> tuple[StopQuery, ...]:
        """Return every StopQuery for an id, in the order of attempts. model : None if it is not known"""
        return ()

    def stop_query(self, block: Any) -> StopQuery:
        """Return the StopQuery of a block of this family. A family with drives defines it."""
        raise TypeError(f"{type(block).__name__} is not a drive of the device family {self.name}")

    def identity(self, block: Any) -> Dialogue | None:
        """Return a dialogue that returns {serial number: firmware} of the units that respond as a block of this family.

        The firmware is "" where it is not reported. None if the protocol reports no serial number. It enables no drive.
        """
        return None

    def check(self, request: Request) -> None:
        """Raise Rejected for a Request that no drive of this family supports. Sends nothing."""
        refused = request.other_than("--zero")
        if refused:
            raise Rejected(f"{refused[0]} is not supported by {self.name} drives")

    def set_up(self, request: Request) -> Dialogue:
        """Execute a Request: a dialogue (graph.dialogue).

        Returns whether the drive confirmed all changes, None if the id is not a drive of this family. Raises Rejected.
        """
        return None
        yield
