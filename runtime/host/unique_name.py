"""Unique names in a format that cannot carry two of the same."""

from __future__ import annotations

from itertools import count
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable


def unique(name: str, is_taken: Callable[[str], bool], length_limit: int | None = None) -> str:
    """Return the name, or else the first of name_2, name_3, ... that is not taken.

    is_taken : function of a name
    length_limit : most characters of the result, None for any
    """
    for number in count(1):
        suffix = f"_{number}" if number > 1 else ""
        candidate = name if length_limit is None else name[: length_limit - len(suffix)]
        if not is_taken(candidate + suffix):
            return candidate + suffix
    raise AssertionError
