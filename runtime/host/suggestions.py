"""Suggestions for misspelt words.

Imports nothing of graph, whose graph.names has the same function, so that it works without compiled modules.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

SIMILARITY = 0.65  # smallest ratio of difflib, from 0 to 1


def suggestion(word: str, known: Iterable[str]) -> str:
    """Return 'did you mean ...?' for a misspelt word, or ''."""
    import difflib  # for a mistake alone

    near = difflib.get_close_matches(str(word), list(known), n=1, cutoff=SIMILARITY)
    return f"did you mean {near[0]!r}?" if near else ""


def unknown_option(name: str, known: Iterable[str]) -> str:
    """Return the error message for an option that does not exist. known : names of those that do"""
    hint = suggestion(name.partition("=")[0], known)
    return f"there is no option {name}" + (f"; {hint}" if hint else "")
