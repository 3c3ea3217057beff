"""Before anything else is imported: are the four packages from one place, built, and is what they need there?

This file, `runtime/__main__.py` and `runtime/base/working_folder.py` must be readable for any Python 3.6 or newer, and
import nothing else of Tickwork.
"""

import os
import sys
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.util import find_spec
from pathlib import Path

from runtime.base import working_folder

BAD_INPUT = 2
HERE = Path(__file__).parents[2]
OLDEST_PYTHON = (3, 10)
NEEDS = {
    "can": "python-can",
    "google.protobuf": "protobuf",
    "matplotlib": "matplotlib",
    "mcap": "mcap",
    "msgspec": "msgspec",
    "networkx": "networkx",
    "numpy": "numpy",
    "serial": "pyserial",
    "smbus2": "smbus2",
}
if sys.version_info < (3, 11):  # later ones read TOML themselves
    NEEDS["tomli"] = "tomli"

READING = ("convert", "diff", "plot")  # commands that need nothing that was compiled
TO_READ = {module: NEEDS[module] for module in ("matplotlib", "mcap", "msgspec", "numpy")}

# of Python, while a run is on
LOADED_LATER = ("decimal", "fractions", "getpass", "json", "shlex", "subprocess", "sysconfig", "tomllib")


def trouble(command="", folder=None):
    """One line on what keeps a command of Tickwork from starting here, and its cure; None when nothing does.

    folder : the working folder, where `python -m` has put it on the path
    """
    if command in READING:
        return old_python() or missing(TO_READ)
    return old_python() or stranger(folder) or unbuilt() or missing()


def old_python():
    if sys.version_info[:2] < OLDEST_PYTHON:
        return "this is Python %d.%d, and %d.%d or newer is needed: %s" % (
            sys.version_info[:2] + OLDEST_PYTHON + (cure(),)
        )
    return None


def stranger(folder=None):
    """A package that another folder has taken the name of: `blocks` and `graph` are words anybody may use."""
    for name in ("cext", "graph", "blocks"):
        place = folder if folder and working_folder.namesake(folder, [name]) else place_of(name)
        if place is None:
            return "the package `%s` is missing beside %s" % (name, HERE / "runtime")
        if os.path.realpath(place) != os.path.realpath(str(HERE)):
            both = "`%s` comes from %s, but `runtime` from %s" % (name, place, HERE)
            if place == folder:
                return both + (
                    ": start with `tickwork`, which never puts the working folder first, or work in another folder"
                )
            return both + ": rename the one that is not Tickwork's, or take its folder off PYTHONPATH"
    return None


def namesake(folder):
    """A file of the working folder that bears the name of a library in use. It hides nothing, but the diagram may have
    meant it.
    """
    if folder is None:
        return None
    ours = ("blocks", "cext", "graph", "runtime")
    names = {
        name
        for name in sys.modules
        if not name.startswith("__") and name not in ours and name not in sys.builtin_module_names
    }
    names.update((name.split(".")[0] for name in NEEDS), LOADED_LATER)
    for name in sorted(names):
        path = working_folder.namesake(folder, [name])
        if path is not None and place_of(name) != os.path.realpath(folder):
            return (
                "%s bears the name of a library that Tickwork uses: rename it, or start with `tickwork`, which "
                "ignores it"
            ) % path
    return None


def place_of(name):
    """The folder that holds a top-level package or module, links resolved; None if there is none."""
    spec = find_spec(name)
    if spec is None:
        return None
    where = next(iter(spec.submodule_search_locations or ()), spec.origin)
    return os.path.realpath(os.path.dirname(where))


def unbuilt():
    """Native modules of this clone without a build for this Python. An installed Tickwork has no sources and counts as
    built.
    """
    sources = list((HERE / "cext").rglob("*.pyx"))
    if all(any(source.with_suffix(suffix).exists() for suffix in EXTENSION_SUFFIXES) for source in sources):
        return None
    elsewhere = any((HERE / "cext").rglob("*.so"))
    return "%s is not built%s: %s" % (HERE, " for Python %d.%d" % sys.version_info[:2] if elsewhere else "", cure())


def there(module):
    try:
        return find_spec(module) is not None
    except ModuleNotFoundError:  # not even the package that it is in
        return False


def missing(needs=NEEDS):
    absent = [distribution for module, distribution in needs.items() if not there(module)]
    if not absent:
        return None
    return "%s %s missing in %s: %s" % (", ".join(absent), "is" if len(absent) == 1 else "are", sys.executable, cure())


def explain(error):
    """One line for an ImportError of what is installed beside Tickwork or was built from older sources. Raises it if
    the fault is ours.

    error : ImportError, raised by importing `runtime.cli.main`
    """
    culprit = (error.name or "").split(".")[0]
    if culprit in ("blocks", "graph", "runtime"):
        raise error
    first_line = str(error).strip().split("\n")[0]
    if culprit == "cext":
        return "the native code does not fit its sources (%s): %s" % (
            first_line,
            "run `make build`" if is_clone() else cure(),
        )
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
