"""Types of the guardian's plan and of its report, for type checkers only."""

from __future__ import annotations

from typing import Any, TypedDict

EncodedFrame = tuple[int, str]  # identifier with the flag bits of struct can_frame, data as hex digits
EncodedReply = tuple[int, int, str]  # identifier and mask with flag bits, hex digits of the first bytes
Frame = tuple[int, bytes]  # identifier with the flag bits of struct can_frame, data


class PlanBus(TypedDict):
    """CAN bus. `line` is the number of its line, None if the loop drives the bus itself."""

    name: str
    interface: str
    channel: str
    bitrate: int
    fd: bool
    data_bitrate: int  # of CAN FD in bit/s, 0 for none
    virtual: bool
    options: dict[str, Any]
    line: int | None


class PlanLock(TypedDict):
    """Lock of a bus: its file descriptor and name; the index of a CAN bus in the plan, else None.

    `handover` is the connection to the process from which the run has taken the bus over, else -1.
    """

    descriptor: int
    name: str
    bus: int | None
    handover: int


class PlanField(TypedDict):
    """Field of replies: the fields of graph.ReplyField."""

    frames: list[EncodedReply]
    first: int
    bits: int
    low: float
    high: float
    signed: bool
    little_endian: bool


class PlanDamp(TypedDict):
    """Damping: times in s, acceleration in rad/s², bands of (highest speed in rad/s or None, frames)."""

    duration: float
    round: float
    acceleration: float
    transit: float
    velocity: PlanField | None
    bands: list[tuple[float | None, list[EncodedFrame]]]


class PlanReply(TypedDict):
    """Replies by which a device confirms a safe stop: the fields of graph.StopReply."""

    frames: list[EncodedReply]
    unasked: list[EncodedReply]
    length: int
    torque: PlanField | None
    rest: float
    disabled: tuple[int, int]
    enabled: PlanField | None
    echo: tuple[int, ...]
    reports: bool


class PlanCap(TypedDict):
    """Cap of the torque, in N·m at the joint, and the fields of frames in that unit.

    accuracy : of the measurement; source : text that names who imposes it
    """

    torque: float
    accuracy: float
    source: str
    measured: PlanField | None
    commanded: PlanField | None


class PlanDevice(TypedDict):
    """Device. number : index in the schedule; bus : index in the plan; unanswered : disable frames without a reply"""

    name: str
    number: int
    bus: int
    zero: list[EncodedFrame]
    disable: list[EncodedFrame]
    damp: PlanDamp | None
    unanswered: int
    stop_reply: PlanReply | None
    cap: PlanCap | None


class PlanRelay(TypedDict):
    """Relay of a charge pump. descriptor : that of its line; frames : two frames in hex digits; hold : hold time, s"""

    descriptor: int
    gpio: bool
    frames: list[str]
    hold: float


class Plan(TypedDict):
    """Plan of a guardian, which can be encoded as JSON."""

    buses: list[PlanBus]
    devices: list[PlanDevice]
    relays: list[PlanRelay]
    locks: list[PlanLock]
    items: list[str]
    limit: float
    priority: int | None


class StopDamp(TypedDict):
    """PlanDamp with frames as bytes and an infinite speed in place of None."""

    duration: float
    round: float
    acceleration: float
    transit: float
    velocity: PlanField | None
    bands: list[tuple[float, list[Frame]]]


class StopDevice(TypedDict):
    """PlanDevice with frames as bytes."""

    name: str
    number: int
    bus: int
    zero: list[Frame]
    disable: list[Frame]
    damp: StopDamp | None
    unanswered: int
    stop_reply: PlanReply | None
    cap: PlanCap | None


class StopReport(TypedDict):
    """Result of a safe stop.

    confirmed, unconfirmed : names of devices; after : {name: s from the start to its confirmation}
    due : s, after which a confirmation is late; sent : frames; took : s
    """

    confirmed: list[str]
    unconfirmed: list[str]
    after: dict[str, float]
    due: float
    sent: int
    took: float
