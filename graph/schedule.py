"""The result of a compile: an arena, steps in order, devices, what is recorded. Data only; `cext` runs it."""

from dataclasses import dataclass, field

import numpy as np

from graph.arena_layout import KernelTable
from graph.device import DampedStop
from graph.interval import Interval


@dataclass(frozen=True)
class Step:
    """One call of a tick. Native: kernel and table. Python: function, inputs as (name, slot, dtype, shape), outputs
    with (low, high) behind.
    """

    name: str
    every: int = 1
    conditions: tuple = ()  # slots that must all be true
    kernel: object = None
    table: KernelTable = KernelTable()
    function: object = None
    inputs: tuple = ()
    outputs: tuple = ()
    hold: int = 0  # exceptions in a row that are no fault


@dataclass(frozen=True)
class WatchSteps:
    """What is watched over an actuator, and where it finds its things: slots, -1 for what there is none of.

    felt : where the kernel reads what is left of its limit; full : what stands there when nothing is taken
    law : first of five: what the last frame carried; gains : where the kernel reads the share of stiffness and damping
    """

    watch: object  # graph.device.Watch
    torque: int
    temperature: int
    rms: int
    felt: int
    full: float
    position: int = -1
    velocity: int = -1
    stiffness: int = -1
    damping: int = -1
    law: int = -1
    current: int = -1
    gains: int = -1


@dataclass(frozen=True)
class DeviceSteps:
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
    enable: tuple
    zero: tuple
    disable: tuple
    damp: DampedStop | None = None  # what a safe stop begins with, in place of zero and disable
    unanswered: int = 0  # of the frames of disable
    relay_time: float = 0.0  # s without a frame after which its relay drops; 0: it holds none
    start_time: float = 0.0  # s of arming in which others are sent nothing
    watch: WatchSteps | None = None
    warning: int = -1  # slot of what it warns of, bit by bit
    warnings: tuple = ()  # words for each bit
    reads: tuple = ()  # those of `enable` that read and change nothing
    ready: int = -1  # slot that is not 0 once it has read back what arming wrote; -1: nothing is read back
    ready_size: int = 0  # numbers from there on that outlive the start of the blocks


@dataclass(frozen=True)
class SignalPlace:
    """Where a signal lies in the arena, and what it is."""

    path: str
    slot: int
    shape: tuple
    dtype: str
    unit: str
    circle: tuple = ()  # the two ends that are one, of a value that goes round

    @property
    def size(self):
        return int(np.prod(self.shape))


@dataclass(frozen=True)
class Column:
    """One recorded number: its place in the row, and its header."""

    index: int
    path: str
    dtype: str
    unit: str
    circle: tuple = ()


@dataclass(frozen=True)
class SinkColumns:
    """A recorder or viewer, and the columns it takes."""

    block: object
    columns: tuple


@dataclass(frozen=True)
class LiveParameter:
    """A parameter that may change while running: its slot in the arena (-1: it has none), its block if it is a Python
    block's attribute.
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
    slew: float  # unit per second, infinite where it steps


@dataclass(frozen=True)
class Proof:
    """What is known of one command of one actuator before anything moves."""

    path: str
    port: str
    unit: str
    interval: Interval
    limit: Interval
    bounded_by: str  # path of the block that bounds it

    @property
    def holds(self):
        return self.interval in self.limit


@dataclass
class Schedule:
    """A compiled diagram: arena, steps in order, devices, recorded signals, proofs and warnings."""

    name: str
    rate: float
    arena: np.ndarray
    memory_start: int  # slot where the memory of blocks begins: from here on the arena is state
    look: list  # a pass over what settling needs, on the present measurement, each block settled before its output
    settle: list  # the settle steps of that pass alone
    output: list
    update: list
    devices: list
    buses: list
    media: list  # of each bus: graph.Device.medium of what is on it
    signals: dict  # path: SignalPlace
    columns: np.ndarray  # slots of the recorded numbers
    recorded: list  # Column of each of them, by the path of its signal
    sinks: list
    python_blocks: list
    inputs: dict  # path: {input name: slot}, scalars only
    parameters: dict  # "left/impedance.stiffness": slot, native blocks only
    items: dict  # path: {name: (slot, length)} of ports, parameters and memory, native blocks only
    live: list = field(default_factory=list)  # LiveParameter, by path
    proofs: list = field(default_factory=list)
    loads: list = field(default_factory=list)  # graph.budget.BusLoad, one a bus
    holds: list = field(default_factory=list)  # (source, its every, input, its every) where rates meet
    warnings: list = field(default_factory=list)

    @property
    def gil_sections(self):
        """How often a tick takes the GIL."""
        count, python = 0, False
        for phase in (self.output, self.update):
            python = False
            for step in phase:
                now = step.kernel is None
                count += now and not python
                python = now
        return count
