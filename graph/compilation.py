"""The state of one compile, which its checks share."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from cext.user_text import text_of
from graph.diagnostics import Diagnostic
from graph.signal import Signal

if TYPE_CHECKING:
    import numpy as np

    from graph.block import Block
    from graph.diagnostics import Location
    from graph.diagram import Diagram
    from graph.interval import Interval
    from graph.schedule import Proof


class Compilation:
    """The state of one compile: properties of each block and signal, and the diagnostics."""

    def __init__(self, diagram: Diagram) -> None:
        self.diagram = diagram
        self.blocks = sorted(diagram, key=lambda block: block.path)
        self.diagnostics: list[Diagnostic] = []
        self.sources: dict[Any, Any] = {}  # (block, input name): Signal or constant array
        self.wires: dict[Any, Any] = {}  # (block, input name): Wire
        self.taps: dict[Any, Any] = {}  # sink: [(label, Signal)]
        self.shapes: dict[Any, Any] = {}  # (block, port name): shape
        self.units: dict[Any, str] = {}  # (block, port name): unit
        self.shared_units: dict[Any, str] = {}  # block: unit of its ports declared "any"
        self.ranges: dict[Any, Any] = {}  # Signal: Interval
        self.order: list[Any] = []
        self.holds: list[Any] = []  # (source path, its every, input path, its every) of signals held between rates
        self.loads: list[Any] = []  # BusLoad of each bus
        self.proofs: list[Proof] = []
        self.torque_bounds: dict[str, Any] = {}  # path of an actuator: TorqueBound, or None if its hook raised
        self.caveats: list[Any] = []  # graph.caveats.Caveat
        self.failed: set[Any] = set()  # (block, hook) that have raised

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
        """Call a hook of a block. An error of a value or a file is reported once, and None returned."""
        try:
            return hook(*arguments, **named)
        except (ValueError, ArithmeticError, OSError) as error:
            if (block, hook.__name__) not in self.failed:
                self.failed.add((block, hook.__name__))
                self.report("TW010", text_of(error), block)
        return None

    def wired_inputs(self) -> list[tuple[tuple[Block, str], np.ndarray | Signal]]:
        """Return ((block, input name), source) of every input, in the order of blocks and declarations."""
        return [((block, name), self.sources[block, name]) for block in self.blocks for name in block.inputs]

    def where(self, block: Block, name: str) -> Location:
        """Return where an input was connected, or where its block was made."""
        wire = self.wires.get((block, name))
        return wire.where if wire else block.location

    def origin(self, source: np.ndarray | Signal) -> str:
        """Return ' from PATH' for a signal, "" for a constant."""
        return f" from {source.path}" if isinstance(source, Signal) else ""
