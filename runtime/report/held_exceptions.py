"""Exceptions of Python blocks that were no fault, since the block may hold some: told at the end of a run."""

from runtime.base.exception_text import TEXT_LIMIT, within
from runtime.console.styles import count, relative
from runtime.diagrams.file import own_frames, words


def held(file, program, plant=None):
    """Of each block that held any: block, count, first_tick, last (what the last one said), at (its line, "file:line").

    file : of the diagram; program, plant : cext.schedule.program.Program, the plant's None on a rig
    """
    rows = program.held + (plant.held if plant is not None else [])
    left = within(TEXT_LIMIT)
    return [
        {"block": path, "count": number, "first_tick": first, "last": words(error, left()), "at": place(file, error)}
        for path, number, first, error in rows
    ]


def place(file, error):
    """The innermost line of the user's own that an exception came through; "" where there is none."""
    frames = own_frames(file, error)
    return relative(f"{frames[-1].filename}:{frames[-1].lineno}") if frames else ""


def text(entry, rate):
    """One of `held`, in words."""
    at = f" ({entry['at']})" if entry["at"] else ""
    first = (
        f"the first at {entry['first_tick'] / rate:g} s"
        if entry["count"] > 1
        else f"at {entry['first_tick'] / rate:g} s"
    )
    return f"{entry['block']} held {count(entry['count'], 'exception')}, {first}; the last: {entry['last']}{at}"
