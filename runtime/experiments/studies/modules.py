"""Modules of the user that the diagram and the objectives of a study import, without installed libraries."""

from __future__ import annotations

import ast
import os
import sys
import sysconfig
import threading
from collections.abc import Iterable, Iterator
from contextlib import suppress
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import resolve_name
from pathlib import Path

from graph.sha256 import sha256
from graph.syntax import parse
from runtime.host import diagram_folders

OWN = ("cext", "graph", "blocks", "runtime")
INSTALLED = tuple(sysconfig.get_paths()[name] + os.sep for name in ("stdlib", "platstdlib", "purelib", "platlib"))

_imported: dict[str, str] = {}  # {module: SHA-256 of the source that this process has imported}
_lock = threading.RLock()  # which an interrupted `with` of Python 3.14 leaves to its own thread


def sources(diagram: Path, objectives: Iterable[str]) -> dict[str, str]:
    """Return {name of a module: SHA-256 of its source} of all modules that are imported, directly or by another.

    diagram : path of the diagram file
    objectives : names of functions; those of modules are "module:function"

    The sources are read, not executed: an import that only happens under a condition counts as well.
    """
    folder = os.path.dirname(os.path.realpath(diagram))
    diagram_folders.import_from(folder)
    waiting = [name for objective in objectives if ":" in objective for name in _and_parents(objective.split(":")[0])]
    waiting += _imports(diagram.read_bytes(), "")
    specs: dict[str, ModuleSpec | None] = {}
    digests = {}
    while waiting:
        name = waiting.pop()
        if name in specs:
            continue
        spec = specs[name] = _find(name, folder)
        if spec is None or not spec.has_location or not str(spec.origin).endswith(".py"):
            continue
        with suppress(OSError):
            source = Path(str(spec.origin)).read_bytes()
            digests[name] = sha256(source).hexdigest()
            waiting += _imports(source, name if spec.submodule_search_locations is not None else spec.parent or "")
    return dict(sorted(digests.items()))


def is_imported(digests: dict[str, str]) -> bool:
    """Return whether `import_again` was called with these digests last."""
    return all(_imported.get(name) == digest for name, digest in digests.items())


def import_again(digests: dict[str, str]) -> None:
    """Let this process import modules again if it has imported one of them from another source.

    digests : digests of `sources`, as they are now
    """
    with _lock:
        changed = any(_imported.get(name, digest) != digest for name, digest in digests.items())
        for name in digests if changed else ():  # all, because they may import each other
            sys.modules.pop(name, None)
        _imported.update(digests)


def _find(name: str, folder: str) -> ModuleSpec | None:
    """Return the specification of a module of the user; None for one of a library or a missing one."""
    top = name.partition(".")[0]
    if top in sys.stdlib_module_names or top in OWN:
        return None
    path = None
    for part in _and_parents(name):
        spec = None
        with suppress(ImportError, ValueError):
            finders = (finder.find_spec(part, path) for finder in sys.meta_path if hasattr(finder, "find_spec"))
            spec = next(filter(None, finders), None) or (PathFinder.find_spec(part, [folder]) if path is None else None)
        if spec is None or str(spec.origin).startswith(INSTALLED):
            return None
        path = spec.submodule_search_locations
        if part == name:
            return spec
        if path is None:
            return None
    return None


def _imports(source: bytes, package: str) -> Iterator[str]:
    """Yield the names of the modules that a source may import. package : package to which its relative imports refer"""
    try:
        tree = parse(source)
    except (SyntaxError, ValueError):  # running it reports that
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            try:
                module = resolve_name("." * node.level + (node.module or ""), package) if node.level else node.module
            except ImportError:
                continue
            names = [f"{module}.{alias.name}" for alias in node.names]
        else:
            continue
        for name in names:
            yield from _and_parents(name)


def _and_parents(name: str) -> list[str]:
    """Return ["a", "a.b", "a.b.c"] for "a.b.c"."""
    parts = name.split(".")
    return [".".join(parts[: count + 1]) for count in range(len(parts))]
