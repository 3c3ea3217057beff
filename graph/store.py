"""Diagrams as JSON, and their content hash.

The text contains each block as `module:qualname` with its parameters, the wires, and the versions of the libraries.
Diagrams with equal hashes compute the same. The hash covers the source, parameters, wires and rate of the blocks and
the content of the files that they read. It does not depend on paths of files or on the order in which blocks were made.
"""

from __future__ import annotations

import ast
import importlib
import importlib.metadata
import inspect
import json
import math
import os
import sys
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cext.user_text import repr_of
from graph.block import Block
from graph.declarations import Live
from graph.diagnostics import Diagnostic, DiagramError
from graph.diagram import Diagram, Scope, scope_in_context
from graph.narrowing import is_row, is_table
from graph.sha256 import sha256
from graph.signal import Signal
from graph.solvers import ATOL, DEFAULT, RTOL

if TYPE_CHECKING:
    from graph.diagram import Wire

FORMAT = 1
ENTRY_POINTS = "tickwork.blocks"
OWN = ("blocks", "graph")


def to_json(diagram: Diagram) -> str:
    """Return the diagram as JSON text, independent of the order in which its blocks were made and wired."""
    data = describe(diagram)
    data["hash"] = digest(data)
    return json.dumps(data, indent=1, ensure_ascii=False)


def content_hash(diagram: Diagram) -> str:
    """Return the content hash of a diagram, as 'sha256:...'."""
    return digest(describe(diagram))


def describe(diagram: Diagram) -> dict[str, Any]:
    """Return a diagram as a dict that JSON can represent."""
    blocks: list[Block] = sorted(diagram, key=lambda block: block.path)
    sources = {kind: source_hash(kind) for kind in {type(block) for block in blocks}}
    ours = all(kind.__module__.split(".")[0] in OWN for kind in sources)  # then no other library is looked up
    known: dict[str, str] = dict.fromkeys(OWN, "tickwork") if ours else registered()
    order = {id(wire): index for index, wire in enumerate(diagram.wires)}
    wires = sorted(
        diagram.wires,
        key=lambda w: (w.block.path, "" if w.block.variadic else w.port, order[id(w)] if w.block.variadic else 0),
    )
    return {
        "format": FORMAT,
        "name": diagram.name,
        "rate": diagram.rate,
        **({"solver": diagram.solver} if diagram.solver != DEFAULT else {}),
        **({"tolerances": diagram.tolerances} if diagram.tolerances != (RTOL, ATOL) else {}),
        "libraries": dict(sorted({library(kind, known) for kind in sources})),
        "blocks": [describe_block(block, known, sources[type(block)]) for block in blocks],
        "wires": [describe_wire(wire) for wire in wires],
    }


def describe_block(block: Block, known: dict[str, str], source: str) -> dict[str, Any]:
    """Return a block as a JSON object, with the hash of its source."""
    kind = type(block)
    data: dict[str, Any] = {"path": block.path, "type": f"{kind.__module__}:{kind.__qualname__}", "source": source}
    if not loadable(kind, known):
        data["local"] = True
    parameters = {}
    for name in block.parameters:
        value = encode(getattr(block, name))
        parameters[name] = (
            {"live": [value, *map(encode, block.live_bounds[name])]} if name in block.live_bounds else value
        )
    if parameters:
        data["parameters"] = parameters
    live = [name for name in block.parameters if block.live(name)]
    if live:
        data["live"] = live
    files = {
        name: file_hash(block, name) for name, param in block.parameters.items() if param.file and getattr(block, name)
    }
    if files:
        data["files"] = files
    if block.every != 1:
        data["every"] = block.every
    if block.hold_exceptions:
        data["hold_exceptions"] = block.hold_exceptions
    if block.conditions:
        data["conditions"] = [signal.path for signal in block.conditions]
    return data


def describe_wire(wire: Wire) -> dict[str, Any]:
    """Return a wire as a JSON object."""
    data = {"to": wire.block.path}
    if wire.port is not None:
        data["port"] = wire.port
    data["from"] = wire.source.path if isinstance(wire.source, Signal) else {"constant": encode(wire.source)}
    return data


def encode(value: Any) -> Any:
    """Return a parameter or constant in JSON form: infinities as text, tuples and arrays as lists.

    Raises TypeError for a value that JSON cannot represent.
    """
    if isinstance(value, float) and not math.isfinite(value):
        return {"float": repr(value)}
    if is_row(value):
        return [encode(item) for item in value]
    if is_table(value):
        return {str(key): encode(item) for key, item in value.items()}
    tolist = getattr(value, "tolist", None)
    if tolist is not None:
        return encode(tolist())
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    raise TypeError(f"{repr_of(value)} cannot be written to JSON")


def decode(value: Any) -> Any:
    """Return the value that `encode` wrote: arrays as tuples."""
    if is_table(value):
        if set(value) == {"float"}:
            return float(value["float"])
        return {key: decode(item) for key, item in value.items()}
    return tuple(decode(item) for item in value) if is_row(value) else value


def unchanging(entry: dict[str, Any]) -> dict[str, Any]:
    """Return the part of a block in JSON form that enters the hash.

    Paths of files are replaced by the hash of their content, live parameters by their bounds.
    """
    parameters = {**entry.get("parameters", {}), **entry.get("files", {})}
    for name in entry.get("live", ()):
        value = parameters[name]
        parameters[name] = {"live": value["live"][1:]} if isinstance(value, dict) and "live" in value else None
    return {**entry, "parameters": parameters}


def digest(data: dict[str, Any]) -> str:
    """Return the content hash of a diagram in JSON form."""
    essence = {key: data[key] for key in ("name", "rate", "solver", "tolerances", "blocks", "wires") if key in data}
    essence["blocks"] = [unchanging(entry) for entry in data["blocks"]]
    text = json.dumps(essence, ensure_ascii=False, separators=(",", ":"))
    return "sha256:" + sha256(text.encode()).hexdigest()


@lru_cache(maxsize=256)
def source_hash(kind: type[Block]) -> str:
    """Return the hash of the source of a block class or its function.

    Without one, as of a class in a cell of a notebook, it is that of its name and of its functions that have a source.
    """
    try:
        source = source_text(getattr(kind, "function", kind))
    except (OSError, TypeError):
        source = f"{kind.__module__}:{kind.__qualname__}"
        for part in filter(inspect.isfunction, vars(kind).values()):
            with suppress(OSError):
                source += "\n" + inspect.getsource(part)
    return sha256(source.encode()).hexdigest()[:16]


def source_text(kind: Any) -> str:
    """Return the result of inspect.getsource for a class or function.

    Before CPython 3.13, inspect parses the whole file to find a class, 2 ms. Here, the line of most classes is found by
    its text: the only definition of that name, neither in a string nor with a decorator before it.
    """
    if isinstance(kind, type) and kind.__qualname__ == kind.__name__ and kind.__module__ in sys.modules:
        lines, _ = inspect.findsource(sys.modules[kind.__module__])
        heads = (f"class {kind.__name__}(", f"class {kind.__name__}:")
        found = [number for number, line in enumerate(lines) if line.lstrip().startswith(heads)]
        if len(found) == 1 and lines[found[0]].startswith(heads) and is_undecorated(lines[: found[0]]):
            return "".join(inspect.getblock(lines[found[0] :]))
    return inspect.getsource(kind)


def is_undecorated(before: list[str]) -> bool:
    """Return whether the line after these is certainly a statement without a decorator. before : lines of a file"""
    text = "".join(before)
    if "'''" in text or text.count('"""') % 2:  # it may be in a string
        return False
    last = next((number for number in reversed(range(len(before))) if before[number].startswith("@")), None)
    try:
        return last is None or bool(ast.parse("".join(before[last:])))
    except SyntaxError:  # the decorator, or a string with that line, is not complete
        return False


def file_hash(block: Block, name: str) -> str:
    """Return the hash of a file that a block reads. Raises DiagramError if it cannot be read."""
    try:
        return "sha256:" + sha256(b"".join(path.read_bytes() for path in block.files_of(name))).hexdigest()
    except OSError as error:
        raise DiagramError(
            Diagnostic(
                "TW010",
                f"{name}: cannot read {error.filename}: {error.strerror}",
                path=block.path,
                where=block.location,
                hint="restore the file: its content is part of the diagram",
            )
        ) from None


def loadable(kind: type[Block], known: dict[str, str]) -> bool:
    """Return whether a library provides the class by module and name. known : result of `registered`"""
    return kind.__module__.split(".")[0] in known and "<locals>" not in kind.__qualname__


def registered() -> dict[str, str]:
    """Return {top-level package: distribution} of all installed block libraries, including this one."""
    packages: dict[str, str] = dict.fromkeys(OWN, "tickwork")
    for point in points():
        packages[point.module.split(".")[0]] = point.dist.name if point.dist else point.name
    return packages


def points() -> tuple[importlib.metadata.EntryPoint, ...]:
    """Return the entry points of the installed block libraries, read again once a folder of `sys.path` has changed."""
    return _points(tuple((folder, _changed(folder)) for folder in sys.path))


def _changed(folder: str) -> int:
    """Return when a folder was changed last, in ns; 0 if it does not exist."""
    try:
        return os.stat(folder or ".").st_mtime_ns
    except OSError:
        return 0


@lru_cache(maxsize=4)  # to read those of 150 distributions takes 20 ms, as long as a short run in virtual time
def _points(state: tuple[tuple[str, int], ...]) -> tuple[importlib.metadata.EntryPoint, ...]:
    return tuple(importlib.metadata.entry_points(group=ENTRY_POINTS))


def library(kind: type[Block], known: dict[str, str]) -> tuple[str, str]:
    """Return the (distribution, version) of a class, or (file, "local") for a class in a user's file."""
    distribution = known.get(kind.__module__.split(".")[0])
    if distribution is None:
        return Path(getattr(inspect.getmodule(kind), "__file__", kind.__module__)).name, "local"
    return distribution, installed_version(distribution)


@lru_cache(maxsize=16)
def installed_version(distribution: str) -> str:
    """Return the version of a distribution, or "not installed"."""
    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return "not installed"


def from_json(text: str, *, trust: tuple[str, ...] = ()) -> Diagram:
    """Return the diagram of a JSON text.

    trust : names of modules to import although no library registers them

    Raises DiagramError: a newer format (TW030), a missing library, with the line that installs it (TW031), or a local
    block (TW032).
    """
    data = json.loads(text)
    if data.get("format") != FORMAT:
        raise DiagramError(
            Diagnostic(
                "TW030",
                f"the text has format {data.get('format')!r}; this version of Tickwork reads format {FORMAT}",
                path=str(data.get("name", "")),
                hint="pip install --upgrade tickwork",
            )
        )
    types: dict[str, type[Block]] = {}
    problems: list[Diagnostic] = []
    known = registered()
    for entry in data["blocks"]:
        try:
            types[entry["type"]] = find_type(entry, data["libraries"], trust, known)
        except DiagramError as error:
            problems += [d for d in error.diagnostics if d not in problems]
    if problems:
        raise DiagramError(problems)
    diagram = Diagram(data["name"], data["rate"], data.get("solver", DEFAULT), *data.get("tolerances", (RTOL, ATOL)))
    for entry in data["blocks"]:
        prefix, _, name = entry["path"].rpartition("/")
        token = scope_in_context.set(Scope(diagram, f"{prefix}/" if prefix else ""))
        try:
            block = types[entry["type"]](name=name, **held_by(entry), **parameters_of(entry))
        finally:
            scope_in_context.reset(token)
        block.every = entry.get("every", 1)
        block.dt = block.every / diagram.rate
    for entry in data["blocks"]:
        diagram[entry["path"]].conditions = tuple(signal_at(diagram, path) for path in entry.get("conditions", ()))
    for entry in data["wires"]:
        source = entry["from"]
        source = signal_at(diagram, source) if isinstance(source, str) else decode(source["constant"])
        block = diagram[entry["to"]]
        diagram.wire(source, block, entry.get("port"), block.location)
    return diagram


def parameters_of(entry: dict[str, Any]) -> dict[str, Any]:
    """Return {name: value or Live} of a block in JSON form."""
    parameters: dict[str, Any] = {}
    for name, value in entry.get("parameters", {}).items():
        if is_table(value) and set(value) == {"live"}:
            live: list[Any] = [decode(each) for each in value["live"]]
            value, low, high, slew = live
            parameters[name] = Live(value, min=low, max=high, slew=slew)
        elif value is not None:
            parameters[name] = decode(value)
    return parameters


def held_by(entry: dict[str, Any]) -> dict[str, Any]:
    """Return the constructor argument `hold_exceptions` of a block in JSON form, if it has one."""
    return {"hold_exceptions": entry["hold_exceptions"]} if "hold_exceptions" in entry else {}


def signal_at(diagram: Diagram, path: str) -> Signal:
    """Return the Signal at a path such as "left/knee.position"."""
    block, _, port = path.rpartition(".")
    return Signal(diagram[block], port)


def find_type(
    entry: dict[str, Any], libraries: dict[str, str], trust: tuple[str, ...], known: dict[str, str]
) -> type[Block]:
    """Return the class of a block in JSON form. known : result of `registered`

    Raises DiagramError unless its module is trusted and exists.
    """
    module, _, qualname = entry["type"].partition(":")
    top = module.split(".")[0]
    if entry.get("local") and module not in trust:
        raise DiagramError(
            Diagnostic(
                "TW032",
                f"{qualname} was defined in a local file ({module}), not in a library",
                path=entry["path"],
                hint=f"run that file again, or import it and load with trust=({module!r},)",
            )
        )
    if top not in known and module not in trust and top not in trust:
        owner = next(
            (f"{name}=={version}" for name, version in libraries.items() if name.replace("-", "_").startswith(top)),
            None,
        )
        if owner is None:
            raise DiagramError(
                Diagnostic(
                    "TW031",
                    f"{entry['type']} is in none of the installed block libraries, and the text names no library "
                    "for it",
                    path=entry["path"],
                    hint=f"if you trust the module {top!r}, load with trust=({top!r},)",
                )
            )
        raise DiagramError(
            Diagnostic(
                "TW031",
                f"{entry['type']} is in a library that is not installed",
                path=entry["path"],
                hint=f"pip install {owner}",
            )
        )
    try:
        kind = importlib.import_module(module)
        for name in qualname.split("."):
            kind = getattr(kind, name)
    except (ImportError, AttributeError) as error:
        raise DiagramError(
            Diagnostic(
                "TW031",
                f"{entry['type']} is not in the installed version of its library ({error})",
                path=entry["path"],
                hint="install the version that the diagram was saved with",
            )
        ) from None
    if not (isinstance(kind, type) and issubclass(kind, Block)):
        raise DiagramError(Diagnostic("TW031", f"{entry['type']} is not a block", path=entry["path"]))
    return kind
