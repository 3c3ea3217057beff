"""Names of blocks, ports and parameters: validation, derivation, suggestions for misspelt names."""

import difflib
import re
from collections.abc import Iterable, Sized

from cext.user_text import repr_of
from graph.diagnostics import Diagnostic, DiagramError, Location

NAME_LENGTH_LIMIT = 100  # characters
SIMILARITY = 0.65  # smallest ratio of difflib, from 0 to 1, of a suggested word


def check_name(name: object, where: Location | None) -> None:
    """Raise DiagramError TW010 unless paths, columns, file names and command lines can carry the name.

    `/` separates subsystems and `.` ports; `=` separates a setting from its value.

    where : source location for the diagnostic
    """
    if (
        isinstance(name, str)
        and name.strip()
        and name.isprintable()
        and not set(name) & set("/.=")
        and len(name) <= NAME_LENGTH_LIMIT
    ):
        return
    raise DiagramError(
        Diagnostic(
            "TW010",
            f"{repr_of(name, NAME_LENGTH_LIMIT)} cannot be a name",
            where=where,
            hint=f"a name is printable text of at most {NAME_LENGTH_LIMIT} characters without '/', '.' and '='; "
            'subsystems make paths, as in `with subsystem("left")`',
        )
    )


def snake_case(name: str) -> str:
    """Convert a class name: TorqueLimiter to torque_limiter, PID to pid, LookupTable1D to lookup_table_1d."""
    return re.sub(r"(?<=[a-z])(?=[A-Z]|[0-9][A-Z](?![a-z]))|(?<=[A-Z0-9])(?=[A-Z][a-z])", "_", name).lower()


def count(items: Sized, noun: str) -> str:
    """Return how many items there are, with their noun: "1 input", "2 inputs"."""
    return f"{len(items)} {noun}{'' if len(items) == 1 else 's'}"


def suggestion(word: object, known: Iterable[str]) -> str:
    """Return "did you mean ...?" with the known word closest to a misspelt one, or ""."""
    close = difflib.get_close_matches(str(word), list(known), n=1, cutoff=SIMILARITY)
    return f"did you mean {close[0]!r}?" if close else ""
