"""Exceptions that Python blocks held without a fault, for the end of a run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from cext.user_text import TEXT_LIMIT, within
from runtime.host.console.styles import count, relative
from runtime.robot.loading.file import own_frames, words

if TYPE_CHECKING:
    from pathlib import Path

    from cext.schedule.program import Program


def held_exceptions(file: Path, program: Program, plant: Program | None = None) -> list[dict[str, Any]]:
    """Return the held exceptions, one dict for each block that held any.

    Keys: block, count, first_tick, last (message of the last exception), at (its line, "file:line").

    file : path of the diagram
    program, plant : cext.schedule.program.Program; plant is None on a rig
    """
    rows = program.held + (plant.held if plant is not None else [])
    left = within(TEXT_LIMIT)
    return [
        {"block": path, "count": number, "first_tick": first, "last": words(error, left()), "at": place(file, error)}
        for path, number, first, error in rows
    ]


def place(file: Path, error: BaseException) -> str:
    """Return the innermost line in the user's files that raised an exception; "" if there is none."""
    frames = own_frames(file, error)
    return relative(f"{frames[-1].filename}:{frames[-1].lineno}") if frames else ""


def text(entry: Mapping[str, Any], rate: float) -> str:
    """Return an entry of held() as text. rate : Hz of the run"""
    at = f" ({entry['at']})" if entry["at"] else ""
    first = (
        f"the first at {entry['first_tick'] / rate:g} s"
        if entry["count"] > 1
        else f"at {entry['first_tick'] / rate:g} s"
    )
    return f"{entry['block']} held {count(entry['count'], 'exception')}, {first}; the last: {entry['last']}{at}"
