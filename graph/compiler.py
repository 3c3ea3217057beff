"""Compilation of a diagram to a schedule: named checks, then a topological sort, then the layout of the arena.

Every check appends its diagnostics to one list, and all errors are raised together.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from cext.user_text import text_of
from graph import hints, units
from graph.arena_layout import size_of
from graph.assembly import assemble
from graph.block import Sink
from graph.budget import bus_loads, line_loads
from graph.device import Actuator, Device
from graph.diagnostics import Diagnostic, DiagramError, Location
from graph.diagram import Diagram
from graph.inference import infer_shapes, infer_units
from graph.names import check_name, suggestion
from graph.order import cluster, computes, dependencies, take_out_loops
from graph.ranges import find_ranges, interval_of
from graph.reach import ReachCheck
from graph.schedule import Proof, Schedule
from graph.signal import Signal

if TYPE_CHECKING:
    from graph.block import Block
    from graph.interval import Interval

NARROW_TO_WIDE = ("bool", "int", "float")  # each holds the ones before it


def compile(diagram: Diagram) -> Schedule:
    """Check and sort a diagram, and place its signals in an arena.

    Raises DiagramError with every problem that the checks find.
    """
    with uncollected():
        compilation = examine(diagram)
        if compilation.errors:
            raise DiagramError(compilation.errors)
        return assemble(compilation)


@contextmanager
def uncollected() -> Iterator[None]:
    """Pause garbage collection: a compile creates no cycles to collect, and each pass would visit all its objects."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()


def examine(diagram: Diagram) -> Compilation:
    """Check and sort a diagram. Returns the Compilation, whose `diagnostics` list the problems; raises none of them."""
    compilation = Compilation(diagram)
    for check in (
        compilation.check_names,
        compilation.check_parameters,
        compilation.check_wires,
        compilation.compile_marked,
        compilation.check_steps,
        compilation.check_dtypes,
        compilation.check_shapes,
        compilation.check_units,
        compilation.check_actuators,
        compilation.check_effects,
        compilation.check_heat,
        compilation.check_relays,
        compilation.check_timeouts,
        compilation.check_addresses,
        compilation.check_bitrates,
        compilation.check_lines,
        compilation.check_buses,
        compilation.check_rates,
        compilation.sort,
        compilation.prepare,
        compilation.prove,
        compilation.check_reach,
        compilation.check_use,
    ):
        check()
    return compilation


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
        """Call a hook of a block. A ValueError or OSError is reported once, and None returned."""
        try:
            return hook(*arguments, **named)
        except (ValueError, OSError) as error:
            if (block, hook.__name__) not in self.failed:
                self.failed.add((block, hook.__name__))
                self.report("TW010", text_of(error), block)
        return None

    # Wires

    def check_names(self) -> None:
        """Report names that are used twice, subsystems that were not entered, and invalid names of buses."""
        for part in self.diagram.not_entered:
            self.report(
                "TW019",
                f"subsystem({part.name!r}) contains no blocks, since no `with` enters it",
                where=part.where,
                hint=f"write `with subsystem({part.name!r}):`, and indent its blocks",
            )
        for wanted, block in self.diagram.duplicates:
            first = self.diagram[wanted]
            self.report(
                "TW009",
                f"the name is already used by the block made at {first.location}",
                block,
                hint="choose a different `name=`",
            )
        for block in self.blocks:
            if isinstance(block, Device) and block.bus not in ("", block.path):
                try:
                    # a line has the path of its device
                    for part in block.bus.split("/") if block.medium == "stream" else [block.bus]:
                        check_name(part, block.location)
                except DiagramError as error:
                    [wrong] = error.diagnostics
                    self.report("TW010", f"its bus: {wrong.message}", block, "", block.location, wrong.hint)

    def check_parameters(self) -> None:
        """Adopt parameters that were assigned; report those that are not valid, and misspelt ones."""
        for block in self.blocks:
            try:
                block.adopt_assigned()
            except DiagramError as error:
                self.diagnostics += error.diagnostics
            for name in block.assigned_names():
                if hint := suggestion(name, block.parameters):
                    self.report("TW010", f"has no parameter {name!r}", block, hint=hint)

    def check_wires(self) -> None:
        """Find the source of each input; report inputs that are connected twice, or not at all."""
        for wire in self.diagram.wires:
            if wire.block.variadic:
                label = wire.port or wire.source.path
                self.taps.setdefault(wire.block, []).append((label, wire.source))
                continue
            key = (wire.block, wire.port)
            if key in self.sources:
                self.report(
                    "TW004",
                    f"is already wired at {self.wires[key].where}",
                    wire.block,
                    wire.port,
                    wire.where,
                    "connect one signal to an input: add the two with a Sum, or select one with a Switch",
                )
                continue
            self.sources[key] = wire.source if isinstance(wire.source, Signal) else np.asarray(wire.source, dtype=float)
            self.wires[key] = wire
        for block in self.blocks:
            for name, port in block.inputs.items():
                if isinstance(block, Sink) and isinstance(self.sources.get((block, name)), Signal):
                    self.taps.setdefault(block, []).append((name, self.sources[block, name]))
                if (block, name) in self.sources:
                    continue
                if port.default is None:
                    self.report(
                        "TW001",
                        f"the input is not connected and has no default [{port.unit}]",
                        block,
                        name,
                        hint=hints.for_assignment(block)
                        or hints.for_attribute(block)
                        or f"wire it, as in {block.path.split('/')[-1]}({name}=...)",
                    )
                self.sources[block, name] = np.asarray(0.0 if port.default is None else port.default, dtype=float)

    def compile_marked(self) -> None:
        """Compile the Python blocks with `jit = True` to kernels, if Numba is installed."""
        marked = [block for block in self.blocks if block.jit and block.is_python and not block.hold_exceptions]
        if not marked:
            return
        from graph import jit

        for block in marked:
            if not jit.available():
                self.report(
                    "TW023",
                    "runs in Python because Numba is not installed",
                    block,
                    hint="pip install 'tickwork[jit]'",
                    severity="warning",
                )
                continue
            try:
                jit.compile_block(block)
            except jit.CannotCompile as error:
                self.report("TW017", str(error), block, hint="use numbers only, or remove `jit = True`")

    def check_steps(self) -> None:
        """Report blocks without a step or a kernel."""
        for block in self.blocks:
            works = computes(block) or block.update_kernel is not None or block.has_python_update and not block.outputs
            if not works and not isinstance(block, (Device, Sink)):
                self.report(
                    "TW015",
                    f"{type(block).__name__} has neither a step nor a kernel",
                    block,
                    hint=f"define step(self, {', '.join(block.inputs)})" if block.inputs else "define step(self)",
                )

    # Types, shapes and units: the same at both ends of a wire

    def check_dtypes(self) -> None:
        """Check the dtype of each wire: bool converts to int and int to float, but not the reverse.

        A signal with the unit "any" may have any dtype.
        """
        for (block, name), source in self.wired_inputs():
            wanted = block.inputs[name].dtype
            if isinstance(source, Signal):
                declared = source.declaration
                fits = (
                    NARROW_TO_WIDE.index(declared.dtype) <= NARROW_TO_WIDE.index(wanted) or declared.unit == units.ANY
                )
                got = f"{declared.dtype}{self.origin(source)}"
            else:
                fits = wanted == "float" or np.all(
                    np.isin(source, (0, 1)) if wanted == "bool" else np.isfinite(source) & (source == np.rint(source))
                )
                got = f"{source}"
            if not fits:
                self.report(
                    "TW008",
                    f"expected {wanted}, got {got}",
                    block,
                    name,
                    self.where(block, name),
                    'compare it with a threshold, as in Compare(">")(signal, 0.5)'
                    if wanted == "bool"
                    else "insert a Round",
                )

    def check_shapes(self) -> None:
        """Infer the shape of each port, and report connections between different shapes."""
        self.shapes = infer_shapes(self.blocks, self.sources)
        for (block, name), source in self.wired_inputs():
            wanted = self.shapes[block, name]
            got = self.shapes[source.block, source.port] if isinstance(source, Signal) else source.shape
            scalar_constant = not isinstance(source, Signal) and got == ()
            if wanted != got and not scalar_constant:
                self.report(
                    "TW003",
                    f"expected shape {wanted}, got {got}{self.origin(source)}",
                    block,
                    name,
                    self.where(block, name),
                )

    def check_units(self) -> None:
        """Infer the unit of each port, and report connections between different units."""
        self.units, shared = self.units, self.shared_units = infer_units(self.blocks, self.sources, self.attempt)
        for (block, name), source in self.wired_inputs():
            unit = block.inputs[name].unit
            if unit == units.ANY:
                unit = units.ANY if name in block.free_units else shared.get(block, units.ANY)
            got = self.units[source.block, source.port] if isinstance(source, Signal) else units.ANY
            if units.ANY not in (unit, got) and unit != got:
                self.report(
                    "TW002",
                    f"expected {unit}, got {got}{self.origin(source)}",
                    block,
                    name,
                    self.where(block, name),
                    self.unit_hint(got, unit) or hints.for_factor(source, got, unit),
                )

    def wired_inputs(self) -> list[tuple[tuple[Block, str], np.ndarray | Signal]]:
        """Return ((block, input name), source) of every input, in the order of blocks and declarations."""
        return [((block, name), self.sources[block, name]) for block in self.blocks for name in block.inputs]

    def unit_hint(self, got: str, wanted: str) -> str:
        """Return how to convert one unit to another explicitly; "" if that is impossible."""
        try:
            units.conversion(got, wanted)
        except ValueError:
            return ""
        return f"units are not converted implicitly: connect signal.to({wanted!r})"

    def where(self, block: Block, name: str) -> Location:
        """Return where an input was connected, or where its block was made."""
        wire = self.wires.get((block, name))
        return wire.where if wire else block.location

    def origin(self, source: np.ndarray | Signal) -> str:
        """Return ' from PATH' for a signal, "" for a constant."""
        return f" from {source.path}" if isinstance(source, Signal) else ""

    # Devices

    def check_actuators(self) -> None:
        """Report actuators without a connected command."""
        for block in self.blocks:
            if isinstance(block, Actuator) and block.inputs and not any((block, n) in self.wires for n in block.inputs):
                self.report(
                    "TW005",
                    f"none of its commands is connected ({', '.join(block.inputs)})",
                    block,
                    hint=hints.for_assignment(block)
                    or f"connect one, as in {block.path.split('/')[-1]}({hints.usual_command(block)}=...), or "
                    "remove the actuator",
                )

    def check_effects(self) -> None:
        """Warn of a position or velocity command whose gain, the stiffness or the damping, is 0."""
        for block in self.blocks:
            if not isinstance(block, Actuator):
                continue
            for name, gain in (("position_command", "stiffness_command"), ("velocity_command", "damping_command")):
                if gain in block.inputs and self.is_zero(block, gain) and not self.is_zero(block, name):
                    self.report(
                        "TW027",
                        f"the command has no effect, because {gain} is 0",
                        block,
                        name,
                        self.where(block, name),
                        f"connect it, as in {block.path.split('/')[-1]}({name}=..., {gain}=...)",
                        "warning",
                    )

    def is_zero(self, block: Block, name: str) -> bool:
        """Return whether an input is the constant 0."""
        source = self.sources.get((block, name))
        return source is not None and not isinstance(source, Signal) and not np.any(source)

    def check_heat(self) -> None:
        """Check that each actuator reports its temperature or has a thermal model."""
        modelled = {
            source.block
            for block in self.blocks
            if block.models_heat
            for name in block.inputs
            if isinstance(source := self.sources.get((block, name)), Signal)
        }
        for block in self.blocks:
            if isinstance(block, Actuator) and "temperature" not in block.outputs and block not in modelled:
                self.report(
                    "TW024",
                    "the actuator reports no temperature and has no thermal model",
                    block,
                    hint="connect a ThermalModel to its torque, and limit the command with a TemperatureDerating",
                    severity="warning",
                )

    def check_relays(self) -> None:
        """Check that the diagram has the actuators and buses that a relay powers."""
        actuators = [block for block in self.blocks if isinstance(block, Actuator)]
        known = {name for block in actuators for name in (block.path, block.bus)}
        for block in self.blocks:
            for name in sorted(set(block.protects) - known) if isinstance(block, Device) else ():
                self.report(
                    "TW010",
                    f"protects: the diagram has no actuator and no bus of actuators named {name!r}",
                    block,
                    hint=suggestion(name, known) or f"name one of {', '.join(sorted(known))}"
                    if known
                    else "add an actuator, or remove the block",
                )

    def check_timeouts(self) -> None:
        """Report devices whose timeout is shorter than two ticks."""
        for block in self.blocks:
            if isinstance(block, Device) and 0.0 < block.timeout < 2.0 / self.diagram.rate:
                self.report(
                    "TW010",
                    f"timeout: {block.timeout:g} s is shorter than two ticks at "
                    f"{self.diagram.rate:g} Hz, so every run would time out",
                    block,
                    hint=f"set timeout={2.0 / self.diagram.rate:.3g} or more, or 0 to disable it",
                )

    def check_addresses(self) -> None:
        """Report devices with the same address on one bus."""
        taken = {}
        for block in self.blocks:
            for address in block.addresses() if isinstance(block, Device) else ():
                other = taken.setdefault((block.bus, address), block)
                if other is not block:
                    what = block.address_in_words(address)
                    self.report(
                        "TW013",
                        f"shares {what} on bus {block.bus!r} with {other.path}, made at {other.location}",
                        block,
                        hint=block.address_hint,
                    )
                    break

    def check_bitrates(self) -> None:
        """Check that all devices on a CAN bus that declare a bitrate have the same one."""
        devices = [block for block in self.blocks if isinstance(block, Actuator) or "bitrate" in block.parameters]
        for block in devices:
            other = next((other for other in devices if other.bus == block.bus and other.bitrate > block.bitrate), None)
            if other is not None:
                self.report(
                    "TW025",
                    f"is set to {block.bitrate / 1e3:g} kbit/s, but {other.path} on the same bus {block.bus!r} to "
                    f"{other.bitrate / 1e3:g} kbit/s",
                    block,
                    hint=f"connect it to a separate bus, or set the device to {other.bitrate / 1e3:g} kbit/s and "
                    f"pass bitrate={other.bitrate:.0f}",
                )

    def check_lines(self) -> None:
        """Check that a bus has one medium, and a stream one device."""
        first = {}
        for block in self.blocks:
            if not isinstance(block, Device):
                continue
            other = first.setdefault(block.bus, block)
            if (
                other is not block
                and (block.medium, other.medium) != ("can", "can")
                and not block.medium == other.medium == "i2c"
            ):
                what = (
                    "a separate line"
                    if block.medium == other.medium
                    else f"an interface of kind {block.medium}, but {other.path} uses {other.medium}"
                )
                self.report(
                    "TW013",
                    f"is on bus {block.bus!r} with {other.path}, made at {other.location}, and needs {what}",
                    block,
                    hint="set a different `bus`, or omit it: the default is the path of the block",
                )

    def check_buses(self) -> None:
        """Compute the load of each bus and serial line, and report overloaded ones."""
        self.loads = bus_loads([block for block in self.blocks if isinstance(block, Device)], self.diagram.rate)
        for load in self.loads:
            there = [block for block in self.blocks if isinstance(block, Device) and block.bus == load.bus]
            what = (
                f"{load.frames:g} frames per second use {load.typical:.0%} of bus {load.bus!r} at "
                f"{load.bitrate / 1e6:g} Mbit/s, {load.worst:.0%} in the worst case"
            )
            hint = f"lower the rate, or move some of its {len(there)} devices to another bus"
            if load.typical > 1.0:
                self.report("TW016", what, there[0], hint=hint)
            elif load.worst > 0.7:
                self.report("TW022", what, there[0], hint=hint, severity="warning")
        self.check_line_speeds()

    def check_line_speeds(self) -> None:
        """Report serial lines that cannot carry the messages of their device, or only just."""
        for load in line_loads([block for block in self.blocks if isinstance(block, Device)]):
            what = (
                f"{load.messages:g} messages per second, at least {load.bytes:g} bytes, use {load.share:.0%} of "
                f"its line at {load.speed:g} bit/s"
            )
            hint = "lower its rate, request fewer channels, or raise the baud rate of the device and `baudrate`"
            if load.share > 1.0:
                self.report("TW016", what, load.device, hint=hint)
            elif load.share > 0.8:
                self.report("TW022", what, load.device, hint=hint, severity="warning")

    # Rates and conditions

    def check_always(self, block: Block) -> None:
        """Check that a block with `always` and its sources run in every tick."""
        if block.every != 1:
            self.report(
                "TW018",
                f"runs every {block.every} ticks, but must run in every tick",
                block,
                hint="move it out of the slow subsystem",
            )
        if block.conditions:
            self.report(
                "TW018",
                f"does not run while {names_of(block.conditions)} is false",
                block,
                hint="move it out of the subsystem",
            )
        for name in block.inputs:
            source = self.sources[block, name]
            if isinstance(source, Signal) and source.block.conditions:
                self.report(
                    "TW018",
                    f"{source.path} keeps its last value while {names_of(source.block.conditions)} is false",
                    block,
                    name,
                    self.where(block, name),
                    f"move {source.block.path} out of the subsystem",
                )

    def check_rates(self) -> None:
        """Report what the rates and conditions of subsystems do not permit, and find held signals."""
        self.holds = []
        for block in self.blocks:
            if block.every != 1 and (isinstance(block, Device) or isinstance(block, Sink) and not block.accepts_every):
                self.report(
                    "TW014",
                    f"runs every {block.every} ticks, but a "
                    f"{'device' if isinstance(block, Device) else 'viewer'} must run in every tick",
                    block,
                    hint="move it out of the slow subsystem; blocks that use its outputs may remain there",
                )
            if block.always:
                self.check_always(block)
            for name in block.inputs:
                source = self.sources[block, name]
                if (
                    not isinstance(source, Signal)
                    or isinstance(block, (Device, Sink))
                    or source.block.every == block.every
                ):
                    continue
                slow, fast = max(source.block.every, block.every), min(source.block.every, block.every)
                if slow % fast and not (block.resamples or source.block.resamples):
                    self.report(
                        "TW014",
                        f"runs at every {block.every} ticks, and {source.path} at every "
                        f"{source.block.every}: neither divides the other",
                        block,
                        name,
                        self.where(block, name),
                        f"insert a Hold(every={block.every}), which samples the signal",
                    )
                else:
                    self.holds.append((source.path, source.block.every, f"{block.path}.{name}", block.every))
        for block in self.blocks:
            if isinstance(block, Actuator):
                for name in block.inputs:
                    source = self.sources[block, name]
                    if isinstance(source, Signal) and source.block.conditions and not block.conditions:
                        conditions = names_of(source.block.conditions)
                        self.report(
                            "TW021",
                            f"{source.path} keeps its last value while {conditions} is false",
                            block,
                            name,
                            self.where(block, name),
                            "connect a Switch after the subsystem that selects 0 while it is disabled",
                            "warning",
                        )

    # Order

    def sort(self) -> None:
        """Sort the blocks by their dependencies within a tick, and report algebraic loops."""
        graph = dependencies(self.blocks, self.sources)
        self.order = cluster(graph)
        if len(self.order) == len(graph):
            return
        for cycle in take_out_loops(graph):
            spelled = ", ".join(
                f"{source.path}.{output} -> {block.path}.{port}" for source, output, block, port in cycle
            )
            *_, (_, _, first, port) = cycle
            self.report(
                "TW006",
                f"these blocks depend on each other in the same tick: {spelled}",
                first,
                where=self.where(first, port),
                hint="insert a block without direct feedthrough, such as UnitDelay",
            )
        self.order = cluster(graph)

    # Range proof

    def prove(self) -> None:
        """Find the range of every signal, and prove the commands of every actuator."""
        self.ranges = find_ranges(self.blocks, self.order, self.sources, self.attempt)
        self.proofs, self.torque_bounds = [], {}
        for block in self.blocks:
            if isinstance(block, Actuator):
                for name, limit in (self.attempt(block, block.command_limits) or {}).items():
                    self.prove_command(block, name, limit)
                commands = {name: interval_of(self.sources[block, name], self.ranges) for name in block.inputs}
                self.torque_bounds[block.path] = self.attempt(
                    block, block.torque_bound, commands, 1.0 / self.diagram.rate
                )

    def prove_command(self, block: Actuator, name: str, limit: Interval) -> None:
        """Prove that a command of an actuator stays within its limit, or report it. name : of the input"""
        source = self.sources[block, name]
        interval = interval_of(source, self.ranges)
        bounded_by = source.block.path if isinstance(source, Signal) else "a constant"
        unit = block.inputs[name].unit
        proof = Proof(block.path, name, unit, interval, limit, bounded_by)
        self.proofs.append(proof)
        if not proof.holds:
            what = source.path if isinstance(source, Signal) else f"{float(source):g} {unit}"
            reach = f"can reach {interval} {unit}" if isinstance(source, Signal) else "is commanded"
            what += f" {reach}" if interval.bounded else " is unbounded"
            self.report(
                "TW007",
                f"{what}, and the limit is {limit} {unit} ({block.rating()})",
                block,
                name,
                self.where(block, name),
                hints.for_limit(block, source, name, unit, limit, interval),
            )

    def check_reach(self) -> None:
        """Check setpoints against the limits of the joints and drives (graph.reach)."""
        ReachCheck(
            self,
            lambda message, block, port, where, hint, severity: self.report(
                "TW026", message, block, port, where, hint, severity
            ),
        )

    def check_use(self) -> None:
        """Warn of blocks whose outputs are not connected, unless a sink records everything."""
        used = {wire.source.block for wire in self.diagram.wires if isinstance(wire.source, Signal)}
        used |= {condition.block for block in self.blocks for condition in block.conditions}
        if any(isinstance(block, Sink) and block not in self.taps for block in self.blocks):
            return
        for block in self.blocks:
            if block.outputs and block not in used and not isinstance(block, Device):
                self.report("TW020", "its outputs are not connected or recorded", block, severity="warning")

    # Preparation before the layout

    def prepare(self) -> None:
        """Set the width and the sampling period of each block, and call its `prepare`."""
        for block in self.blocks:
            free = (
                self.shapes[block, name] for name, port in (block.inputs | block.outputs).items() if port.shape is ...
            )
            block.width = size_of(next(filter(None, free), ()))
            block.dt = block.every / self.diagram.rate
            self.attempt(block, block.prepare, block.dt)


def names_of(conditions: tuple[Signal, ...]) -> str:
    """Return the paths of conditions, joined by "and"."""
    return " and ".join(signal.path for signal in conditions)
