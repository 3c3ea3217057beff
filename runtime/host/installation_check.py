"""Check of the installation before any other import: packages from one place, compiled modules, libraries.

This file, `runtime/__main__.py`, and `ending.py`, `run_mark.py` and `working_folder.py` beside it must parse on Python
3.6 or newer, and import nothing else of Tickwork.
"""

import os
import re
import shlex
import sys
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.util import find_spec
from pathlib import Path

from runtime.host import working_folder

BAD_INPUT = 2
DAMAGED = "bytecode cache"  # `name` of an ImportError whose text is that of `damaged_cache`
HERE = Path(__file__).parents[2]
OLDEST_PYTHON = (3, 10)
MODULES = {  # modules of required distributions whose names differ
    "protobuf": "google.protobuf",
    "pyserial": "serial",
    "python-can": "can",
    "resvg-py": "resvg_py",
}

READING = ("convert", "diff", "plot", "view")  # commands that need no compiled modules
TO_READ = ("matplotlib", "mcap", "msgspec", "numpy", "zstandard")  # distributions that they require

# standard modules that a run imports later
LOADED_LATER = ("decimal", "fractions", "getpass", "json", "shlex", "subprocess", "sysconfig", "tomllib")


def problem(command: str = "", folder: "str | None" = None) -> "str | None":
    """Return one line on a problem that prevents the start of a command, with its remedy; None without a problem.

    command : first word of the command line, such as "run"
    folder : the working folder, if `python -m` has put it on the path
    """
    if command in READING:
        return _old_python() or _missing(TO_READ)
    return _old_python() or _shadowed_package(folder) or _unbuilt() or _missing(required_packages())


def _old_python() -> "str | None":
    """Return a message on a Python that is older than OLDEST_PYTHON."""
    if sys.version_info[:2] < OLDEST_PYTHON:
        return "this is Python %d.%d, but %d.%d or newer is required: %s" % (
            sys.version_info[:2] + OLDEST_PYTHON + (_remedy(),)
        )
    return None


def _shadowed_package(folder: "str | None" = None) -> "str | None":
    """Return a message on a package that another folder shadows, since `blocks` and `graph` are common names."""
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


def namesake(folder: "str | None") -> "str | None":
    """Return a message on a file of the working folder with the name of a library in use.

    It does not shadow the library, but the diagram may have intended to import it.
    """
    if folder is None:
        return None
    ours = ("blocks", "cext", "graph", "runtime")
    names = {
        name
        for name in sys.modules
        if not name.startswith("__") and name not in ours and name not in sys.builtin_module_names
    }
    names.update((MODULES.get(name, name).split(".")[0] for name in required_packages()), LOADED_LATER)
    for name in sorted(names):
        path = working_folder.namesake(folder, [name])
        if path is not None and place_of(name) != os.path.realpath(folder):
            return (
                "%s has the name of a library that Tickwork uses: rename it, or start with `tickwork`, which ignores it"
            ) % path
    return None


def place_of(name: str) -> "str | None":
    """Return the folder of a top-level package or module, with links resolved; None if there is none."""
    spec = find_spec(name)
    if spec is None:
        return None
    where = next(iter(spec.submodule_search_locations or ()), spec.origin)
    return os.path.realpath(os.path.dirname(where)) if where else None


def _unbuilt() -> "str | None":
    """Return a message on compiled modules that are missing for this Python.

    An installed Tickwork has no sources and counts as built.
    """
    sources = list((HERE / "cext").rglob("*.pyx"))
    if all(any(source.with_suffix(suffix).exists() for suffix in EXTENSION_SUFFIXES) for source in sources):
        return None
    elsewhere = any((HERE / "cext").rglob("*.so"))
    return "%s is not built%s: %s" % (HERE, " for Python %d.%d" % sys.version_info[:2] if elsewhere else "", _remedy())


def _is_importable(module: str) -> bool:
    """Return whether Python finds a module; does not import it."""
    try:
        return find_spec(module) is not None
    except ModuleNotFoundError:  # its package is missing
        return False


def required_packages() -> "list[str]":
    """Return the names of the distributions that Tickwork requires on this Python.

    They are in pyproject.toml of a clone, and otherwise in the metadata of the installation, whose module takes as long
    to import as the rest of this check.
    """
    project = HERE / "pyproject.toml"
    if project.exists():
        declared = re.search(r"(?ms)^dependencies = \[(.*?)^\]", project.read_text())
        requirements = re.findall('"([^"]+)"', declared.group(1)) if declared else []
    else:
        from importlib import metadata  # of Python 3.8

        try:
            requirements = metadata.requires("tickwork") or []
        except metadata.PackageNotFoundError:
            requirements = []
    names: list[str] = []
    for requirement in requirements:
        name, _, marker = requirement.partition(";")
        older = re.search(r"^ *python_version < .3\.(\d+).$", marker)
        if not marker or (older and sys.version_info < (3, int(older.group(1)))):
            names.append(re.split(r"[^\w.-]", name)[0])
    return names


def _missing(distributions: "list[str] | tuple[str, ...]") -> "str | None":
    """Return a message on distributions that are not installed."""
    absent = [name for name in distributions if not _is_importable(MODULES.get(name, name))]
    if not absent:
        return None
    return "%s %s missing in %s: %s" % (
        ", ".join(absent),
        "is" if len(absent) == 1 else "are",
        sys.executable,
        _remedy(),
    )


def damaged_cache(error: BaseException) -> "str | None":
    """Return one line on an import that has failed at a damaged bytecode cache; None for any other exception.

    A full disk leaves truncated caches, which Python neither rejects nor replaces.
    """
    if getattr(error, "name", None) == DAMAGED:
        return str(error)
    path = getattr(error, "path", None)  # of an ImportError, whose traceback has no frames of the import system
    trace, place = error.__traceback__, None
    while trace is not None:
        code = trace.tb_frame.f_code
        if code.co_filename.startswith("<frozen importlib") and code.co_name in ("get_code", "_compile_bytecode"):
            path, place = trace.tb_frame.f_locals.get("bytecode_path"), code.co_name
        elif place is not None:  # an error of the source
            return None
        trace = trace.tb_next
    if not path or not path.endswith(".pyc") or place == "get_code" and not isinstance(error, EOFError):
        return None
    return "the bytecode cache %s is damaged (%s), as after a full disk: run `rm -r %s`; Python creates it again" % (
        path,
        str(error) or type(error).__name__,
        shlex.quote(os.path.dirname(path)),
    )


def explain(error: ImportError) -> str:
    """Return one line on an ImportError of a library or of outdated compiled modules. Raises all others again.

    error : ImportError of importing `runtime.cli.main` or a command
    """
    damaged = damaged_cache(error)
    if damaged is not None:
        return damaged
    culprit = (error.name or "").split(".")[0]
    if culprit in ("blocks", "graph", "runtime"):
        others = _others_of(culprit)
        if not others:
            raise error
        again = "make run" if _is_clone() else "pip install --force-reinstall --no-deps tickwork"
        return "the package %s has replaced files of Tickwork's `%s` in %s: run `pip uninstall -y %s && %s`" % (
            others[0],
            culprit,
            HERE / culprit,
            others[0],
            again,
        )
    cause = error  # NumPy replaces an error by advice
    while cause.__cause__ is not None:
        cause = cause.__cause__
    first_line = str(cause).strip().split("\n")[0]
    if culprit == "cext":
        return "the compiled modules do not match their sources (%s): %s" % (
            first_line,
            "run `make build`" if _is_clone() else _remedy(),
        )
    return "%s cannot be imported (%s): %s" % (culprit or "a library", first_line, _remedy())


def _others_of(package: str) -> "list[str]":
    """Return the names of other distributions that have installed files into one of Tickwork's packages."""
    from importlib.metadata import distributions  # of Python 3.8

    names = {
        other.metadata["Name"] for other in distributions() for file in other.files or () if file.parts[0] == package
    }
    return sorted(names - {"tickwork"})


def _remedy() -> str:
    """Return the command that repairs this installation."""
    environment = HERE / ".venv" / "bin" / "activate"
    if not _is_clone():
        return "run `pip install --force-reinstall tickwork`"
    if environment.exists() and os.path.realpath(sys.prefix) != os.path.realpath(str(HERE / ".venv")):
        path = os.path.relpath(str(environment)) if Path.cwd() == HERE else environment
        return "activate the environment (`. %s`) or run `make run`" % path
    return "run `make run`"


def _is_clone() -> bool:
    """Return whether this is a checkout of the sources, in contrast to an installed package."""
    return (HERE / "Makefile").exists()
