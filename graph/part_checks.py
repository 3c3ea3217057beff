"""Checks before a compile: the parts of a diagram are of the types that the other checks read."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from cext.user_text import repr_of
from graph.block import Block
from graph.class_checks import CLOCK
from graph.diagnostics import Diagnostic, DiagramError
from graph.diagram import Wire
from graph.names import suggestion
from graph.signal import Signal

if TYPE_CHECKING:
    from graph.diagram import Diagram

PARTS = {"wires": list, "duplicates": list, "not_entered": list, "caps": dict}  # {attribute: its type}


def check_parts(diagram: Diagram) -> None:
    """Adopt the parameters that were assigned to blocks.

    Raises DiagramError for parameters that are not valid, and for anything else in a diagram that cannot be.
    """
    for problems in (
        wrong_parts(diagram),
        (each for block in diagram for each in wrong_parameters(block)),
        (each for block in diagram for each in wrong_names(block)),
        wrong_wires(diagram),
    ):
        if found := list(problems):  # what comes later reads these
            raise DiagramError(found)


def wrong_parts(diagram: Diagram) -> Iterator[Diagnostic]:
    """Yield a Diagnostic for each attribute that was assigned, and for each block that was not made in the diagram."""
    for name, kind in PARTS.items():
        if not isinstance(getattr(diagram, name), kind):
            message = f"its {name} were assigned, got {repr_of(getattr(diagram, name))}"
            yield Diagnostic("TW010", message, diagram.name, hint="remove the assignment")
    for path, block in diagram.blocks.items():
        if not isinstance(block, Block) or block.path != path or block.diagram is not diagram:
            message = f"blocks[{path!r}] is {repr_of(block)}, which was not made in this diagram at this path"
            hint = "make it inside `with Diagram(...)`, and pass its name there, as in name='knee'"
            yield Diagnostic("TW010", message, diagram.name, where=getattr(block, "location", None), hint=hint)


def wrong_wires(diagram: Diagram) -> Iterator[Diagnostic]:
    """Yield a Diagnostic for each wire that does not end at blocks of the diagram."""
    known = {id(block) for block in diagram}
    wires: list[Any] = diagram.wires
    for wire in wires:
        if (
            isinstance(wire, Wire)
            and id(wire.block) in known
            and (wire.block.variadic or wire.port in wire.block.inputs)
            and (not isinstance(wire.source, Signal) or id(wire.source.block) in known)
        ):
            continue
        hint = "connect blocks of the diagram by calling them, as in knee(torque_command=signal)"
        where = wire.where if isinstance(wire, Wire) else None
        message = f"its wires contain {repr_of(wire)}, which does not connect two of its blocks"
        yield Diagnostic("TW010", message, diagram.name, where=where, hint=hint)


def wrong_parameters(block: Block) -> Iterator[Diagnostic]:
    """Adopt the assigned parameters of a block, and yield a Diagnostic for those that are not valid or misspelt."""
    try:
        block.adopt_assigned()
    except DiagramError as error:
        yield from error.diagnostics
        return
    for name in block.assigned_names():
        if hint := suggestion(name, block.parameters):
            yield Diagnostic("TW010", f"has no parameter {name!r}", block.path, where=block.location, hint=hint)


def wrong_names(block: Block) -> Iterator[Diagnostic]:
    """Yield a Diagnostic for each name that the class of a block takes for an input of its own."""
    for attribute, names in (
        ("step", block.step_inputs()),
        ("update", block.update_inputs()),
        ("smooth", block.smooth),
        ("free_units", block.free_units),
        ("winds_up", block.winds_up.values()),
    ):
        for name in names:
            if name not in block.inputs and name not in CLOCK:
                message = f"its {attribute} takes {repr_of(name)}, which is not an input"
                hint = f"its inputs are {', '.join(block.inputs) or 'none'}"
                yield Diagnostic("TW012", message, block.path, where=block.location, hint=hint)
