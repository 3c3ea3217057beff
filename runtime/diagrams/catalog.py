"""`python -m runtime blocks`: every block that is installed, from every library, as its declarations describe it."""

import importlib
import importlib.metadata
import inspect
import pkgutil
import re
import sys
import textwrap
from dataclasses import dataclass
from typing import Any

from blocks.families import families
from cext.user_text import name_and_text
from graph import Block, Device
from graph.drawing.cards import class_card, documentation, summary, unit_text
from graph.names import suggestion
from graph.store import ENTRY_POINTS
from runtime.base.errors import BadInput
from runtime.console.styles import console_for, count
from runtime.console.terminal import program

OWN = "blocks"  # our library's package
BASES = (Block.__module__, Device.__module__)


@dataclass(frozen=True)
class Library:
    """A library of blocks: the distribution that brings it, the modules to look in, what was found, and what could not
    be imported.
    """

    name: str
    modules: tuple
    homes: dict  # a block's class: the module that offers it
    broken: tuple  # (module, why)


def catalog(name=None, library=None, models=False):
    """Lines: every block, or those of `library`; one block or family, with `name`; the models of actuators. Raises
    BadInput.
    """
    console = console_for()
    if models:
        return actuators(console)
    found = libraries()
    if library is not None:
        found = [find_library(library, found)]
    if name is None:
        return listing(found, console, described=library is not None)
    homes = {kind: home for entry in found for kind, home in entry.homes.items()}
    in_family = [kind for kind, home in homes.items() if name.lower() in (family_of(home), home)]
    if in_family:
        return rows(in_family, console)
    return [
        line
        for index, kind in enumerate(find(name, homes))
        for line in ([""] if index else []) + describe(kind, homes[kind], console)
    ]


# Libraries


def libraries():
    """Every Library, ours first."""
    modules = {"tickwork": [OWN]}
    for point in importlib.metadata.entry_points(group=ENTRY_POINTS):
        modules.setdefault(point.dist.name if point.dist else point.name, []).append(point.module)
    return [read(name, tuple(dict.fromkeys(places))) for name, places in modules.items()]


def read(name, places):
    """A Library, its modules imported."""
    modules, broken = [], []
    for place in places:
        for module in walk(place, broken):
            if module not in modules:
                modules.append(module)
    homes = {kind: module.__name__ for module in modules for kind in vars(module).values() if offers(module, kind)}
    order = sorted(homes, key=lambda kind: (family_of(homes[kind]), kind.__name__))
    return Library(name, tuple(places), {kind: homes[kind] for kind in order}, tuple(broken))


def offers(module, kind):
    """Whether a module is where a block is to be had: it defines it, or is ours and offers what the language defines,
    such as sums.
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


def walk(name, broken):
    """A module and all below it. What cannot be imported is added to `broken`."""
    try:
        module = importlib.import_module(name)
    except Exception as error:  # whatever a stranger's module does as it is imported, the others are listed
        broken.append((name, name_and_text(error)))
        return
    yield module
    for info in pkgutil.iter_modules(getattr(module, "__path__", ())):
        if not info.name.startswith("_"):
            yield from walk(f"{name}.{info.name}", broken)


def find_library(name, found):
    def plain(text):
        return text.lower().replace("_", "-")

    for library in found:
        if plain(name) in map(plain, (library.name, *(place.split(".")[0] for place in library.modules))):
            return library
    known = [library.name for library in found]
    raise BadInput(
        f"no library {name!r} is installed that brings blocks; "
        f"{suggestion(name, known) or 'there is ' + ', '.join(known)}"
    )


def family_of(home):
    """The module of a block within its library: 'limiters', 'actuators'."""
    return home.split(".")[:2][-1]


def import_line(kind, home):
    """How a diagram imports it: from the outermost package that offers it."""
    parts = home.split(".")
    packages = [".".join(parts[:depth]) for depth in range(1, len(parts) + 1)]
    module = next(package for package in packages if getattr(sys.modules[package], kind.__name__, None) is kind)
    return f"from {module} import {kind.__name__}"


# Lists


def listing(found, console, described):
    """Every block in one line, by library and family."""
    lines = []
    for library in found:
        lines += about(library, console) if described else [title(library, console)]
        for family in dict.fromkeys(map(family_of, library.homes.values())):
            own = [kind for kind, home in library.homes.items() if family_of(home) == family]
            modules = dict.fromkeys(import_line(kind, library.homes[kind]).split()[1] for kind in own)
            lines += [
                "",
                f"  {console.bold(family)}  {console.faint('from ' + ', '.join(modules))}",
                *rows(own, console, "    "),
            ]
        for module, why in library.broken:
            lines += ["", console.error(f"  {module} cannot be imported: {why}")]
        lines.append("")
    return [
        *lines,
        f"{program()} blocks NAME tells all about one, --from LIBRARY about a library, --actuators the "
        "models of actuators",
    ]


def rows(kinds, console, indent=""):
    width = max(len(kind.__name__) for kind in kinds)
    return [console.cut(f"{indent}{kind.__name__:<{width}}  {summary(kind) or 'no docstring'}") for kind in kinds]


def metadata(library) -> Any:
    """What the distribution says of itself; None for a checkout that was not installed."""
    try:
        return importlib.metadata.metadata(library.name)
    except importlib.metadata.PackageNotFoundError:
        return None


def title(library, console):
    data: Any = metadata(library)
    return (
        console.bold(library.name + (f" {data['Version']}" if data else "")) + f"  {count(len(library.homes), 'block')}"
    )


def about(library, console):
    """A library's version, author, and what it was tested with: Pythons that it names, and the Tickwork it needs."""
    data = metadata(library)
    lines = [title(library, console)]
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


def find(name, kinds):
    """The blocks of that name, in whatever way it is written. BadInput with a suggestion if there is none."""
    plain = name.rpartition(".")[2].rpartition(":")[2].replace("_", "").replace("-", "").lower()
    found = [kind for kind in kinds if kind.__name__.lower() == plain]
    if not found:
        known = {kind.__name__.lower(): kind.__name__ for kind in kinds}
        close = suggestion(plain, known)
        hint = f"did you mean {known[close.split(chr(39))[1]]}?" if close else f"{program()} blocks lists them all"
        raise BadInput(f"no block is called {name!r}: {hint}")
    return found


def describe(kind, home, console):
    """All that one block declares."""
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
                + (console.faint("  of an example: its parameters make them") if card["made"] else ""),
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
        lines += ["", console.bold("inputs") + "  any number of signals; unwired, every port"]
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


def exceptions(card):
    """What an exception in a Python block can be made to mean."""
    return "; may be given hold_exceptions" if "Python" in card["runs"] else ""


def source_line(kind):
    """Where its source stands."""
    try:
        return f"{kind.__module__}, line {inspect.getsourcelines(getattr(kind, 'function', kind))[1]}"
    except (OSError, TypeError):
        return kind.__module__


# Actuators


def actuators(console):
    """Return the models of actuators by family: what each holds, what it gives for seconds, its ranges on the wire."""
    lines, notes = [], []
    for plugin in families():
        for table in plugin.tables:
            module = import_line(plugin.drives[0].block, plugin.drives[0].block.__module__).split()[1]
            lines += [*family(console, table.title, f"from {module} import {table.usage}", table.models), ""]
        notes += [plugin.table_note] if plugin.table_note else []
    words = (
        "Rated: held for ever, and the limit of a command by default. Peak: given for seconds, with limit='peak'. "
        "Wire: a scale, not a rating, and of one firmware; wire_torque=... and the like set those of a unit "
        "that differs. Kt: at the output. A - is not published: where it is the rated torque, limit= is needed; where "
        "it is Kt, torque_constant= in servo mode."
    )
    return [*lines, *console.hang("  ", " ".join([words, *notes]))]


def family(console, name, usage, models):
    """The table of one family."""
    columns = "".join(
        f"{text:>10}" for text in ("rated", "peak", "torque", "velocity", "position", "stiffness", "damping", "Kt")
    )
    units = "".join(
        f"{text:>10}" for text in ("N·m", "N·m", "± N·m", "± rad/s", "± rad", "N·m/rad", "N·m·s/rad", "N·m/A")
    )
    lines = [
        console.bold(name) + f"  {usage}",
        "",
        console.faint(f"  {'':<12}{'':>8}{'':>20}{'on the wire':>50}"),
        f"  {'model':<12}{'gear':>8}{columns}",
        console.faint(f"  {'':<12}{'':>8}{units}"),
    ]
    ranges = [f"wire_{name}" for name in ("torque", "velocity", "position", "stiffness", "damping")]
    for model in models.values():
        values = [*(known(value) for value in (model.rated, model.peak, *(getattr(model, name) for name in ranges)))]
        values.append(known(model.torque_constant, ".3g"))
        lines.append(f"  {model.name:<12}{f'{model.gear:g}:1':>8}" + "".join(f"{value:>10}" for value in values))
    return lines


def known(value, spec="g"):
    return "-" if value is None else format(value, spec)
