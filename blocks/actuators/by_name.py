"""Actuators by the name of their model alone: the family that knows the model has the block."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from blocks.families import find_model
from graph import Block, Diagnostic, DiagramError, Signal
from graph.diagnostics import caller
from graph.family import Drive

ALWAYS_KEPT = ("bus", "can_id")  # parameters that another block keeps, even if they have the default value
OF_DIAGRAM = ("path", "diagram", "location", "every", "hold_exceptions", "conditions", "live_bounds", "set_from")


def Actuator(model: str, **parameters: Any) -> Any:
    """Return the block of a drive, of the family that knows its model: Actuator(MODEL, bus="legs", can_id=1).

    A name may end in the option of a protocol other than the usual one, as in "MODEL-servo". `--set knee.model=MODEL`
    selects a model of any family.

    model : name of the model, as vendors and papers spell it; parameters : parameters of the block

    Raises DiagramError for an unknown model, and as the block does.
    """
    drive, found = _find(model)
    block = drive.block(found.name, **parameters)
    block._by_name = True
    return block


def actuators(models: Mapping[int, str], **parameters: Any) -> dict[int, Any]:
    """Return {CAN id: block} of a group of drives on one bus: actuators({1: MODEL, 2: OTHER}, bus="legs").

    Their names are actuator_1, actuator_2 and so on. models : {CAN id: model}; parameters : parameters of every block
    """
    return {
        can_id: Actuator(model, can_id=can_id, name=f"actuator_{can_id}", **parameters)
        for can_id, model in models.items()
    }


def change_model(block: Block, model: str) -> bool:
    """Change the model of a block that `Actuator` has made, and its class if the model is of another family.

    The parameters that both blocks have keep their values, and the wires remain. Returns False for a block that was
    made otherwise. Raises DiagramError for an unknown model, and for a block without a port that is in use.
    """
    if not getattr(block, "_by_name", False):
        return False
    drive, found = _find(model)
    kept = {
        name: getattr(block, name)
        for name, param in type(block).parameters.items()
        if name in drive.block.parameters
        and name != "model"
        and (name in ALWAYS_KEPT or getattr(block, name) != param.default)
    }
    new: Block = drive.block(found.name, name=block.path, **kept)
    _check_ports(block, new, model)
    state = {name: vars(block)[name] for name in OF_DIAGRAM if name in vars(block)}
    made = {
        name: Signal(block, value.port)
        for name, value in vars(new).items()
        if isinstance(value, Signal) and value.block is new
    }
    block.__class__ = drive.block
    block.__dict__ = {**vars(new), **made, **state, "_by_name": True}
    return True


def _find(model: str) -> tuple[Drive, Any]:
    """Return (Drive, model) of a name. Raises DiagramError."""
    try:
        return find_model(model)
    except ValueError as error:
        raise DiagramError(Diagnostic("TW010", str(error), path="Actuator", where=caller())) from None


def _check_ports(block: Block, new: Block, model: str) -> None:
    """Raise DiagramError for wires to and from ports that the new block does not have."""
    wires = () if block.diagram is None else block.diagram.wires
    lost = {wire.port for wire in wires if wire.block is block and wire.port not in new.inputs}
    lost |= {
        wire.source.port
        for wire in wires
        if isinstance(wire.source, Signal) and wire.source.block is block and wire.source.port not in new.outputs
    }
    if lost:
        kind = type(new).__name__
        raise DiagramError(
            Diagnostic(
                "TW010",
                f"model = {model!r} selects a {kind}, which has no {', '.join(sorted(lost))}",
                path=block.path,
                where=block.location,
                hint="wire only ports that both blocks have",
            )
        )
