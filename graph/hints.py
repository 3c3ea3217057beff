"""Remedies for values in the wrong place: a block instead of its output, a signal instead of a parameter."""

from __future__ import annotations

import inspect
import math
import os
from typing import Any

from cext.user_text import repr_of
from graph import units
from graph.declarations import Input
from graph.names import suggestion
from graph.narrowing import is_row
from graph.signal import Signal
from graph.signal_misuse import STACK


def for_source(source: Any, variadic: bool) -> str:
    """Return the remedy for a value that cannot be connected.

    variadic : whether the block takes any number of signals
    """
    if hasattr(source, "step_inputs"):
        block: Any = source
        if isinstance(source, type):  # a class of blocks
            return f"make a block and call it, as in {source.__name__}(...)({', '.join(block.inputs)})"
        inputs = [name for name, port in block.inputs.items() if port.default is None]
        if inputs or len(block.outputs) == 1:
            return f"call the block to get its output, as in {type(block).__name__}(...)({', '.join(inputs)})"
        return f"choose an output of {block.path}: {', '.join(block.outputs) or 'it has none'}"
    if isinstance(source, Input):
        return f"{source.name} is an input: connect an output, or the signal that is connected to this input"
    if is_row(source) and any(isinstance(item, Signal) for item in source):
        return "pass the signals one by one, as in block(a, b)" if variadic else STACK
    return "connect an output of a block, as in knee.position, or the result of a call"


def for_parameter(block: Any, name: str) -> str:
    """Return the remedy for an argument of a block's class that is not a parameter. name : name of the argument"""
    if name in block.inputs:
        return in_second_parentheses(block, f"{name}=...")
    if hasattr(block.__class__, name) and not hasattr(block.__class__.__mro__[-2], name):  # not of every block
        return f"declare it in the class, as in {name} = Param(1.0, unit)"
    return suggestion(name, block.parameters) or f"it has {', '.join(block.parameters) or 'none'}"


def for_argument(kind: type[Any], name: str) -> str:
    """Return "; " and the remedy for an argument of `step` that is not an input, or ""; name : name of the argument"""
    if name in kind.parameters:
        return f"; it is a parameter: read self.{name}"
    if name in kind.outputs:
        return "; it is an output: return its value"
    if name in _annotations(kind):
        return f'; write `{name} = Input("1")`, with `=` instead of `:`'
    if getattr(kind, name, None) is Input:
        return f'; write `{name} = Input("1")`, with the unit in parentheses'
    return f"; declare it in the class, as in {name} = Input(unit)"


def _annotations(kind: type[Any]) -> dict[str, Any]:
    """Return the annotations of a class; none if they cannot be evaluated, as Python 3.14 does when they are read."""
    try:
        return inspect.get_annotations(kind)
    except Exception:
        return {}


def in_second_parentheses(block: Any, inputs: str = "signal") -> str:
    """Return the remedy for a signal that was passed to a block's class. inputs : names of the inputs, as text"""
    parameters = "..." if block.parameters else ""
    return (
        f"pass parameters to the class and signals to the block, as in {type(block).__name__}({parameters})({inputs})"
    )


def for_input(block: Any, name: str | None) -> str:
    """Return the remedy for an unknown input. name : name of the input"""
    if name in block.parameters:
        return f"{name} is a parameter: pass it to the class, as in {type(block).__name__}({name}=...)"
    if f"{name}_command" in block.inputs:
        return f"did you mean '{name}_command'?"
    kind = f"{name} is an output; " if name in block.outputs else ""
    return suggestion(name, block.inputs) or f"{kind}its inputs are {', '.join(block.inputs) or 'none'}"


def for_assignment(block: Any) -> str:
    """Return a remedy if a signal was assigned to an attribute of a block, which connects nothing; else ""."""
    attributes: dict[str, Any] = block.__dict__
    assigned = (name for name, value in attributes.items() if isinstance(value, Signal) and value.block is not block)
    name = next(assigned, "")
    return name and (
        f"the signal assigned to its attribute {name!r} is not connected: call the block, as in "
        f"{block.path.split('/')[-1]}({suggested(name, block)}=...)"
    )


def for_attribute(block: Any) -> str:
    """Return a remedy if a block is an attribute of another one, as if created in its `reset`; else ""."""
    owner: Any
    for owner in block.diagram:
        attributes: dict[str, Any] = owner.__dict__
        name = next((name for name, value in attributes.items() if value is block), "")
        if name and owner is not block:
            return (
                f"{block.path} is the attribute {name!r} of {owner.path}, which connects nothing: create it in the "
                f"diagram, not in a method of {type(owner).__name__}, and connect it there, as in "
                f"{owner.path.split('/')[-1]}({type(block).__name__}(...)(signal))"
            )
    return ""


def for_count(block: Any) -> str:
    """Return the remedy for more signals than a block has inputs."""
    if not block.inputs:
        return "call it without arguments: it computes its outputs from no signal"
    return "pass one signal for each input, and combine signals with Sum (from blocks.mathematics) or stack(a, b)"


def for_taken_output(block: Any, name: str) -> tuple[str, str]:
    """Return (what is wrong, remedy) where an output is not the signal of its block. name : name of the output"""
    declared: dict[str, Any] = block.__class__.outputs
    if name not in block.__dict__ or name not in declared:
        return (
            f"{name!r} cannot be the name of an output: the block has another attribute of this name",
            "rename the output",
        )
    call = f"{block.path.split('/')[-1]}({usual_command(block)}=...)" if block.inputs else ""
    remedy = f"omit the assignment{f', or connect an input, as in {call}' if call else ''}"
    return (
        f"{repr_of(block.__dict__[name])} was assigned to its output {name!r}",
        f"a block computes its outputs: {remedy}",
    )


def for_file(error: OSError) -> str:
    """Return the remedy for a file that cannot be read, or ""."""
    if isinstance(error, IsADirectoryError):
        return "name a file in this folder"
    missing = isinstance(error, FileNotFoundError) and not os.path.isabs(str(error.filename))
    return f"write its absolute path, or one relative to the working folder, {os.getcwd()}" if missing else ""


def usual_command(block: Any) -> str:
    """Return the input of an actuator to suggest: its torque command, or its first one."""
    return "torque_command" if "torque_command" in block.inputs else next(iter(block.inputs))


def suggested(name: str, block: Any) -> str:
    """Return the input with the name closest to a misspelt one; its first input if none is close."""
    return (suggestion(name, block.inputs) or f"{next(iter(block.inputs), name)!r}").split("'")[1]


def for_factor(source: Any, got: str, expected: str) -> str:
    """Return the remedy for a product with a number, which has no unit, at an input of another unit, or ""."""
    block: Any = getattr(source, "block", None)
    if type(block).__name__ != "Gain" or block.unit != units.ONE:
        return ""
    return f'give the factor its unit, as in Gain({block.gain:g}, unit="{units.divide(expected, got)}")(signal)'


def for_output(source: Any, unit: str, known: dict[Any, str]) -> str:
    """Return which outputs of a block have a unit; "" for none.

    source : signal of another unit
    known : {(block, port): unit}
    """
    if not isinstance(source, Signal):
        return ""
    block = source.block
    names = [f"{block.path.split('/')[-1]}.{name}" for name in block.outputs if known.get((block, name)) == unit]
    return f"connect an output in {unit}: {' or '.join(names)}" if names else ""


def for_degrees(number: float, unit: str, limits: Any) -> str:
    """Return the remedy for an angle or velocity that is within its limits in degrees, or "". number : value in rad"""
    if unit not in ("rad", "rad/s") or abs(number) <= math.pi or math.radians(number) not in limits:
        return ""
    shown = f"{math.degrees(number):.0f}°{unit.removeprefix('rad')}"
    return f"{number:g} {unit} is {shown}: did you mean deg({number:g})?"


def unused_limiter(source: Signal) -> Any:
    """Return a limiter of a signal whose own output is not connected, or None."""
    wires = [wire for wire in source.block.diagram.wires if isinstance(wire.source, Signal)]
    used = {wire.source.block for wire in wires}
    return next((w.block for w in wires if w.source == source and w.block.clips and w.block not in used), None)


def for_limit(block: Any, source: Any, name: str, unit: str, limit: Any, interval: Any) -> str:
    """Return the remedy for a command outside its limit.

    block : the actuator
    source : signal or constant that commands it
    name, unit : name and unit of the command
    limit, interval : Interval of the limit and of the command
    """
    if not isinstance(source, Signal):
        return for_degrees(float(source), unit, limit) or f"command a value from {limit.low:g} to {limit.high:g} {unit}"
    peak = getattr(getattr(block, "spec", None), "peak", None)
    at_joint = None if peak is None else peak * getattr(block, "gear_ratio", 1.0)
    allowed = (
        f', or pass limit="peak" to {block.path.split("/")[-1]} for {at_joint:g} N·m'
        if getattr(block, "limit", None) == "rated" and at_joint is not None and interval.high <= at_joint
        else ""
    )
    if beside := unused_limiter(source):
        return (
            f"the output of {beside.path} is not connected: command it, as in {block.path.split('/')[-1]}({name}="
            f"{type(beside).__name__}(...)({source.block.path.split('/')[-1]}.{source.port}))"
        )
    if unit == "N·m" and interval.bounded and "limit" in source.block.parameters:
        return f"lower the limit of {source.block.path} to {limit.high:g}{allowed}"
    if unit == "N·m":
        return f"put a limiter last, as in {block.path.split('/')[-1]}({name}=TorqueLimiter(limit={limit.high:g})(...))"
    return "insert a Saturation before the actuator"
