"""Catalogue of the installed blocks of all libraries, for `python -m runtime blocks`."""

from __future__ import annotations

import importlib
import importlib.metadata
import inspect
import pkgutil
import re
import sys
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from email.message import Message
from types import ModuleType
from typing import TYPE_CHECKING, Any, cast

from blocks.families import families
from cext.user_text import name_and_text
from graph import Block, Device
from graph.drawing.cards import class_card, documentation, summary, unit_text
from graph.store import points
from runtime.host.console.styles import console_for, count
from runtime.host.console.terminal import program
from runtime.host.errors import BadInput
from runtime.host.suggestions import suggestion

if TYPE_CHECKING:
    from runtime.host.console.styles import Console

OWN = "blocks"  # package of Tickwork's library
BASES = (Block.__module__, Device.__module__)


@dataclass(frozen=True)
class Library:
    """Library of blocks in one distribution."""

    name: str  # of the distribution
    modules: tuple[str, ...]
    homes: dict[type[Block], str]  # {class of a block: module that exports it}
    broken: tuple[tuple[str, str], ...]  # (module that cannot be imported, reason)


def catalog(name: str | None = None, library: str | None = None, models: bool = False) -> list[str]:
    """Return the lines of the catalogue. Raises BadInput.

    name : name of a block or family to describe; None lists all blocks
    library : list only the blocks of this distribution
    models : list the models of actuators instead
    """
    console = console_for()
    if models:
        return actuators(console)
    installed = libraries()
    if library is not None:
        installed = [_find_library(library, installed)]
    if name is None:
        return listing(installed, console, described=library is not None)
    homes = {kind: home for entry in installed for kind, home in entry.homes.items()}
    in_family = [kind for kind, home in homes.items() if name.lower() in (family_of(home), home)]
    if in_family and name not in {kind.__name__ for kind in homes}:  # `Compiled` is a block in the family `compiled`
        return _rows(in_family, console)
    return [
        line
        for index, kind in enumerate(find(name, homes))
        for line in ([""] if index else []) + describe(kind, homes[kind], console)
    ]


# Libraries


def libraries() -> list[Library]:
    """Return every Library, Tickwork's first."""
    modules = {"tickwork": [OWN]}
    for point in points():
        modules.setdefault(point.dist.name if point.dist else point.name, []).append(point.module)
    return [read(name, tuple(dict.fromkeys(places))) for name, places in modules.items()]


def read(name: str, places: Sequence[str]) -> Library:
    """Import the modules of a library. Returns a Library.

    name : name of the distribution
    places : names of the modules at the top of the library
    """
    modules, broken = [], []
    for place in places:
        for module in walk(place, broken):
            if module not in modules:
                modules.append(module)
    homes = {kind: module.__name__ for module in modules for kind in vars(module).values() if offers(module, kind)}
    order = sorted(homes, key=lambda kind: (family_of(homes[kind]), kind.__name__))
    return Library(name, tuple(places), {kind: homes[kind] for kind in order}, tuple(broken))


def offers(module: ModuleType, kind: object) -> bool:
    """Return whether a module exports a block: it defines the block, or belongs to Tickwork's library and imports it
    from graph.
    """
    if (
        not (isinstance(kind, type) and issubclass(kind, Block))
        or kind.__name__.startswith("_")
        or vars(kind).get("abstract")
    ):
        return False
    ours = (
        module.__name__.split(".")[0] == OWN and kind.__module__.startswith("graph.") and kind.__module__ not in BASES
    )
    return kind.__module__ == module.__name__ or ours


def walk(name: str, broken: list[tuple[str, str]]) -> Iterator[ModuleType]:
    """Yield a module and all below it.

    broken : list that receives (name, reason) of each module that cannot be imported
    """
    try:
        module = importlib.import_module(name)
    except Exception as error:  # a module of another library must not hide the rest
        broken.append((name, name_and_text(error)))
        return
    yield module
    for info in pkgutil.iter_modules(getattr(module, "__path__", ())):
        if not info.name.startswith("_"):
            yield from walk(f"{name}.{info.name}", broken)


def _find_library(name: str, installed: Sequence[Library]) -> Library:
    """Return the library of a distribution or of a top-level package. Raises BadInput with a suggestion."""

    def plain(text: str) -> str:
        return text.lower().replace("_", "-")

    for library in installed:
        if plain(name) in map(plain, (library.name, *(place.split(".")[0] for place in library.modules))):
            return library
    known = [library.name for library in installed]
    raise BadInput(
        f"no installed library {name!r} contains blocks; {suggestion(name, known) or 'expected ' + ', '.join(known)}"
    )


def family_of(home: str) -> str:
    """Return the module of a block within its library, such as 'limiters' or 'actuators'."""
    return home.split(".")[:2][-1]


def import_line(kind: type[Block], home: str) -> str:
    """Return the import statement of a block, from the outermost package that exports it.

    home : module that exports the block, already imported
    """
    parts = home.split(".")
    packages = [".".join(parts[:depth]) for depth in range(1, len(parts) + 1)]
    module = next(package for package in packages if getattr(sys.modules[package], kind.__name__, None) is kind)
    return f"from {module} import {kind.__name__}"


# Lists


def listing(installed: Iterable[Library], console: Console, described: bool) -> list[str]:
    """Return one line per block, by library and family.

    described : whether each library is described by its version, author and required versions
    """
    lines = []
    for library in installed:
        lines += about(library, console) if described else [_title(library, console)]
        for family in dict.fromkeys(map(family_of, library.homes.values())):
            own = [kind for kind, home in library.homes.items() if family_of(home) == family]
            modules = dict.fromkeys(import_line(kind, library.homes[kind]).split()[1] for kind in own)
            lines += [
                "",
                f"  {console.bold(family)}  {console.faint('from ' + ', '.join(modules))}",
                *_rows(own, console, "    "),
            ]
        for module, why in library.broken:
            lines += ["", console.error(f"  {module} cannot be imported: {why}")]
        lines.append("")
    return [
        *lines,
        f"describe a block: {program()} blocks NAME; a library: --from LIBRARY; the models of actuators: --actuators",
    ]


def _rows(kinds: Sequence[type[Block]], console: Console, indent: str = "") -> list[str]:
    width = max(len(kind.__name__) for kind in kinds)
    return [console.cut(f"{indent}{kind.__name__:<{width}}  {summary(kind) or 'no docstring'}") for kind in kinds]


def metadata(library: Library) -> Message | None:
    """Return the metadata of the distribution; None for a checkout that is not installed."""
    try:
        return cast(Message, importlib.metadata.metadata(library.name))
    except importlib.metadata.PackageNotFoundError:
        return None


def _title(library: Library, console: Console) -> str:
    data = metadata(library)
    return (
        console.bold(library.name + (f" {data['Version']}" if data else "")) + f"  {count(len(library.homes), 'block')}"
    )


def about(library: Library, console: Console) -> list[str]:
    """Return the lines on a library: version, author, required and tested versions."""
    data = metadata(library)
    lines = [_title(library, console)]
    if data is None:
        return [*lines, "  not installed as a distribution: run from a checkout"]
    pythons = re.compile(r"Programming Language :: Python :: \d\.\d+")
    tested = [text.rpartition(" :: ")[2] for text in data.get_all("Classifier", []) if pythons.fullmatch(text)]
    needs = [text for text in data.get_all("Requires-Dist", []) if "extra ==" not in text]
    facts = (
        ("about", data.get("Summary")),
        (
            "author",
            ", ".join(text for text in (data.get("Author"), data.get("Author-email"), data.get("Maintainer")) if text),
        ),
        ("licence", data.get("License-Expression") or data.get("License")),
        ("home", next((url.partition(", ")[2] for url in data.get_all("Project-URL", [])), data.get("Home-page"))),
        ("needs", ", ".join(needs)),
        (
            "tested with",
            ", ".join([*(f"Python {v}" for v in tested), *(text for text in needs if re.match(r"tickwork\b", text))]),
        ),
        ("Python", data.get("Requires-Python")),
    )
    for label, value in facts:
        lines += console.hang(f"  {label:<13}", " ".join(value.split())) if value else []
    return lines


# One block


def find(name: str, kinds: Iterable[type[Block]]) -> list[type[Block]]:
    """Return the blocks of a name, regardless of case and underscores. Raises BadInput with a suggestion."""
    plain = name.rpartition(".")[2].rpartition(":")[2].replace("_", "").replace("-", "").lower()
    matching = [kind for kind in kinds if kind.__name__.lower() == plain]
    if not matching:
        known = {kind.__name__.lower(): kind.__name__ for kind in kinds}
        close = suggestion(plain, known)
        hint = f"did you mean {known[close.split(chr(39))[1]]}?" if close else f"list all blocks: {program()} blocks"
        raise BadInput(f"no installed block has the name {name!r}; {hint}")
    return matching


def describe(kind: type[Block], home: str, console: Console) -> list[str]:
    """Return the lines that describe one block by its declarations."""
    card = class_card(kind)
    lines = [
        console.bold(card["type"]) + f"  {import_line(kind, home)}",
        console.faint(f"{card['runs']}; {source_line(kind)}{exceptions(card)}"),
    ]
    for paragraph in documentation(kind) or ("no docstring",):
        code = re.search(r"^\s", paragraph, re.M)
        lines += ["", *(textwrap.indent(paragraph, "  ").splitlines() if code else console.hang("  ", paragraph))]
    width = max((len(item["name"]) for key in ("inputs", "outputs", "parameters") for item in card[key]), default=0)
    units = max((len(unit_text(item)) for key in ("inputs", "outputs", "parameters") for item in card[key]), default=0)
    for title in ("inputs", "outputs"):
        if card[title]:
            lines += [
                "",
                console.bold(title)
                + (console.faint("  of an example: they depend on the parameters") if card["made"] else ""),
            ]
        for port in card[title]:
            words = [
                port["description"],
                f"default {port['default']}" if "default" in port else "",
                port.get("range", ""),
            ]
            lines += console.hang(
                f"  {port['name']:<{width}}  {unit_text(port):<{units}}  ", "; ".join(word for word in words if word)
            )
    if card["variadic"]:
        lines += ["", console.bold("inputs") + "  any number of signals; without connections, all ports"]
    if card["parameters"]:
        lines += ["", console.bold("parameters")]
    for item in card["parameters"]:
        default = "required" if item["default"] == "required" else f"default {item['default']}"
        live = "live" if item["live"] else "" if kind.parameters[item["name"]].fixed else "may be Live"
        words = [item["description"], default, item["bounds"], live]
        lines += console.hang(
            f"  {item['name']:<{width}}  {unit_text(item):<{units}}  ", "; ".join(word for word in words if word)
        )
    return [line.rstrip() for line in lines]


def exceptions(card: Mapping[str, Any]) -> str:
    """Return a remark on the handling of exceptions, for a Python block."""
    return "; accepts hold_exceptions" if "Python" in card["runs"] else ""


def source_line(kind: type[Block]) -> str:
    """Return the module and line of a block's source."""
    try:
        return f"{kind.__module__}, line {inspect.getsourcelines(getattr(kind, 'function', kind))[1]}"
    except (OSError, TypeError):
        return kind.__module__


# Actuators


def actuators(console: Console) -> list[str]:
    """Return the lines on the models of actuators by family: rated and peak torque, encoded ranges."""
    lines, notes = [], []
    for plugin in families():
        for table in plugin.tables:
            module = import_line(plugin.drives[0].block, plugin.drives[0].block.__module__).split()[1]
            lines += [*family(console, table.title, f"from {module} import {table.usage}", table.models), ""]
        notes += [plugin.table_note] if plugin.table_note else []
    words = (
        "Rated: continuous torque, and the default limit of a command. Peak: for seconds, with limit='peak'. Encoded "
        "ranges are scales of one firmware, not ratings; wire_torque=... and similar parameters override them for a "
        "unit that differs. Kt: at the output. A dash is a value that is not published: without a rated torque, pass "
        "limit=."
    )
    return [*lines, *console.hang("  ", " ".join([words, *notes]))]


def family(console: Console, name: str, usage: str, models: Mapping[str, Any]) -> list[str]:
    """Return the table of one family.

    name, usage : title of the table, and how a block names a model
    models : {name: model}, with the ratings and encoded ranges as attributes
    """
    columns = "".join(
        f"{text:>10}" for text in ("rated", "peak", "torque", "velocity", "position", "stiffness", "damping", "Kt")
    )
    units = "".join(
        f"{text:>10}" for text in ("N·m", "N·m", "± N·m", "± rad/s", "± rad", "N·m/rad", "N·m·s/rad", "N·m/A")
    )
    lines = [
        console.bold(name) + f"  {usage}",
        "",
        console.faint(f"  {'':<12}{'':>8}{'':>20}{'encoded range':>50}"),
        f"  {'model':<12}{'gear':>8}{columns}",
        console.faint(f"  {'':<12}{'':>8}{units}"),
    ]
    ranges = [f"wire_{name}" for name in ("torque", "velocity", "position", "stiffness", "damping")]
    for model in models.values():
        values = [
            *(_number_text(value) for value in (model.rated, model.peak, *(getattr(model, name) for name in ranges)))
        ]
        values.append(_number_text(model.torque_constant, ".3g"))
        lines.append(f"  {model.name:<12}{f'{model.gear:g}:1':>8}" + "".join(f"{value:>10}" for value in values))
    return lines


def _number_text(value: float | None, spec: str = "g") -> str:
    return "-" if value is None else format(value, spec)
