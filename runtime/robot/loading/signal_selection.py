"""Selection of signals by name: `left/knee.torque, right, */imu.accel`."""

import re
from fnmatch import fnmatchcase

from runtime.host.errors import BadInput
from runtime.host.suggestions import suggestion


def select(columns: list[dict], text: str) -> list[int]:
    """Return the indices of the columns that a text selects, in ascending order; all for an empty text.

    columns : dicts with "path"
    text : names, separated by commas, of signals, blocks or subsystems; * stands for any text, ? for one character. A
        vector is selected with all its elements, a block or a subsystem with all its signals

    Raises BadInput for a name without a signal.
    """
    selected, names = set(), [name.strip() for name in text.split(",") if name.strip()]
    for name in names:
        places = [place for place, column in enumerate(columns) if matches(name, column["path"])]
        if not places:
            raise BadInput(f"there is no signal {name!r}" + hint(name, columns))
        selected.update(places)
    return sorted(selected) if names else list(range(len(columns)))


def matches(name: str, path: str) -> bool:
    """Return whether a name selects the signal with a path."""
    pattern = name.replace("[", "[[]")  # of an element, not of a set of characters
    ends = [match.start() for match in re.finditer(r"[/.\[]", path)]
    return any(fnmatchcase(path[:end], pattern) for end in (*ends, len(path)))


def hint(name: str, columns: list[dict]) -> str:
    """Return a suggestion for a name without a signal, "" for none."""
    paths = [column["path"] for column in columns]
    known = dict.fromkeys(
        path[: match.start()] if match else path for path in paths for match in (None, *re.finditer(r"[/.\[]", path))
    )
    words = suggestion(name, known) or (f"as in {', '.join(paths[:3])}" if paths else "")
    return f"; {words}" if words else ""
