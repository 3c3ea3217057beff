"""Type stubs of the native modules, generated from their sources: `python -m cext.stubs`.

A stub (`.pyi`) has the functions, classes and constants that Python code can reach: `def` and `cpdef` functions with
the Python types of their C arguments, `readonly` and `public` attributes. Kernels have no types: the stub of a package
of kernels accepts any name.
"""

import functools
import importlib
import re
from collections.abc import Iterator
from pathlib import Path

from cext.kernel import Kernel

HEADER = "# Generated from the source by `python -m cext.stubs`. Do not edit.\n"
UNTYPED = HEADER + "from typing import Any\n\ndef __getattr__(name: str) -> Any: ...\n"
FOLDERS = ("bus", "clock", "kernels/networks", "lines", "memory", "recording", "ring", "safety", "schedule")
ALONE = ("kernels/compiled.pyx", "kernels/filter_bounds.pyx", "kernels/mujoco.pyx")  # modules of other folders
C_TYPES = {"bint": "bool", "double": "float", "float": "float", "object": "Any", "void": "None"}
BARE = {"dict": "dict[Any, Any]", "list": "list[Any]", "tuple": "tuple[Any, ...]"}
PLAIN = {each: each.__name__ for each in (bool, int, float, str, bytes, Kernel)} | {
    tuple: BARE["tuple"],
    dict: BARE["dict"],
}
IMPORTS = {"np": "import numpy as np", "Any": "from typing import Any", "NamedTuple": "from typing import NamedTuple"}
IMPORTS |= {"dataclass": "from dataclasses import dataclass", "Kernel": "from cext.kernel import Kernel"}
IMPORTS["Path"] = "from pathlib import Path"
PARAMETER = re.compile(r"(?P<type>[\w ]*?(?:\[[:1, ]+\] *)?)(?P<name>\*{0,2}\w+)(?: not None)?(?:=(?P<default>.+))?")
FUNCTION = re.compile(r"(?P<result>def|cpdef.*?) ?\b(?P<name>\w+)\((?P<parameters>.*)\).*?(?:-> (?P<annotation>.*))?:")
CLASS = re.compile(r"(?:cdef )?class (?P<name>\w+)(?:\((?P<base>\w+)\))?:")
ATTRIBUTE = re.compile(r"cdef (?:readonly|public) (?P<type>[\w ]+?) (?P<names>\w+(?:, \w+)*)")
FIELD = re.compile(r"(?P<name>\w+): (?P<type>[^=]+?)(?P<default> = .*)?")


def sources() -> list[Path]:
    """Return the sources of the native modules that have a stub."""
    folder = Path(__file__).parent
    return sorted(path for each in (*ALONE, *(f"{name}/*.pyx" for name in FOLDERS)) for path in folder.glob(each))


def packages_of_kernels() -> list[Path]:
    """Return the `__init__.py` of the packages of kernels."""
    return sorted((Path(__file__).parent / "kernels").rglob("__init__.py"))


def module_name(source: Path) -> str:
    """Return the dotted name of the module of a source, as in "cext.bus.bits"."""
    return ".".join(source.with_suffix("").relative_to(Path(__file__).parent.parent).parts)


def statements(source: str) -> Iterator[tuple[int, str]]:
    """Yield (indent, text) of the statements of a source, in one line each, without comments."""
    text, indent = "", 0
    for line in re.sub(r'""".*?"""', "", source, flags=re.DOTALL).splitlines():
        line = re.sub(r"\s*#[^'\"]*$", "", line)
        if not text:
            indent = len(line) - len(line.lstrip())
        text = f"{text} {line.strip()}".strip()
        if text and text.count("(") == text.count(")"):
            yield indent, text
            text = ""


def split(parameters: str) -> list[str]:
    """Split a list of parameters at the commas that are not in brackets."""
    return [part.strip() for part in re.split(r",(?![^(\[]*[)\]])", parameters) if part.strip()]


def python_type(c_type: str, classes: dict[str, str]) -> str:
    """Return the annotation of a C type. classes : {native class: its module}"""
    c_type = c_type.replace("const ", "").strip()
    if "[" in c_type:
        return "bytes | bytearray | memoryview" if "char" in c_type else "np.ndarray"
    if c_type in C_TYPES or c_type in ("str", "bytes", *BARE):
        return (C_TYPES | BARE).get(c_type, c_type)
    if re.fullmatch(r"(unsigned )?(int|long|char|long long|u?int\d+_t|Py_ssize_t)", c_type):
        return "int"
    return c_type if c_type in classes else "Any"


def parameter(text: str, classes: dict[str, str]) -> str:
    """Return a parameter as Python writes it: `int64_t tick=-1` is `tick: int = -1`."""
    match = PARAMETER.fullmatch(text)
    if match is None or match["name"] in ("self", "*"):
        return text
    annotation = python_type(match["type"], classes)
    default = match["default"]
    if default is None:
        return f"{match['name']}: {annotation}"
    if default == "None" and annotation != "Any":
        annotation += " | None"
    literal = re.fullmatch(r"-?[\d.]+|None|True|False|(['\"])\w*\1", default)
    return f"{match['name']}: {annotation} = {default if literal else '...'}"


def function(match: re.Match[str], classes: dict[str, str]) -> str:
    """Return the signature of a function."""
    name = match["name"].replace("__cinit__", "__init__")
    parameters = ", ".join(parameter(each, classes) for each in split(match["parameters"]))
    result = "None" if name == "__init__" else match["annotation"]
    if result is None:
        result = python_type(match["result"].removeprefix("cpdef"), classes)
    return f"def {name}({parameters}) -> {result}: ..."


def members(source: str, classes: dict[str, str]) -> dict[str, list[str]]:
    """Return {class: lines of its members} of a source; "" has the functions of the module."""
    found: dict[str, list[str]] = {"": []}
    owner, decorators = "", []
    for indent, text in statements(source):
        if indent == 0:
            owner = ""
        if match := CLASS.fullmatch(text):
            owner = match["name"]
            found[owner] = [*decorators, f"class {owner}({match['base']}):" if match["base"] else f"class {owner}:"]
        elif (match := FUNCTION.fullmatch(text)) and indent <= 4:
            if match["name"] == "__init__":  # it takes the place of __cinit__
                found[owner] = [line for line in found[owner] if not line.startswith("def __init__(")]
            if match["name"] != "__dealloc__":
                found[owner] += [*decorators, function(match, classes)]
        elif owner and (match := ATTRIBUTE.fullmatch(text)):
            found[owner] += [f"{name}: {python_type(match['type'], classes)}" for name in match["names"].split(", ")]
        elif owner and indent == 4 and (match := FIELD.fullmatch(text)):
            found[owner].append(f"{match['name']}: {match['type']}{' = ...' if match['default'] else ''}")
        decorators = [*decorators, text] if text.startswith("@") and "cython" not in text else []
    return found


@functools.cache
def native_classes() -> dict[str, str]:
    """Return {native class: its module}."""
    return {
        match["name"]: module_name(path)
        for path in sources()
        for _, text in statements(path.read_text())
        if (match := CLASS.fullmatch(text))
    }


def stub(source: Path) -> str:
    """Return the stub of the module of a source, "" if Python code can reach nothing in it."""
    classes = native_classes()
    found = members(source.read_text(), classes)
    declared = source.with_suffix(".pxd")
    for owner, lines in (members(declared.read_text(), classes) if declared.exists() else {}).items():
        if owner in found:
            found[owner][1:1] = [line for line in lines if not line.startswith(("class ", "def "))]
    module = importlib.import_module(module_name(source))
    body = [
        f"{name}: {PLAIN[type(value)]}"
        for name, value in vars(module).items()
        if not name.startswith("_") and type(value) in PLAIN
    ]
    for lines in found.values():
        head, inner = (lines[:1], lines[1:]) if lines and not lines[0].startswith("def ") else ([], lines)
        while inner and head and head[-1].startswith("@"):
            head.append(inner.pop(0))
        if head and not inner:
            head[-1] += " ..."
        body += [*head, *(f"    {line}" if head else line for line in inner)]
    if not body:
        return ""
    words = set(re.findall(r"\w+", "\n".join(body)))
    modules = {name: f"from {home} import {name}" for name, home in classes.items() if name not in found}
    return (
        HEADER + "\n".join([*(line for name, line in (IMPORTS | modules).items() if name in words), "", *body]) + "\n"
    )


if __name__ == "__main__":
    for path in sources():
        if text := stub(path):
            path.with_suffix(".pyi").write_text(text)
    for path in packages_of_kernels():
        path.with_suffix(".pyi").write_text(UNTYPED)
