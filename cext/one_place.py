"""Check that Tickwork's packages come from one folder: `graph`, `blocks` and `runtime` are common names."""

import os
from importlib.util import find_spec


def check_place(name: str, file: str) -> None:
    """Raise ImportError if a package is not the one beside a file of Tickwork.

    name : of the package
    file : `__file__` of a module at the top of one of Tickwork's packages
    """
    home = os.path.dirname(os.path.dirname(os.path.realpath(file)))
    spec = find_spec(name)
    if spec is None:
        raise ImportError(f"the package `{name}` is missing in {home}: install Tickwork again", name=name)
    place = os.path.realpath(next(iter(spec.submodule_search_locations or ()), spec.origin or ""))
    if place != os.path.join(home, name):
        raise ImportError(
            f"`{name}` is {place}, which hides Tickwork's {os.path.join(home, name)}: rename or uninstall the other "
            f"package, or run where its folder is not on the path",
            name=name,
        )
