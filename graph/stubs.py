"""Type stubs of modules with blocks, generated from the declarations: `python -m runtime stubs mylab/blocks.py`.

A stub (`.pyi`) gives each block class a constructor with its parameters, a call with its inputs, and its outputs as
attributes, so that editors complete them and type checkers report a misspelt one. Docstrings have the unit and the
description of each. Other functions and classes keep their signatures. Classes whose parameters make ports accept any
input, or have any output.
"""

from __future__ import annotations

import ast
import copy
import errno
import functools
import importlib
import inspect
import keyword
import math
import sys
import textwrap
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any, TypeGuard

from graph.block import Block, Sink
from graph.declarations import Declaration, Input, Memory, Output, Param

HEADER = """# Generated from the declarations by `python -m runtime stubs`. Do not edit.
# mypy: disable-error-code="override"
# pyright: reportIncompatibleMethodOverride=false, reportIncompatibleVariableOverride=false
"""
TYPING = "from typing import Any, Literal, NamedTuple"
NUMPY = "import numpy as np"
UNPACK = "from typing_extensions import Unpack"
BLOCK = "from graph.block import BlockOptions"
LANGUAGE = "from graph.declarations import Input, Live, Memory, Output, Param"
OPERANDS = "from graph.signal import Operand, Signal"
PLAIN: dict[object, str] = {bool: "bool", int: "int", float: "float", str: "str", bytes: "bytes"}
SEQUENCE = "Sequence[Any] | np.ndarray"
WIDTH = 120


def has_blocks(module: ModuleType) -> bool:
    """Return whether a module defines a block class with declarations, and so has a stub."""
    return any(is_block_class(kind) and kind.__module__ == module.__name__ for kind in vars(module).values())


def is_block_class(kind: object) -> TypeGuard[type[Block]]:
    """Return whether a value is a class of blocks."""
    return isinstance(kind, type) and issubclass(kind, Block)


def stub(module: Any) -> str:
    """Return the stub of an imported module. Raises OSError if it has no source file."""
    tree = ast.parse(inspect.getsource(module))
    typing_only = [each for node in tree.body if is_typing_only(node) for each in node.body]
    tree.body = [*typing_only, *(node for node in tree.body if not is_typing_only(node))]
    body = [text for node in tree.body for text in statement(module, node)]
    used = words("\n".join(body))
    inside = words_outside_imports(tree)
    imported = [line for node in tree.body for line in imports(node, used, inside)]
    lines = [TYPING, "from collections.abc import Sequence", UNPACK, NUMPY, BLOCK, LANGUAGE, OPERANDS]
    own = {name for node in tree.body for name in names_of(node)}
    head = [line for text in lines for line in only_used(text, used, own)]
    return HEADER + "\n".join([*dict.fromkeys([*head, *imported]), "", *body]) + "\n"


def is_typing_only(node: ast.stmt) -> TypeGuard[ast.If]:
    """Return whether a statement is `if TYPE_CHECKING:`."""
    return isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"


def only_used(line: str, used: set[str], own: set[str]) -> Iterator[str]:
    """Yield an import without names that the stub does not use, or that the module defines or imports itself."""
    node = ast.parse(line).body[0]
    assert isinstance(node, (ast.Import, ast.ImportFrom))
    node.names = [alias for alias in node.names if (name := alias.asname or alias.name) in used and name not in own]
    if node.names:
        yield ast.unparse(node)


def names_of(node: ast.stmt) -> Iterator[str]:
    """Return the names that an import binds."""
    if isinstance(node, (ast.Import, ast.ImportFrom)):
        yield from (alias.asname or alias.name.partition(".")[0] for alias in node.names)


def words(source: str) -> set[str]:
    """Return all names in a source."""
    tree = ast.parse(source)
    stated = [getattr(node, name, None) for node in ast.walk(tree) for name in ("annotation", "returns")]
    quoted = [each for node in stated if node and "Literal" not in ast.unparse(node) for each in ast.walk(node)]
    found = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load)}
    return found | {node.value for node in quoted if isinstance(node, ast.Constant) and isinstance(node.value, str)}


def words_outside_imports(tree: ast.Module) -> set[str]:
    """Return all names that a module uses outside imports."""
    return {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}


def imports(node: ast.stmt, used: set[str], inside: set[str]) -> Iterator[str]:
    """Yield the imports of a stub: those that it uses, and those that the module only re-exports."""
    if isinstance(node, ast.Import):
        for alias in node.names:
            if (alias.asname or alias.name.partition(".")[0]) in used:
                yield ast.unparse(ast.Import([alias]))
    elif isinstance(node, ast.ImportFrom) and node.module != "__future__":
        needed = [alias for alias in node.names if (alias.asname or alias.name) in used]
        offered = [alias for alias in node.names if (alias.asname or alias.name) not in inside | used]
        offered = [ast.alias(alias.name, alias.asname or alias.name) for alias in offered]
        if needed or offered:
            yield ast.unparse(ast.ImportFrom(node.module, [*needed, *offered], node.level))


def statement(module: Any, node: ast.stmt) -> Iterator[str]:
    """Yield the lines of a stub for a statement of a module."""
    if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
        yield signature(node)
    elif isinstance(node, ast.ClassDef):
        kind = getattr(module, node.name)
        yield "\n".join(block_class(kind, node) if is_block_class(kind) else plain_class(kind, node))
    elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
        yield f"{node.target.id}: {ast.unparse(node.annotation)}"
    elif isinstance(node, (ast.Assign, ast.With, ast.For, ast.If, ast.Try)):
        for name in assigned_names(node):
            if hasattr(module, name) and not name.startswith("__"):
                yield f"{name}: {type_of(getattr(module, name))}"


def assigned_names(node: ast.stmt) -> list[str]:
    """Return the names that a statement assigns, in order."""
    targets = [each.id for each in ast.walk(node) if isinstance(each, ast.Name) and isinstance(each.ctx, ast.Store)]
    return list(dict.fromkeys(targets))


def type_of(value: object) -> str:
    """Return the annotation of a constant."""
    if isinstance(value, tuple):
        return "tuple[Any, ...]"
    return PLAIN.get(type(value), "dict[Any, Any]" if type(value) is dict else "Any")


def signature(node: ast.FunctionDef | ast.AsyncFunctionDef) -> str:
    """Return the source of a function with its docstring instead of its body."""
    arguments = node.args
    arguments.defaults = [short(each) for each in arguments.defaults]
    arguments.kw_defaults = [each and short(each) for each in arguments.kw_defaults]
    head = copy.copy(node)
    head.body = [ast.Expr(ast.Constant(ast.get_docstring(node) or ...))]
    return ast.unparse(ast.fix_missing_locations(head)).replace(":\n    ...", ": ...")


def short(default: ast.expr) -> ast.expr:
    """Return a default as in a stub: a literal, or `...`."""
    return default if isinstance(default, ast.Constant) else ast.Constant(...)


def methods(node: ast.ClassDef, without: Iterable[str] = ()) -> list[str]:
    """Return the signatures of the methods of a class, indented."""
    functions = [each for each in node.body if isinstance(each, ast.FunctionDef) and each.name not in without]
    return [textwrap.indent(signature(function), "    ") for function in functions]


def attributes(node: ast.ClassDef) -> list[str]:
    """Return the names that a class or its methods assign to the class or to self, in order."""
    found = [
        name for each in node.body if isinstance(each, (ast.Assign, ast.AnnAssign)) for name in assigned_names(each)
    ]
    for each in ast.walk(node):
        if isinstance(each, ast.Attribute) and isinstance(each.ctx, ast.Store) and isinstance(each.value, ast.Name):
            if each.value.id == "self":
                found.append(each.attr)
    return list(dict.fromkeys(found))


def plain_class(kind: Any, node: ast.ClassDef) -> list[str]:
    """Return the lines of a class other than a block."""
    annotated = {
        each.target.id: each
        for each in node.body
        if isinstance(each, ast.AnnAssign) and isinstance(each.target, ast.Name)
    }
    lines = [*map("@{}".format, map(ast.unparse, node.decorator_list)), heading(node), *docstring(node)]
    properties = {each.name for each in node.body if isinstance(each, ast.FunctionDef)}
    for name in attributes(node):
        if name in annotated:
            default = " = ..." if annotated[name].value is not None else ""
            lines.append(f"    {name}: {ast.unparse(annotated[name].annotation)}{default}")
        elif name not in properties:
            lines.append(f"    {name}: {type_of(getattr(kind, name, None))}")
    return closed([*lines, *methods(node)])


def heading(node: ast.ClassDef) -> str:
    """Return the first line of a class."""
    bases = ", ".join(map(ast.unparse, [*node.bases, *node.keywords]))
    return f"class {node.name}({bases}):" if bases else f"class {node.name}:"


def docstring(node: ast.ClassDef, indent: str = "    ") -> list[str]:
    """Return the docstring of a class as a list of one text, empty without one."""
    return quoted(ast.get_docstring(node) or "", indent)


def quoted(text: str, indent: str) -> list[str]:
    """Return a text as a docstring, in a list; an empty list for an empty text."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return [textwrap.indent(f'"""{escaped}"""', indent)] if text else []


def closed(lines: list[str]) -> list[str]:
    """Return the lines of a class, with `...` for an empty body."""
    if lines[-1].endswith(":") and not lines[-1].startswith(" "):
        lines[-1] += " ..."
    return lines


def block_class(kind: type[Block], node: ast.ClassDef) -> list[str]:
    """Return the lines of a block class."""
    lines = [heading(node), *docstring(node)]
    names = {each.name for each in node.body if isinstance(each, ast.FunctionDef)}
    for name, declaration in declarations(kind):
        lines += [f"    {name}: {declared(declaration)}", *quoted(meaning(declaration), "    ")]
    inherited = {
        name
        for base in kind.__mro__[1:]
        for name in (*vars(base), *vars(base).get("_own", ()), *inspect.get_annotations(base))
    }
    declared_names = {name for name, _ in declarations(kind)}
    for name in attributes(node):
        if name not in declared_names | names | inherited and not name.startswith("__"):
            lines.append(f"    {name}: Any")
    if not vars(kind).get("abstract"):
        base = next(each for each in kind.__mro__[1:] if issubclass(each, Block))
        if "__init__" not in names:
            lines.append(function("__init__", constructor(kind), "None", meanings(kind.parameters)))
        if "__call__" not in names and (vars(base).get("abstract", base is Block) or call(base) != call(kind)):
            lines += call(kind)
    return closed([*lines, *methods(node, vars(Block))])


def declarations(kind: type[Block]) -> list[tuple[str, Param[Any] | Input | Output | Memory]]:
    """Return the ports, parameters and memory that a class itself declares."""
    own = {name: each for name, each in vars(kind).items() if isinstance(each, Declaration)} | vars(kind)["_own"]
    everything = {**kind.parameters, **kind.inputs, **kind.outputs, **kind.memory}
    return [(name, each) for name, each in everything.items() if name in own]


def declared(declaration: Param[Any] | Input | Output | Memory) -> str:
    """Return the annotation of a declaration."""
    if isinstance(declaration, Param):
        return f"Param[{value_type(declaration)}]"
    return "Input" if isinstance(declaration, Input) else "Output" if isinstance(declaration, Output) else "Memory"


def value_type(param: Param[Any]) -> str:
    """Return the type of a parameter's value in a block."""
    if param.choices is not None and all(isinstance(choice, str) for choice in param.choices):
        name = f"Literal[{', '.join(map(repr, param.choices))}]"
    else:
        name = (PLAIN | {tuple: SEQUENCE, dict: "dict[Any, Any]"}).get(param.dtype, "Any")
    return f"{name} | None" if param.default is None and not param.required and name != "Any" else name


def constructor(kind: type[Block]) -> list[str]:
    """Return the arguments of a block's constructor, after self."""
    before: list[str] = []
    after: list[str] = []
    optional = False
    for name, param in kind.parameters.items():
        annotation = value_type(param)
        if param.dtype is float and param.unit.startswith("rad"):
            annotation = annotation.replace("float", "float | str")  # "10 deg"; elsewhere more often a mistake
        if not param.fixed and annotation != "Any":
            annotation += " | Live"
        named = kind.positional is not None and name not in kind.positional
        if param.required:
            (after if optional or named else before).append(f"{name}: {annotation}")
            continue
        optional = True
        (after if after or named else before).append(f"{name}: {annotation} = {default(param.default)}")
    return [*before, *(["*"] if after else []), *after, "**options: Unpack[BlockOptions]"]


def default(value: object) -> str:
    """Return a default as in a stub: a short literal, or `...`."""
    finite = isinstance(value, (int, str)) or isinstance(value, float) and math.isfinite(value)
    return repr(value) if finite or value is None else "..."


def call(kind: type[Block]) -> list[str]:
    """Return the lines of the call that connects a block, with the type of its result."""
    lines: list[str] = []
    inputs, outputs = makes_ports(kind, "inputs"), makes_ports(kind, "outputs")
    named = {name for name in kind.outputs if name.isidentifier() and not keyword.iskeyword(name)}
    if outputs or "result" in vars(kind):
        lines.append("    def __getattr__(self, name: str) -> Signal: ...")
        result = "Any"
    elif not kind.outputs:
        result = kind.__name__
    elif len(kind.outputs) == 1 or named != set(kind.outputs):
        result = "Signal" if len(kind.outputs) == 1 else "Any"
    else:
        lines.append("    class Outputs(NamedTuple):")
        for name, output in kind.outputs.items():
            lines += [f"        {name}: Signal{hidden(name)}", *quoted(meaning(output), "        ")]
        result = "Outputs"
    if inputs or issubclass(kind, Sink):
        arguments = ["*signals: Operand", "**named: Operand"]
    elif kind.variadic:
        arguments = ["*signals: Operand"]
    else:
        arguments = [f"{name}: Operand = ..." for name in kind.inputs]
    return [*lines, function("__call__", arguments, result, meanings(kind.inputs))]


def meaning(declaration: Param[Any] | Input | Output | Memory) -> str:
    """Return the description of a declaration, with its unit and bounds: "stiffness, N·m/rad, 0 to 150"."""
    parts = [declaration.description]
    if not isinstance(declaration, Memory):
        parts.append("" if declaration.unit == "1" else declaration.unit)
    if isinstance(declaration, Param) and declaration.dtype in (int, float):
        bounds = {"at least": declaration.min, "at most": declaration.max}
        parts += [f"{words} {bound:g}" for words, bound in bounds.items() if bound is not None]
    return ", ".join(filter(None, parts))


def meanings(declarations: Mapping[str, Param[Any] | Input]) -> str:
    """Return the descriptions of parameters or inputs, one on a line."""
    return "\n".join(f"{name} : {meaning(each)}" for name, each in declarations.items())


def hidden(name: str) -> str:
    """Return a remark for type checkers if an output has the name of a method of tuples, which it replaces."""
    return "  # type: ignore[assignment]" if hasattr(tuple, name) else ""


def makes_ports(kind: type[Block], field: str) -> bool:
    """Return whether a block class, or a base of it, assigns `self.inputs` or `self.outputs` names of its own."""
    for base in kind.__mro__:
        if base is Block or not issubclass(base, Block):
            continue
        for node in assignments(base):
            targets = getattr(node, "targets", [getattr(node, "target", None)])
            for target in targets:
                inner = target.value if isinstance(target, ast.Subscript) else target
                if isinstance(inner, (ast.Tuple, ast.List)):
                    inner = next((each for each in inner.elts if is_field(each, field)), None)
                if is_field(inner, field) and not names_only(getattr(node, "value", None), target, kind, field):
                    return True
    return False


@functools.cache
def assignments(kind: type[Block]) -> list[ast.AST]:
    """Return the statements of a class that assign, and what else has a target or targets."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(kind)))
    return [node for node in ast.walk(tree) if hasattr(node, "target") or hasattr(node, "targets")]


def is_field(node: ast.AST | None, field: str) -> bool:
    """Return whether an expression is `self.inputs` or `self.outputs`, by the name of the field."""
    return (
        isinstance(node, ast.Attribute)
        and node.attr == field
        and isinstance(node.value, ast.Name)
        and node.value.id == "self"
    )


def names_only(value: ast.AST | None, target: ast.AST | None, kind: type[Block], field: str) -> bool:
    """Return whether an assigned dict, or `self.inputs | {...}`, only has names that the class declares."""
    known = getattr(kind, field)
    if isinstance(value, ast.BinOp) and isinstance(value.op, ast.BitOr):
        return all(is_field(side, field) or names_only(side, None, kind, field) for side in (value.left, value.right))
    if isinstance(target, ast.Subscript):
        return isinstance(target.slice, ast.Constant) and target.slice.value in known
    if isinstance(value, ast.Dict):
        return all(isinstance(key, ast.Constant) and key.value in known for key in value.keys)
    return False


def function(name: str, arguments: list[str], result: str, text: str) -> str:
    """Return the lines of a method of a stub, its head in one if it fits. text : its docstring"""
    body = "\n".join(["", *quoted(text, "        ")]) if text else " ..."
    line = f"    def {name}({', '.join(['self', *arguments])}) -> {result}:"
    if len(line) > WIDTH - len(" ..."):
        line = "\n".join(
            [f"    def {name}(", *(f"        {each}," for each in ["self", *arguments]), f"    ) -> {result}:"]
        )
    return line + body


def files(path: Path) -> list[Path]:
    """Return the Python files of a folder, or the one file, except the `__init__.py` of packages."""
    found = sorted(path.rglob("*.py")) if path.is_dir() else [path]
    return [file for file in found if file.name != "__init__.py"]


def imported(file: Path) -> ModuleType:
    """Import a file under its full name: that of its package, if its folder is one."""
    folder, names = file.absolute().parent, [file.stem]
    while (folder / "__init__.py").exists():
        folder, names = folder.parent, [folder.name, *names]
    sys.path.insert(0, str(folder))
    try:
        return importlib.import_module(".".join(names))
    finally:
        sys.path.remove(str(folder))


def write(path: Path) -> list[Path]:
    """Write the stubs of a file or of those in a folder beside them, and remove those of modules without blocks.

    Returns the paths of the stubs. Raises FileExistsError for a stub that was not generated.
    """
    written: list[Path] = []
    for file in files(path):
        module, target = imported(file), file.with_suffix(".pyi")
        if target.exists() and not target.read_text().startswith(HEADER[:26]):
            raise FileExistsError(
                errno.EEXIST, "a stub that was not generated: rename it, or add to it by hand", str(target)
            )
        if has_blocks(module):
            target.write_text(stub(module))
            written.append(target)
        elif target.exists():
            target.unlink()
    return written


if __name__ == "__main__":
    for each in sys.argv[1:]:
        write(Path(each))
