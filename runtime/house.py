"""Before anything else is imported: are the four packages from one place, built, and is what they need there?

This file and `runtime/__main__.py` must be readable for any Python 3.6 or newer, and import nothing of Tickwork.
"""

import os
import sys
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.util import find_spec
from pathlib import Path

BAD_INPUT = 2
HERE = Path(__file__).parent.parent
OLDEST_PYTHON = (3, 10)
NEEDS = {
    "can": "python-can", "google.protobuf": "protobuf", "matplotlib": "matplotlib", "mcap": "mcap", "msgspec": "msgspec",
    "networkx": "networkx", "numpy": "numpy", "serial": "pyserial", "smbus2": "smbus2",
}
if sys.version_info < (3, 11):                  # later ones read TOML themselves
    NEEDS["tomli"] = "tomli"

READING = ("convert", "diff", "plot")           # commands that need nothing that was compiled
TO_READ = {module: NEEDS[module] for module in ("matplotlib", "mcap", "msgspec", "numpy")}


def trouble(command=""):
    """One line on what keeps a command of Tickwork from starting here, and its cure; None when nothing does."""
    if command in READING:
        return old_python() or missing(TO_READ)
    return old_python() or stranger() or unbuilt() or missing()


def old_python():
    if sys.version_info[:2] < OLDEST_PYTHON:
        return "this is Python %d.%d, and %d.%d or newer is needed: %s" % (sys.version_info[:2] + OLDEST_PYTHON + (cure(),))
    return None


def stranger():
    """A package that another folder has taken the name of: `blocks` and `graph` are words anybody may use."""
    for name in ("cext", "graph", "blocks"):
        place = place_of(name)
        if place is None:
            return "the package `%s` is missing beside %s" % (name, HERE / "runtime")
        if place != os.path.realpath(str(HERE)):
            both = "`%s` comes from %s, but `runtime` from %s" % (name, place, HERE)
            if place == os.path.realpath(sys.path[0]):
                return both + ": start with `tickwork`, which never puts the working folder first, or work in another folder"
            return both + ": rename the one that is not Tickwork's, or take its folder off PYTHONPATH"
    return None


def place_of(name):
    """The folder that holds a top-level package or module, links resolved; None if there is none."""
    spec = find_spec(name)
    if spec is None:
        return None
    where = next(iter(spec.submodule_search_locations or ()), spec.origin)
    return os.path.realpath(os.path.dirname(where))


def unbuilt():
    """Native modules of this clone without a build for this Python. An installed Tickwork has no sources and counts as built."""
    sources = list((HERE / "cext").rglob("*.pyx"))
    if all(any(source.with_suffix(suffix).exists() for suffix in EXTENSION_SUFFIXES) for source in sources):
        return None
    elsewhere = any((HERE / "cext").rglob("*.so"))
    return "%s is not built%s: %s" % (HERE, " for Python %d.%d" % sys.version_info[:2] if elsewhere else "", cure())


def there(module):
    try:
        return find_spec(module) is not None
    except ModuleNotFoundError:                 # not even the package that it is in
        return False


def missing(needs=NEEDS):
    absent = [distribution for module, distribution in needs.items() if not there(module)]
    if not absent:
        return None
    return "%s %s missing in %s: %s" % (", ".join(absent), "is" if len(absent) == 1 else "are", sys.executable, cure())


def explain(error):
    """One line for an ImportError of what is installed beside Tickwork or was built from older sources. Raises it if the fault is ours.

    error : ImportError, raised by importing `runtime.cli`
    """
    culprit = (error.name or "").split(".")[0]
    if culprit in ("blocks", "graph", "runtime"):
        raise error
    first_line = str(error).strip().split("\n")[0]
    if culprit == "cext":
        return "the native code does not fit its sources (%s): %s" % (first_line, "run `make build`" if is_clone() else cure())
    return "%s cannot be imported (%s): %s" % (culprit or "a library", first_line, cure())


def cure():
    environment = HERE / ".venv" / "bin" / "activate"
    if not is_clone():
        return "run `pip install --force-reinstall tickwork`"
    if environment.exists() and os.path.realpath(sys.prefix) != os.path.realpath(str(HERE / ".venv")):
        path = os.path.relpath(str(environment)) if Path.cwd() == HERE else environment
        return "activate the environment (`. %s`) or run `make run`" % path
    return "run `make run`"


def is_clone():
    return (HERE / "Makefile").exists()
