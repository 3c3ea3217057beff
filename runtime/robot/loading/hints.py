"""Remedies for exceptions of user code: a missing import, a misspelt name, a call of the wrong object."""

from __future__ import annotations

import os
import pkgutil
import re
import sys
import traceback
from collections.abc import Mapping
from dataclasses import FrozenInstanceError
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

import graph
from cext.user_text import text_of
from graph import Actuator, Block, Diagram, Input, Param, Signal, subsystem
from graph.declarations import Declaration
from graph.hints import usual_command
from runtime.host.installation_check import damaged_cache
from runtime.host.suggestions import suggestion

ALIASES = {"np": "numpy as np", "pd": "pandas as pd", "plt": "matplotlib.pyplot as plt"}
DISTRIBUTIONS = {  # {module: distribution} of libraries with another name
    "PIL": "pillow",
    "cv2": "opencv-python",
    "rerun": "rerun-sdk",
    "sklearn": "scikit-learn",
    "yaml": "pyyaml",
}
RUN = "run it with `python -m runtime FILE`, or with runtime.run(diagram, duration=10)"
DIAGRAM_METHODS = {
    **dict.fromkeys(("run", "start", "simulate", "main", "execute"), RUN),
    "compile": "call compile(diagram), from graph import compile",
    **dict.fromkeys(("draw", "plot"), "draw it with `python -m runtime draw FILE`"),
    **dict.fromkeys(("connect", "add_block", "add_connection"), "call a block with its inputs, as in block(signal)"),
}


BLOCKS_OF_DIAGRAM = 'its blocks are diagram["left/knee"], by their paths, and `for block in diagram`'


def hint(path: str | os.PathLike[str], error: BaseException) -> str:
    """Return the remedy for an exception of user code, or "". path : path of the diagram file"""
    if damaged := damaged_cache(error):
        return damaged
    if isinstance(error, ImportError):
        return for_import(path, error)
    if isinstance(error, RecursionError):
        runs = [frame for frame in traceback.extract_stack() if frame.name == "execute"]
        return "the file runs itself: run it from another file, or in `if __name__ == '__main__':`" if runs[1:] else ""
    if isinstance(error, FrozenInstanceError) and isinstance(names_at(error).get("self"), Signal):
        return "a signal cannot be assigned to: connect it, as in block(signal)"
    if isinstance(error, AttributeError):
        return for_attribute(error)
    if isinstance(error, NameError):
        return for_name(error.name or "", names_at(error))
    return for_type(text_of(error), names_at(error)) if isinstance(error, TypeError) else ""


def names_at(error: BaseException) -> Mapping[str, Any]:
    """Return the names that are visible where an exception was raised, with their values."""
    entry = error.__traceback__
    while entry is not None and entry.tb_next is not None:
        entry = entry.tb_next
    return {} if entry is None else {**entry.tb_frame.f_globals, **entry.tb_frame.f_locals}


def import_of(name: str) -> str:
    """Return the line that imports a block, a name of graph, or a module; "" without one."""
    from runtime.robot.loading.catalog import libraries

    if name in graph.__all__:
        return f"from graph import {name}"
    homes = {kind.__name__: home for library in libraries() for kind, home in library.homes.items()}
    if name in homes:
        home = homes[name]
        while hasattr(sys.modules.get(home.rpartition(".")[0]), name):  # the package that exports it
            home = home.rpartition(".")[0]
        return f"from {home} import {name}"
    module = ALIASES.get(name, name)
    return f"import {module}" if name.isidentifier() and find_spec(module.split(".")[0].split(" ")[0]) else ""


def for_name(name: str, names: Mapping[str, Any]) -> str:
    """Return the remedy for an undefined name. names : names that are defined, with their values"""
    block = names.get("self")
    if isinstance(block, Block) and name in block.parameters:
        return f"it is a parameter: read self.{name}"
    line = import_of(name)
    catalog = "`python -m runtime blocks` lists all blocks" if name[:1].isupper() else ""
    return f"add the line `{line}`" if line else suggestion(name, names) or catalog


def for_import(path: str | os.PathLike[str], error: ImportError) -> str:
    """Return the remedy for a failed import: a similar name, another module, or a file that a library shadows."""
    name = error.name or ""
    top, module, path = name.partition(".")[0], sys.modules.get(name), Path(path)
    neighbour = path.parent / f"{top}.py"
    file = getattr(module, "__file__", None) or ""
    if module is not None and neighbour.exists() and os.path.realpath(file) != os.path.realpath(neighbour):
        return f"{neighbour.name} beside {path.name} has the name of a library: rename it"
    if top == "tickwork":
        return "import from the packages graph, blocks and runtime, as in `from graph import Diagram`"
    if isinstance(error, ModuleNotFoundError):
        if find_spec(top) is None:
            return f"install its library, as in: pip install {DISTRIBUTIONS.get(top, top.replace('_', '-'))}"
        package = sys.modules.get(name.rpartition(".")[0])
        modules = pkgutil.iter_modules(getattr(package, "__path__", ()), f"{name.rpartition('.')[0]}.")
        return suggestion(name, [entry.name for entry in modules])
    if "relative import" in text_of(error):
        return "the file is not in a package: omit the dot, as in `from wearer import plant`"
    missing = re.match(r"cannot import name '(\w+)'", text_of(error))
    if missing is None or module is None:
        return ""
    if top in ("blocks", "graph") and (line := import_of(missing[1])):
        return f"it is in another module: write `{line}`"
    names = [known for known, value in vars(module).items() if known[0] != "_" and not isinstance(value, ModuleType)]
    named = {known.casefold(): known for known in names}.get(missing[1].casefold())
    blocks = [known for known in names if is_block_of(name, getattr(module, known))]
    listed = f"its blocks are {', '.join(sorted(blocks))}" if blocks else ""
    return f"did you mean {named!r}?" if named else suggestion(missing[1], names) or listed


def is_block_of(module: str, value: Any) -> bool:
    """Return whether a value is a class of blocks that a module defines, or one of its modules, for diagrams."""
    known = isinstance(value, type) and issubclass(value, Block) and value.__module__.startswith(module)
    return known and not value.__name__.startswith("Emulated")


def for_attribute(error: AttributeError) -> str:
    """Return the remedy for an attribute that an object does not have: a similar name, or where to find it."""
    of: Any = error.obj
    name = error.name or ""
    if isinstance(of, Diagram):
        return DIAGRAM_METHODS.get(name) or suggestion(name, dir(of)) or BLOCKS_OF_DIAGRAM
    if isinstance(of, subsystem):
        return BLOCKS_OF_DIAGRAM
    if type(of).__name__ == "Outputs":
        return suggestion(name, of._fields) or f"its signals are {', '.join(of._fields)}"
    if not isinstance(of, Block):
        return ""
    if isinstance(of, Actuator) and re.match(r"(set|send|write|command|move|apply)", name):
        return f"call the block to command it, as in {of.path.split('/')[-1]}({usual_command(of)}=...)"
    if of.is_python and name in ("t", "time", "tick"):
        return f"take it as an argument, as in def step(self, {', '.join([*of.inputs, 't'])})"
    frames = [frame for frame, _ in traceback.walk_tb(error.__traceback__)]
    if of.is_python and any(frame.f_locals.get("self") is of for frame in frames):  # in its own methods
        return suggestion(name, [*of.outputs, *of.inputs, *of.parameters]) or (
            f"set it in reset(self), as in self.{name} = 0.0"
        )
    similar = suggestion(name, of.outputs) or suggestion(name, [*of.inputs, *of.parameters])
    listed = f"its outputs are {', '.join(of.outputs) or 'none'}"
    return f"{similar} {listed[0].upper()}{listed[1:]}" if similar else listed


def for_type(text: str, names: Mapping[str, Any]) -> str:
    """Return the remedy for a TypeError.

    text : text of the error
    names : names that are visible where the error was raised, with their values
    """
    kinds = [names[word] for word in re.findall(r"\w+", text) if isinstance(names.get(word), type)]
    kind = next(iter(kinds), object)
    if "Param.__init__()" in text:
        return 'as in Param(1.0, "N·m", "description", min=0.0, max=5.0)'
    if re.search(r"(In|Out)put\.__init__\(\)", text):
        return 'give its unit, as in Input("rad"); "1" is a number without a unit, and "any" is any unit'
    if text.startswith("block() missing"):
        return "omit the parentheses of the decorator: @block"
    if "'Signal' object is not callable" in text:
        return "omit the parentheses: a signal is connected, as in block(knee.position)"
    block = names.get("self")
    if "'NoneType'" in text and isinstance(block, Block):
        empty = next((name for name in block.parameters if getattr(block, name) is None), "")
        if empty:
            return f"the parameter {empty} is None: pass a value, or declare a default, as in {empty} = Param(1.0)"
    if outputs := re.search(r"\.step must return \d+ values \((.*?)\)", text):
        return f"return the outputs in their order, as in `return {outputs[1]}`"
    if "returned None" not in text and (
        shapes := re.search(r"for (\w+): expected shape (\(.*\)), got (\(.*\))$", text)
    ):
        output, declared, returned = shapes.groups()
        return f"return an array of shape {declared}, or declare {output} with shape={returned}"
    if re.search(r"\.step returned (array\(|\[).*: (only|must be real number, not)", text, re.DOTALL):
        return 'return one number for a scalar output, or declare its shape, as in Output("1", shape=(3,))'
    if "Diagram.__init__()" in text:
        return 'pass the name and the rate in Hz, as in Diagram("knee", rate=200)'
    if "__init__() got an unexpected keyword" in text and issubclass(kind, Block):
        return f"remove {kind.__name__}.__init__ and set state in reset(self), or pass **named to super().__init__()"
    if "not callable" in text and any(isinstance(value, Declaration) for value in vars(kind).values()):
        return f"derive the class from Block: class {kind.__name__}(Block)"
    if ("operand" in text and issubclass(kind, Input)) or ".step returned Input(" in text:
        return "take an input as an argument of the step, as in def step(self, angle)"
    if "operand" in text and issubclass(kind, Param):
        return "a parameter has a value in a block only: read it in a method, as in self.gain"
    if re.search("operand|subscriptable|iterable", text) and issubclass(kind, Block):
        if len(kind.outputs) > 1:
            return f"choose one of its outputs: {', '.join(kind.outputs)}"
        return f"call the block to get its output, as in {kind.__name__}(...)()"
    return "end the step with `return`" if ".step returned None" in text else ""
