"""Plug-ins: objects of ours by name, and those of installed packages by entry point."""

from __future__ import annotations

import pkgutil
from importlib import import_module
from importlib.metadata import entry_points
from typing import TYPE_CHECKING, Any

from runtime.host.errors import BadInput
from runtime.host.suggestions import suggestion

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping


def modules_of(package: str) -> dict[str, str]:
    """Return {name: "package.name"} of the modules of a package, which are not imported."""
    return {info.name: f"{package}.{info.name}" for info in pkgutil.iter_modules(import_module(package).__path__)}


class Plugins:
    """The plug-ins of one kind.

    group : entry-point group in which a package lists its own, such as "tickwork.sinks"
    own : {name: "module" or "module:attribute"} of ours, which need no installed distribution and cannot be replaced
    """

    def __init__(self, group: str, own: Mapping[str, str]) -> None:
        self.group, self.own = group, own

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names of all plug-ins, ours first."""
        return iter(dict.fromkeys([*self.own, *sorted(point.name for point in entry_points(group=self.group))]))

    def load(self, name: str) -> Any:
        """Import a plug-in by its name, or by "module:attribute".

        Raises BadInput if no installed package has the name; ImportError or AttributeError from its module.
        """
        if name in self.own or ":" in name:
            module, _, attribute = self.own.get(name, name).partition(":")
            module = import_module(module)
            return getattr(module, attribute) if attribute else module
        for point in entry_points(group=self.group, name=name):
            return point.load()
        known = list(self)
        hint = suggestion(name, known) or f"expected one of {', '.join(known)}"
        raise BadInput(f"no installed package has {name!r} in the entry-point group {self.group!r}; {hint}")
