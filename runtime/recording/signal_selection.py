"""Which signals are meant: `left/knee.torque, right, */imu.accel`."""

import re
from fnmatch import fnmatchcase

from runtime.base.errors import BadInput
from runtime.base.suggestions import suggestion


def chosen(columns, text):
    """Places of the columns that a text names, in their order; all for an empty one. BadInput, where one of its names
    means nothing.

    A name is that of a signal, of all elements of one, of a block or of a subsystem with what is in it; * stands for
    any text, ? for one character.
    """
    found, names = set(), [name.strip() for name in text.split(",") if name.strip()]
    for name in names:
        places = [place for place, column in enumerate(columns) if means(name, column["path"])]
        if not places:
            raise BadInput(f"there is no signal {name!r}" + hint(name, columns))
        found.update(places)
    return sorted(found) if names else list(range(len(columns)))


def means(name, path):
    pattern = name.replace("[", "[[]")  # of an element, not of a set of characters
    ends = [match.start() for match in re.finditer(r"[/.\[]", path)]
    return any(fnmatchcase(path[:end], pattern) for end in (*ends, len(path)))


def hint(name, columns):
    paths = [column["path"] for column in columns]
    known = dict.fromkeys(
        path[: match.start()] if match else path for path in paths for match in (None, *re.finditer(r"[/.\[]", path))
    )
    words = suggestion(name, known) or (f"as in {', '.join(paths[:3])}" if paths else "")
    return f"; {words}" if words else ""
