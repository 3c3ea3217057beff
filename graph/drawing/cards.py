"""Descriptions of blocks as plain data, from their declarations and the results of the compiler."""

from __future__ import annotations

import inspect
import os
import re
from collections.abc import Callable, Sequence
from math import inf
from typing import TYPE_CHECKING, Any

from cext.user_text import text_of
from graph import units
from graph.block import Block, Sink
from graph.device import Actuator, Device
from graph.diagnostics import DiagramError
from graph.narrowing import is_row, is_table
from graph.signal import Signal

if TYPE_CHECKING:
    from graph.compilation import Compilation
    from graph.declarations import Input, Output, Param
    from graph.device_data import TorqueBound
    from graph.diagnostics import Diagnostic
    from graph.interval import Interval
    from graph.schedule import Proof

FAMILY_OF_MODULE = {
    "filters": "filter",
    "controllers": "controller",
    "states": "logic",
    "logic": "logic",
    "limiters": "limiter",
    "sources": "source",
}


def family(kind: type[Block]) -> str:
    """Return the key of style.FAMILIES of a block class, by its base class or else by its module."""
    if issubclass(kind, Actuator):
        return "actuator"
    if issubclass(kind, Device):
        return "sensor"
    if issubclass(kind, Sink):
        return "sink"
    return next((FAMILY_OF_MODULE[part] for part in kind.__module__.split(".") if part in FAMILY_OF_MODULE), "other")


def documentation(kind: type[Block]) -> tuple[str, ...]:
    """Return the paragraphs of the docstring of a block class, () if it has none.

    Prose is joined to one line; indented text keeps its lines.
    """
    inherited = {base.__doc__ for base in kind.__mro__[1:]}
    if not kind.__doc__ or kind.__doc__ in inherited:
        return ()
    paragraphs = re.split(r"\n\s*\n", inspect.cleandoc(kind.__doc__))
    return tuple(text if re.search(r"^\s", text, re.M) else " ".join(text.split()) for text in paragraphs)


def summary(kind: type[Block]) -> str:
    """Return the first sentence of the docstring of a block class."""
    first = " ".join("".join(documentation(kind)[:1]).split())
    return re.split(r"(?<=[.!?])\s+(?=[A-Z(])", first)[0]


def example(kind: type[Block]) -> Block | type[Block]:
    """Return a block of a class, outside a diagram, with the ports that its parameters create.

    Returns the class itself if the block needs other parameters.
    """
    examples: Sequence[dict[str, Any]] = getattr(kind, "examples", None) or ({},)
    try:
        return kind(**examples[0])
    except DiagramError:
        return kind


def shape_text(shape: Any) -> str:
    """Return the text of a shape: '' for a scalar, '3', '3 × 3', or 'any' for a port of any shape."""
    return "any" if shape is ... else " × ".join(map(str, shape))


def quantity(value: Any, unit: str) -> str:
    """Return the text of a value with its unit: '12 N·m', 'true', '8 entries'."""
    if value is None:
        return "none"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return f"{value:g}" + ("" if unit in (units.ONE, units.ANY) else f" {unit}")
    if is_row(value):
        if len(text_of(value)) > 24:
            return f"{len(value)} entries" if len(value) > 1 else "1 entry"
        return ", ".join(map(text_of, value)) or "()"
    if is_table(value):
        return ", ".join(map(text_of, value)) or "{}"
    text = value if type(value) is str else text_of(value)
    return text.encode("unicode_escape").decode() if text.isspace() else text or "none"


def number(value: float) -> str:
    """Return the text of a bound: a large integer with all its digits, other numbers with six."""
    return f"{value:.0f}" if 1e6 <= abs(value) <= 2**53 and value == round(value) else f"{value:g}"


def choice_text(choice: Any) -> str:
    """Return the text of a choice, in quotes if it is empty, a space, or has a separator of lists."""
    text = f"{choice:g}" if isinstance(choice, float) else text_of(choice)
    return text if text.strip(",; \t\n") and ", " not in text else repr(text)


def bounds_text(param: Param[Any]) -> str:
    """Return the text of a parameter's bounds: '0 to 150', 'above 0', 'one of rated, peak', '' without bounds."""
    if param.choices is not None:
        return "one of " + ", ".join(map(choice_text, param.choices))
    if param.dtype is bool:
        return ""
    if param.min is not None and param.max is not None:
        return f"{number(param.min)} to {number(param.max)}"
    words = ((param.min, "at least"), (param.above, "above"), (param.max, "at most"), (param.below, "below"))
    return " and ".join(f"{word} {number(bound)}" for bound, word in words if bound is not None)


def default_text(param: Param[Any]) -> str:
    """Return the text of a parameter's default; an empty choice is '', not none."""
    choice = param.choices is not None and isinstance(param.default, str)
    return choice_text(param.default) if choice else quantity(param.default, param.unit)


def interval_text(interval: Interval | None, unit: str) -> str:
    """Return the text of an interval: '-12 to 12 N·m', or '' if it is unbounded."""
    if interval is None or interval.low == -inf and interval.high == inf:
        return ""
    sign = "" if unit in (units.ONE, units.ANY) else f" {unit}"
    if interval.low == interval.high:
        return f"{interval.low:g}{sign}"
    if interval.low == -inf:
        return f"at most {number(interval.high)}{sign}"
    if interval.high == inf:
        return f"at least {number(interval.low)}{sign}"
    return f"{number(interval.low)} to {number(interval.high)}{sign}"


def parameter_cards(block: type[Block] | Block) -> list[dict[str, Any]]:
    """Return a dict for each parameter of a block or a block class.

    With a block, `value` is the text of its value, and `own` states whether that differs from the default.
    """
    cards: list[dict[str, Any]] = []
    for name, param in block.parameters.items():
        card: dict[str, Any] = {
            "name": name,
            "unit": param.unit,
            "description": param.description,
            "bounds": bounds_text(param),
            "live": param.live,
            "default": "required" if param.required else default_text(param),
        }
        if isinstance(block, Block):
            value = getattr(block, name)
            card["value"] = os.path.basename(value) if param.file and value else quantity(value, param.unit)
            card["own"] = param.required or not same(value, param.default)
            bounds = block.live(name)
            if bounds is not None:
                card["live"] = True
                card["bounds"] = f"{bounds.min:g} to {bounds.max:g}"
        cards.append(card)
    return cards


def same(value: Any, default: Any) -> bool:
    """Return whether a value is the default."""
    try:
        return bool(value == default)
    except Exception:  # arrays, and objects of user code
        return False


def unit_text(card: dict[str, Any]) -> str:
    """Return the unit, shape and dtype of a port or parameter, without defaults: 'rad/s, (3)', 'int'."""
    shape = card.get("shape", "")
    words = [
        "" if card["unit"] == units.ONE else card["unit"],
        "any shape" if shape == "any" else f"({shape})" if shape else "",
    ]
    return ", ".join(word for word in [*words, "" if card.get("dtype", "float") == "float" else card["dtype"]] if word)


def port_card(port: Any) -> dict[str, str]:
    """Return the declaration of a port as a dict."""
    card = {
        "name": port.name,
        "unit": port.unit,
        "shape": shape_text(port.shape),
        "dtype": port.dtype,
        "description": port.description,
    }
    if getattr(port, "default", None) is not None:
        card["default"] = quantity(port.default, port.unit)
    if getattr(port, "range", None) is not None and port.dtype != "bool":
        card["range"] = interval_text(port.range, port.unit)
    return card


def runs(block: type[Block] | Block) -> str:
    """Return where a block runs: 'native', 'Python', 'native, on a bus' or 'in the recorder process'."""
    if isinstance(block, Device) or isinstance(block, type) and issubclass(block, Device):
        return "native, on a bus"
    if isinstance(block, Sink) or isinstance(block, type) and issubclass(block, Sink):
        return "in the recorder process"
    if isinstance(block, Block):
        return "Python" if block.is_python or block.has_python_update else "native"
    return "Python" if block.step is not Block.step or block.update is not Block.update else "native"


def class_card(kind: type[Block]) -> Any:
    """Return the declarations of a block class as a dict."""
    block = example(kind)
    return {
        "type": kind.__name__,
        "module": kind.__module__,
        "family": family(kind),
        "summary": summary(kind),
        "documentation": documentation(kind),
        "runs": runs(kind),
        "variadic": kind.variadic,
        "inputs": [port_card(port) for port in block.inputs.values()],
        "outputs": [port_card(port) for port in block.outputs.values()],
        "parameters": parameter_cards(kind),
        "made": block.inputs.keys() != kind.inputs.keys() or block.outputs.keys() != kind.outputs.keys(),
    }


def block_card(
    block: Block, found: Compilation, targets: dict[str, list[str]], place: type | Callable[..., Any]
) -> dict[str, Any]:
    """Return the description of one block of a diagram as a dict.

    found : graph.compilation.Compilation
    targets : {signal path: [paths of the ports it is wired to]}
    place : converts a Location to text
    """
    kind = type(block)
    rate = found.diagram.rate / block.every
    return {
        "path": block.path,
        "type": kind.__name__,
        "module": kind.__module__,
        "family": family(kind),
        "summary": summary(kind),
        "documentation": documentation(kind),
        "runs": runs(block),
        "made": place(block.location) if block.location else "",
        "rate": f"{rate:g} Hz" + (f", every {block.every} ticks" if block.every != 1 else ""),
        "conditions": [signal.path for signal in block.conditions],
        "inputs": [input_card(block, port, found) for port in block.inputs.values()] + tap_cards(block, found),
        "outputs": [output_card(block, port, found, targets) for port in block.outputs.values()],
        "parameters": parameter_cards(block),
        "proofs": proof_texts([proof for proof in found.proofs if proof.path == block.path])
        + torque_texts(found.torque_bounds.get(block.path)),
        "bounds": [f"{proof.path}.{proof.port}" for proof in found.proofs if proof.bounded_by == block.path],
        "errors": [diagnostic_text(d) for d in found.errors if d.path == block.path],
        "warnings": [diagnostic_text(d) for d in found.diagnostics if d.path == block.path and d.severity == "warning"],
    }


def proof_texts(proofs: Sequence[Proof]) -> list[str]:
    """Return a line for each proof of a wired command, and one for all constant commands."""
    texts: list[str] = []
    constants: list[str] = []
    for proof in proofs:
        if proof.interval.low == proof.interval.high and proof.holds:
            constants.append(f"{proof.port} {interval_text(proof.interval, proof.unit)}")
            continue
        inside = "inside" if proof.holds else "NOT inside"
        interval, limit = (
            interval_text(proof.interval, proof.unit) or "anything",
            interval_text(proof.limit, proof.unit),
        )
        texts.append(f"{proof.port}: {interval}, {inside} {limit}; bounded by {proof.bounded_by}")
    return texts + (["constant: " + ", ".join(constants)] if constants else [])


def torque_texts(bound: TorqueBound | None) -> list[str]:
    """Return the assumption of an actuator's torque limit as a list of lines, [] if the limit is proved."""
    return [f"torque, not proved: {bound.holds}"] if bound is not None and bound.holds else []


def diagnostic_text(diagnostic: Diagnostic) -> str:
    """Return a diagnostic as one line."""
    return f"{diagnostic.code} {diagnostic.title}: {diagnostic.message}" + (
        f"; {diagnostic.hint}" if diagnostic.hint else ""
    )


def input_card(block: Block, port: Input, found: Compilation) -> dict[str, str]:
    """Return the declaration of an input, with its inferred unit and shape and its source."""
    source = found.sources.get((block, port.name))
    card = port_card(port) | {
        "unit": found.units[block, port.name],
        "shape": shape_text(found.shapes[block, port.name]),
    }
    if isinstance(source, Signal):
        card["source"] = source.path
    elif source is not None and (block, port.name) in found.wires:
        card["constant"] = quantity(source.tolist(), port.unit)
    return card


def tap_cards(block: Block, found: Compilation) -> list[dict[str, str]]:
    """Return the inputs of a sink that accepts any number of signals."""
    return [
        {
            "name": label,
            "unit": found.units[signal.block, signal.port],
            "shape": shape_text(found.shapes[signal.block, signal.port]),
            "dtype": signal.declaration.dtype,
            "description": "",
            "source": signal.path,
        }
        for label, signal in (found.taps.get(block, ()) if isinstance(block, Sink) and block.variadic else ())
    ]


def output_card(block: Block, port: Output, found: Compilation, targets: dict[str, list[str]]) -> dict[str, Any]:
    """Return the card of an output: unit, shape, proved range and targets."""
    signal = Signal(block, port.name)
    unit = found.units[block, port.name]
    return port_card(port) | {
        "unit": unit,
        "shape": shape_text(found.shapes[block, port.name]),
        "range": interval_text(found.ranges.get(signal), unit),
        "targets": targets.get(signal.path, []),
    }


def signal_text(signal: Signal, found: Compilation) -> str:
    """Return one line on a signal: path, unit, shape and range."""
    unit, shape = found.units[signal.block, signal.port], found.shapes[signal.block, signal.port]
    dtype = signal.declaration.dtype
    sign = "" if unit in (units.ONE, units.ANY) else unit
    words = [
        signal.path,
        sign,
        f"({shape_text(shape)})" if shape else "",
        "" if dtype == "float" else dtype,
        interval_text(found.ranges.get(signal), unit),
    ]
    return "   ".join(word for word in words if word)
