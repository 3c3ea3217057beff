"""Result of a compile, as data: arena, steps in order, devices, recorded signals. `cext` executes it."""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import numpy as np
from msgspec import Struct

from cext.rules import LiveRule, Side
from graph.arena_layout import KernelTable
from graph.budget import BusLoad
from graph.caveats import Caveat
from graph.device_data import Caps, DampedStop, Frame, ReplyField, StopReply, TorqueBound, Watch, Zeroing
from graph.diagnostics import Diagnostic
from graph.interval import Interval

Shape: TypeAlias = tuple[int, ...]


class Step(Struct, frozen=True):
    """One call in a tick: a kernel with its table, or a Python function.

    inputs : (name, slot, dtype, shape) of each argument; outputs : (name, slot, dtype, shape, low, high) of each result
    """

    name: str
    every: int = 1
    conditions: tuple[int, ...] = ()  # slots that must all be true
    kernel: object = None
    table: KernelTable = KernelTable()
    function: object = None
    inputs: tuple[tuple[str, int, str, Shape], ...] = ()
    outputs: tuple[tuple[str, int, str, Shape, float, float], ...] = ()
    hold: int = 0  # consecutive exceptions that are not a fault
    allowance: float = 0.0  # s that it may take beyond the limits of watchdog and guardian
    repeat: int = 0  # slot: while it is not 0, the consecutive steps with it run again; 0: once


class WatchSteps(Struct, frozen=True):
    """The Watch of an actuator and the slots that it uses, -1 for a quantity that the actuator does not have.

    law_limit : slot of the remaining torque limit, read by the kernel; full : its initial value, N·m
    law : first of five slots with the command of the last frame
    gains : slot of the allowed share of stiffness and damping, read by the kernel
    """

    watch: Watch
    torque: int
    temperature: int
    rms: int
    law_limit: int
    full: float
    position: int = -1
    velocity: int = -1
    stiffness: int = -1
    damping: int = -1
    law: int = -1
    current: int = -1
    gains: int = -1


class ZeroSteps(Struct, frozen=True):
    """The Zeroing of an actuator and the slots that it uses, -1 for a quantity that the actuator does not have.

    request : slot of the input `zero`
    law : first of five slots with the command of the last frame; current : slot of a sent current
    """

    zeroing: Zeroing
    position: int
    request: int
    law: int
    current: int


class DeviceSteps(Struct, frozen=True):
    """A device: its two kernels with their tables, and the frames of arming and of the safe stop."""

    name: str
    bus: int
    decode: object
    encode: object
    decode_table: KernelTable
    encode_table: KernelTable
    age: int
    fault: int
    timeout: float
    ask: tuple[Frame, ...]  # with replies, before it is enabled
    set_up: tuple[Frame, ...]
    enable: tuple[Frame, ...]
    zero: tuple[Frame, ...]
    disable: tuple[Frame, ...]
    damp: DampedStop | None = None  # first part of a safe stop, instead of zero and disable
    stop_reply: StopReply | None = None  # by which it confirms a safe stop
    unanswered: int = 0  # number of disable frames without a reply
    relay_time: float = 0.0  # s without a frame after which its relay opens; 0: it has no relay
    start_time: float = 0.0  # s at the beginning of arming during which no other device receives a frame
    watch: WatchSteps | None = None
    warning: int = -1  # slot of the warning bits
    warnings: tuple[str, ...] = ()  # text of each bit
    reads: tuple[Frame, ...] = ()  # frames of `set_up` that only read
    reports_enabled: bool = False  # whether its replies contain whether it is enabled
    ready: int = -1  # slot that is not 0 after the settings are confirmed; -1: no confirmation
    ready_size: int = 0  # numbers from there on that keep their value when the blocks are reset
    disabled_slot: int = -1  # of the parameter, the input and the output of a drive that can be taken out
    disable_slot: int = -1
    active_slot: int = -1
    zeroing: ZeroSteps | None = None  # None for a device without a zero that can be set
    answers: bool = False  # whether it answers each command with one frame
    transit: int = -1  # slot of the longest transit, and of the time that `age` does not contain, s; -1: none
    max_transit: float = 0.0  # s from a command to its reply up to which it has stiffness and damping
    restart_time: float = 0.0  # s of silence in which it may restart and obey again without an enable; 0: none
    report_period: float = 0.0  # s between its reports if it does not answer commands
    cap: Caps | None = None  # of the diagram, for a reader of its frames
    commanded: ReplyField | None = None  # torque in its command frames
    set_up_replies: int = 0  # replies with a sample to its set-up frames


class SignalPlace(Struct, frozen=True):
    """A signal and its slot in the arena."""

    path: str
    slot: int
    shape: Shape
    dtype: str
    unit: str
    circle: tuple[float, ...] = ()  # the two equal ends of a periodic value

    @property
    def size(self) -> int:
        """Number of elements."""
        return math.prod(self.shape)


class Column(Struct, frozen=True):
    """One recorded number: its index in the row, its header, and the ticks from one recorded sample to the next."""

    index: int
    path: str
    dtype: str
    unit: str
    circle: tuple[float, ...] = ()
    every: int = 1


class SinkColumns(Struct, frozen=True):
    """A recorder or viewer, and its columns."""

    block: Any  # a graph.block.Sink
    columns: tuple[Column, ...]


class LiveParameter(Struct, frozen=True):
    """A parameter that may change while running.

    slot : index in the arena, -1 for none; block : the Python block with this attribute, or None
    """

    path: str  # "left/impedance.stiffness"
    slot: int
    block: object
    name: str
    dtype: str
    unit: str
    description: str
    built: float
    low: float
    high: float
    slew: float  # unit per second, infinite for a step


class HeldBound(Struct, frozen=True):
    """Numbers in the arena that a block keeps while it does not run. low, high : bounds, as the sides of a LiveRule"""

    slot: int
    size: int
    low: Side
    high: Side


class Proof(Struct, frozen=True):
    """Proved interval of a command of an actuator, and its limit."""

    path: str
    port: str
    unit: str
    interval: Interval
    limit: Interval
    bounded_by: str  # path of the block that bounds it

    @property
    def holds(self) -> bool:
        """Whether the interval is inside the limit."""
        return self.interval in self.limit


class Schedule(Struct):
    """A compiled diagram: arena, steps in order, devices, recorded signals, proofs and warnings."""

    name: str
    rate: float
    arena: np.ndarray
    held_start: int  # first slot of the outputs of conditional blocks, up to memory_start
    memory_start: int  # first slot of the memory of blocks: the arena is state from here on
    look: list[Step]  # steps that settle the blocks on the present measurement, each settle step before its output step
    settle: list[Step]  # the settle steps of `look`
    output: list[Step]
    update: list[Step]
    devices: list[DeviceSteps]
    buses: list[str]
    media: list[str]  # graph.Device.medium of each bus
    signals: dict[str, SignalPlace]  # by path
    columns: np.ndarray  # slots of the recorded numbers
    recorded: list[Column]  # one for each of them, by the path of its signal
    sinks: list[SinkColumns]
    python_blocks: list[Any]  # of Block, whose module imports this one
    inputs: dict[str, dict[str, int]]  # path: {input name: slot}, scalars only
    parameters: dict[str, int]  # "left/impedance.stiffness": slot, native blocks only
    items: dict[str, dict[str, tuple[int, int]]]  # path: {port, parameter, memory: (slot, length)}, native blocks only
    live: list[LiveParameter] = []  # by path
    live_rules: list[LiveRule] = []
    held_bounds: list[HeldBound] = []
    proofs: list[Proof] = []
    torque_bounds: dict[str, TorqueBound | None] = {}  # by path of an actuator
    caveats: list[Caveat] = []  # of each torque limit that may not hold
    loads: list[BusLoad] = []  # one a bus
    holds: list[tuple[str, int, str, int]] = []  # (source, its every, input, its every) where rates meet
    warnings: list[Diagnostic] = []

    @property
    def allowance(self) -> float:
        """Time in s that a tick may take beyond the limits of watchdog and guardian, in all its steps together."""
        return sum(step.allowance for step in self.output)

    @property
    def gil_sections(self) -> int:
        """Number of GIL acquisitions in a tick."""
        count, python = 0, False
        for phase in (self.output, self.update):
            python = False
            for step in phase:
                now = step.kernel is None
                count += now and not python
                python = now
        return count
