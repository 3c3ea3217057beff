"""The command `tickwork`. It starts the `runtime` beside this file, and reports another package of that name.

This file must parse on Python 3.6 or newer, and import nothing of Tickwork before the check.
"""

import os
import sys
from importlib.util import find_spec

HERE = os.path.dirname(os.path.realpath(__file__))
BAD_INPUT = 2


def main() -> None:
    """Run the command line, and end the process with its exit code."""
    problem = shadowed_runtime()
    if problem is None:
        try:
            from runtime.__main__ import main as command_line
        except (EOFError, ValueError, TypeError, ImportError) as error:
            sys.pycache_prefix = os.devnull  # ignore all caches
            from runtime.host.installation_check import damaged_cache

            problem = damaged_cache(error)
            if problem is None:
                raise
    if problem is not None:
        print("tickwork: " + problem, file=sys.stderr)
        sys.exit(BAD_INPUT)
    command_line()


def shadowed_runtime() -> "str | None":
    """Return one line on another package `runtime` that comes first on the path; None if it is Tickwork's."""
    spec = find_spec("runtime")
    place = spec and next(iter(spec.submodule_search_locations or ()), spec.origin)
    if place and os.path.realpath(os.path.dirname(place)) == HERE:
        return None
    return "`runtime` is %s, but Tickwork is in %s: %s" % (
        place or "missing",
        HERE,
        "rename the one that is not Tickwork's, or take its folder off PYTHONPATH",
    )


if __name__ == "__main__":
    sys.exit("tickwork: start with the command `tickwork`, or with `python -m runtime`")
