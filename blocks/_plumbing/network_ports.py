"""Ports of a neural network: from the metadata of its file, or from parameters."""

from __future__ import annotations

import json
import math
from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass, fields
from typing import Any

from blocks._plumbing.ports import check_port_names
from graph import units
from graph.narrowing import is_row, is_table

NEXT = "_next"  # suffix of the output that is the next value of a state


@dataclass(frozen=True)
class Channel:
    """Input of a network, which receives (x - mean) / std."""

    name: str
    unit: str = "1"
    mean: float = 0.0
    std: float = 1.0
    description: str = ""


@dataclass(frozen=True)
class Result(Channel):
    """Output of a network: y = y_network · std + mean, clipped to `range`."""

    range: tuple[float, float] | None = None

    @property
    def limits(self) -> tuple[float, float]:
        """Lowest and highest value."""
        return self.range or (-math.inf, math.inf)


@dataclass(frozen=True)
class Description:
    """Ports of a network, its sampling rate in Hz (0: unknown), and the samples until its outputs are valid."""

    channels: tuple[Channel, ...] = ()
    results: tuple[Result, ...] = ()
    rate: float = 0.0
    receptive_field: int = 1


def describe(
    metadata: str, channels: Sequence[Any], results: Sequence[Any], *, reserved: Container[str]
) -> Description:
    """Return the Description of a network.

    metadata : JSON text of the file, or ""
    channels, results : parameters that replace those in the file, or empty
    reserved : names that ports cannot have

    Raises ValueError.
    """
    try:
        data: dict[str, Any] = json.loads(metadata) if metadata else {}
    except ValueError as error:
        raise ValueError(f"the metadata of the file is not valid JSON ({error})") from None
    if not is_table(data):
        raise ValueError("the metadata of the file is not a JSON object")
    found = Description(
        tuple(_ports(Channel, "channels", channels or data.get("channels", ()), reserved)),
        tuple(_ports(Result, "results" if results else "outputs", results or data.get("outputs", ()), reserved)),
        _number("rate", data.get("rate", 0.0), 0.0),
        int(_number("receptive_field", data.get("receptive_field", 1), 1.0)),
    )
    names = [each.name for each in (*found.channels, *found.results)]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ValueError(f"two ports have the name {twice!r}: give each channel and output a name of its own")
    for parameter, there in (("channels", found.channels), ("results", found.results)):
        if not there:
            raise ValueError(
                f"the file does not describe its {'inputs' if parameter == 'channels' else 'outputs'}: pass "
                f'{parameter}=({{"name": ..., "unit": ..., "mean": ..., "std": ...}}, ...)'
            )
    return found


def _ports(kind: type, what: str, entries: Any, reserved: Container[str]) -> Iterable[Any]:
    """Yield a Channel or Result of each entry. Raises ValueError."""
    allowed = [each.name for each in fields(kind)]
    if not is_row(entries):
        raise ValueError(f"{what}: expected a list of objects, got {entries!r}")
    for entry in entries:
        if not is_table(entry) or "name" not in entry or set(entry) - set(allowed):
            raise ValueError(f"{what}: expected an object with name and any of {', '.join(allowed[1:])}, got {entry!r}")
        name = entry["name"]
        check_port_names([name], reserved)
        for key in ("unit", "description"):
            if not isinstance(entry.get(key, ""), str):
                raise ValueError(f"{what}: {key} of {name} must be text, got {entry[key]!r}")
        values = dict(entry)
        values["unit"] = units.canonical(entry.get("unit", "1"))
        values["mean"] = _number(f"{what}: mean of {name}", entry.get("mean", 0.0))
        values["std"] = _number(f"{what}: std of {name}", entry.get("std", 1.0))
        if values["std"] <= 0.0:
            raise ValueError(f"{what}: std of {name} must be above 0, got {values['std']:g}")
        if values.get("range") is not None:
            low, high = (_number(f"{what}: range of {name}", x) for x in _pair(name, entry["range"]))
            if low > high:
                raise ValueError(f"{what}: range of {name} must be [low, high], got [{low:g}, {high:g}]")
            values["range"] = low, high
        yield kind(**values)


def _pair(name: str, value: Any) -> Sequence[Any]:
    if not is_row(value) or len(value) != 2:
        raise ValueError(f"range of {name} must be two numbers, got {value!r}")
    return value


def _number(what: str, value: Any, low: float = -math.inf) -> float:
    """Return a finite number. Raises ValueError if it is none, or below `low`."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value) or value < low:
        bound = f" of at least {low:g}" if low > -math.inf else ""
        raise ValueError(f"{what} must be a finite number{bound}, got {value!r}")
    return float(value)


Tensors = list[tuple[str, tuple[int, ...]]]


def tensors(model: Any, description: Description, time_first: bool) -> tuple[Tensors, Tensors, int]:
    """Return the inputs and outputs of a Model in the order of its kernel, and the samples of its window.

    The signal precedes the states, and the results precede the next states. Raises ValueError for a model of another
    form.
    """
    inputs = {name: _fixed("input", name, shape) for name, shape in model.inputs.items()}
    outputs = {name: _fixed("output", name, shape) for name, shape in model.outputs.items()}
    states = [name for name in inputs if name + NEXT in outputs]
    signals = [name for name in inputs if name not in states]
    if len(signals) != 1:
        raise ValueError(
            f"expected one input without a next value, got {', '.join(signals) or 'none'}: a state NAME needs an "
            f"output NAME{NEXT}"
        )
    for name in states:
        if inputs[name] != outputs[name + NEXT]:
            raise ValueError(f"state {name} has shape {inputs[name]}, but {name}{NEXT} has {outputs[name + NEXT]}")
    results = [name for name in outputs if name.removesuffix(NEXT) not in states]
    count = sum(math.prod(outputs[name]) for name in results)
    if count != len(description.results):
        shapes = ", ".join(f"{name} {outputs[name]}" for name in results)
        raise ValueError(f"the network has {count} results ({shapes}), but {len(description.results)} are described")
    samples = _samples(signals[0], inputs[signals[0]], len(description.channels), time_first)
    if states and samples != 1:
        raise ValueError(f"input {signals[0]} of a streaming network must have one sample, got {samples}")
    in_order = [signals[0], *states], [*results, *(name + NEXT for name in states)]
    return [(name, inputs[name]) for name in in_order[0]], [(name, outputs[name]) for name in in_order[1]], samples


def _fixed(kind: str, name: str, shape: tuple[int, ...]) -> tuple[int, ...]:
    """Return a shape whose first dimension, if it varies, is 1. Raises ValueError if another one varies."""
    if -1 in shape[1:]:
        raise ValueError(f"{kind} {name} has a dimension that varies, {shape}: export the model with fixed dimensions")
    return tuple(abs(length) for length in shape)


def _samples(name: str, shape: tuple[int, ...], channels: int, time_first: bool) -> int:
    """Return the number of samples of the window. Raises ValueError for another shape or number of channels."""
    sizes = shape[1:] if len(shape) == 3 and shape[0] == 1 else shape
    if shape in ((1, channels), (channels,)):
        return 1
    if len(sizes) == 2 and sizes[time_first] == channels:
        return sizes[not time_first]
    expected = "(1, samples, channels)" if time_first else "(1, channels, samples)"
    raise ValueError(f"input {name} has shape {shape}, but expected {expected} with {channels} channels")
