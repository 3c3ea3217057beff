"""Compilation of a diagram to a schedule: named checks, then a topological sort, then the layout of the arena.

Every check appends its diagnostics to one list, and all errors are raised together.
"""

from __future__ import annotations

import gc
from collections.abc import Generator
from contextlib import contextmanager

from msgspec.structs import replace

from cext.user_text import repr_of
from graph import caveats, device_checks, hints, live_checks, rate_checks, signal_checks, type_checks, wire_checks
from graph.arena_layout import size_of
from graph.assembly import assemble
from graph.compilation import Compilation
from graph.device import Actuator
from graph.diagnostics import DiagramError
from graph.diagram import Diagram
from graph.held_checks import check_held
from graph.interval import Interval
from graph.part_checks import check_parts
from graph.ranges import find_ranges, interval_of
from graph.reach import check_reach
from graph.schedule import Proof, Schedule
from graph.signal import Signal


def compile(diagram: Diagram) -> Schedule:
    """Check and sort a diagram, and place its signals in an arena.

    Raises DiagramError with every problem that the checks find, and TypeError for anything but a Diagram.
    """
    if not isinstance(diagram, Diagram):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise TypeError(f"compile() takes a Diagram, got {repr_of(diagram)}; runtime.check takes a file")
    with uncollected():
        compilation = examine(diagram)
        if compilation.errors:
            raise DiagramError(compilation.errors)
        return assemble(compilation)


@contextmanager
def uncollected() -> Generator[None]:
    """Pause garbage collection: a compile creates no cycles to collect, and each pass would visit all its objects."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()


def examine(diagram: Diagram) -> Compilation:
    """Check and sort a diagram. Returns the Compilation, whose `diagnostics` list the problems.

    Raises DiagramError only for parameters and parts of the diagram that the checks could not read.
    """
    check_parts(diagram)
    compilation = Compilation(diagram)
    for check in (
        wire_checks.check_names,
        device_checks.apply_caps,
        live_checks.check_live,
        wire_checks.check_wires,
        wire_checks.compile_marked,
        wire_checks.check_steps,
        type_checks.check_dtypes,
        type_checks.check_shapes,
        type_checks.check_units,
        device_checks.check_actuators,
        device_checks.check_effects,
        device_checks.check_heat,
        device_checks.check_relays,
        device_checks.check_timeouts,
        device_checks.check_addresses,
        device_checks.check_bitrates,
        device_checks.check_lines,
        device_checks.check_buses,
        rate_checks.check_rates,
        sort,
        prepare,
        prove,
        caveats.check_torque,
        device_checks.check_caps,
        check_reach,
        check_held,
        signal_checks.check_circles,
        signal_checks.check_windup,
        wire_checks.check_use,
    ):
        check(compilation)
    return compilation


def sort(compilation: Compilation) -> None:
    """Sort the blocks by their dependencies within a tick, and report algebraic loops."""
    from graph.order import dependencies, ordered, take_out_loops  # imports networkx

    graph = dependencies(compilation.blocks, compilation.sources)
    for cycle in take_out_loops(graph):
        spelled = ", ".join(f"{source.path}.{output} -> {block.path}.{port}" for source, output, block, port in cycle)
        *_, (_, _, first, port) = cycle
        compilation.report(
            "TW006",
            f"these blocks depend on each other in the same tick: {spelled}",
            first,
            where=compilation.where(first, port),
            hint="insert a block without direct feedthrough, such as UnitDelay",
        )
    compilation.order = ordered(graph)


def prove(compilation: Compilation) -> None:
    """Find the range of every signal, and prove the commands of every actuator."""
    compilation.ranges = find_ranges(compilation.blocks, compilation.order, compilation.sources, compilation.attempt)
    for block in compilation.blocks:
        if isinstance(block, Actuator):
            limits: dict[str, Interval] = compilation.attempt(block, block.command_limits) or {}
            for name, limit in limits.items():
                prove_command(compilation, block, name, limit)
            commands = {
                name: interval_of(compilation.sources[block, name], compilation.ranges) for name in block.inputs
            }
            bound = compilation.attempt(block, block.torque_bound, commands, 1.0 / compilation.diagram.rate)
            if bound is not None and block in compilation.caps:
                most = compilation.caps[block].torque
                bound = replace(bound, limit=most if bound.limit is None else min(bound.limit, most))
            compilation.torque_bounds[block.path] = bound


def prove_command(compilation: Compilation, block: Actuator, name: str, limit: Interval) -> None:
    """Prove that a command of an actuator stays within its limit, or report it. name : name of the input"""
    source = compilation.sources[block, name]
    interval = interval_of(source, compilation.ranges)
    bounded_by = source.block.path if isinstance(source, Signal) else "a constant"
    unit = block.inputs[name].unit
    proof = Proof(block.path, name, unit, interval, limit, bounded_by)
    compilation.proofs.append(proof)
    if not proof.holds:
        what = source.path if isinstance(source, Signal) else f"{float(source):g} {unit}"
        reach = f"can reach {interval} {unit}" if isinstance(source, Signal) else "is commanded"
        what += f" {reach}" if interval.bounded else " is unbounded"
        compilation.report(
            "TW007",
            f"{what}, and the limit is {limit} {unit} ({block.rating()})",
            block,
            name,
            compilation.where(block, name),
            hints.for_limit(block, source, name, unit, limit, interval),
        )


def prepare(compilation: Compilation) -> None:
    """Set the width and the sampling period of each block, and call its `prepare`."""
    for block in compilation.blocks:
        unstable = compilation.attempt(block, block.instability)
        if unstable is not None:
            compilation.report("TW037", unstable[0], block, hint=unstable[1], severity="warning")
        free = (
            compilation.shapes[block, name]
            for name, port in (block.inputs | block.outputs).items()
            if port.shape is ...
        )
        block.width = size_of(next(filter(None, free), ()))
        block.dt = block.every / compilation.diagram.rate
        compilation.attempt(block, block.check_rules)
        compilation.attempt(block, block.prepare, block.dt)
