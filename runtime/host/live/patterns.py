"""Patterns of parameters, such as `*/profile.scale` for that parameter of every leg."""

from __future__ import annotations

from fnmatch import fnmatchcase
from typing import TYPE_CHECKING

from runtime.host.suggestions import suggestion

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable


def is_pattern(name: str) -> bool:
    """Return whether a name contains a wildcard: `*`, `?` or `[`."""
    return any(character in name for character in "*?[")


def matching(name: str, known: Iterable[str]) -> list[str]:
    """Return the names that match a name or pattern, in the order of `known`; `*` matches any characters with "/"."""
    return (
        [other for other in known if fnmatchcase(other, name)]
        if is_pattern(name)
        else [other for other in known if other == name]
    )


def hint(name: str, known: Collection[str]) -> str:
    """Return 'did you mean ...?' for a name or pattern without a match, or ''."""
    return suggestion(name, [*known, *shared_patterns(known)] if is_pattern(name) else known)


def shared_patterns(known: Iterable[str]) -> dict[str, list[str]]:
    """Return {pattern: names} of parameters that several parts of a diagram share.

    '*/profile.scale' matches left/profile.scale and right/profile.scale.
    """
    groups: dict[str, list[str]] = {}
    for name in known:
        _, slash, rest = name.partition("/")
        if slash:
            groups.setdefault(f"*/{rest}", []).append(name)
    return {pattern: names for pattern, names in groups.items() if len(names) > 1}
