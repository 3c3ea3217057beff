"""The state of one compile, which its checks share."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from cext.user_text import repr_of, text_of
from graph.block import are_ranges
from graph.device import Device
from graph.diagnostics import Diagnostic
from graph.narrowing import is_table, is_tuple
from graph.signal import Signal

if TYPE_CHECKING:
    import numpy as np

    from graph.block import Block, Sink
    from graph.budget import BusLoad
    from graph.caveats import Caveat
    from graph.device import Actuator
    from graph.device_data import Caps, TorqueBound
    from graph.diagnostics import Location
    from graph.diagram import Diagram, Wire
    from graph.interval import Interval
    from graph.schedule import Proof
    from graph.upstream import Sources


RANGES = are_ranges, "an Interval, or a dict of them by name of an output"
RESULTS: dict[str, tuple[Callable[[Any], bool], str]] = {  # of hooks: (whether a result is valid, what is)
    "output_range": RANGES,
    "start_range": RANGES,
    "output_units": (lambda result: result is None or is_table(result), "a dict of units by name of an output"),
    "instability": (lambda result: result is None or is_tuple(result) and len(result) == 2, "(reason, remedy) or None"),
}
ANYTHING: tuple[Callable[[Any], bool], str] = (lambda _: True), ""


class Compilation:
    """The state of one compile: properties of each block and signal, and the diagnostics."""

    def __init__(self, diagram: Diagram) -> None:
        self.diagram = diagram
        self.blocks: list[Block] = sorted(diagram, key=lambda block: block.path)
        self.devices = [block for block in self.blocks if isinstance(block, Device)]
        self.diagnostics: list[Diagnostic] = []
        self.sources: Sources = {}
        self.wires: dict[tuple[Block, str], Wire] = {}  # by input
        self.taps: dict[Sink, list[tuple[str, Signal]]] = {}  # (label, Signal) of sinks for any number of signals
        self.shapes: dict[tuple[Block, str], tuple[int, ...]] = {}  # by port
        self.units: dict[tuple[Block, str], str] = {}  # by port
        self.shared_units: dict[Block, str] = {}  # of the ports declared "any" of a block
        self.ranges: dict[Signal, Interval] = {}
        self.order: list[Block] = []
        self.holds: list[tuple[str, int, str, int]] = []  # (source, its every, input, its every) where rates meet
        self.loads: list[BusLoad] = []
        self.proofs: list[Proof] = []
        self.torque_bounds: dict[str, TorqueBound | None] = {}  # by path of an actuator; None if its hook raised
        self.caveats: list[Caveat] = []
        self.caps: dict[Actuator, Caps] = {}  # of the actuators that have any
        self.failed: set[tuple[Block, str]] = set()  # (block, hook) that have raised

    def report(
        self,
        code: str,
        message: str,
        block: Any = None,
        port: str | None = "",
        where: Location | None = None,
        hint: str = "",
        severity: str = "error",
    ) -> None:
        """Add a diagnostic, at `where` or at the line that made the block."""
        place = where or (block.location if block is not None else None)
        path = block.path if block is not None else ""
        self.diagnostics.append(Diagnostic(code, message, path, port or "", place, hint, severity))

    @property
    def errors(self) -> list[Diagnostic]:
        """Diagnostics with severity "error", in the order of the user's lines."""
        errors = [d for d in self.diagnostics if d.severity == "error"]
        return sorted(errors, key=lambda d: (d.where.file, d.where.line) if d.where else ("", 0))

    def attempt(
        self, block: Block, hook: Callable[..., Any], /, *arguments: float | dict[str, Interval], **named: Interval
    ) -> Any:
        """Call a hook of a block, and return its result.

        Returns None for an error of a value or a file, for a hook that does not take the arguments, and for a result of
        another type. Each is reported once.
        """
        name = hook.__name__ if hasattr(hook, "__name__") else repr_of(hook)
        try:
            result = hook(*arguments, **named)
            is_valid, words = RESULTS.get(name, ANYTHING)
            if is_valid(result):
                return result
            problem = f"{name} returned {repr_of(result)}, and must return {words}"
        except (ValueError, ArithmeticError, OSError) as error:
            problem = text_of(error)
        except TypeError as error:
            if error.__traceback__ is None or error.__traceback__.tb_next is not None:
                raise  # within the hook, whose line is reported
            problem = text_of(error)
        if (block, name) not in self.failed:
            self.failed.add((block, name))
            self.report("TW010", problem, block)
        return None

    def wired_inputs(self) -> list[tuple[tuple[Block, str], np.ndarray | Signal]]:
        """Return ((block, input name), source) of every input, in the order of blocks and declarations."""
        return [((block, name), self.sources[block, name]) for block in self.blocks for name in block.inputs]

    def where(self, block: Block, name: str) -> Location | None:
        """Return where an input was connected, or where its block was made."""
        wire = self.wires.get((block, name))
        return wire.where if wire else block.location

    def origin(self, source: np.ndarray | Signal) -> str:
        """Return ' from PATH' for a signal, "" for a constant."""
        return f" from {source.path}" if isinstance(source, Signal) else ""
