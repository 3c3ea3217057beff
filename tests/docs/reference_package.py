"""Public names of the Python package Epically Powerful, collected from its source without importing it.

python -m tests.docs.reference_package FOLDER writes reference_package.json for an unpacked source distribution.
"""

import ast
import json
import re
import sys
from pathlib import Path

STORED = Path(__file__).with_suffix(".json")
SPECIAL = ("__call__", "__getitem__", "__iter__", "__next__")


def signature(function, name):
    """Return name(arguments with their defaults) of a function, without self."""
    names = [argument.arg for argument in function.args.args]
    defaults = [ast.unparse(value) for value in function.args.defaults]
    texts = names[: len(names) - len(defaults)]
    texts += [f"{key}={value}" for key, value in zip(names[len(texts) :], defaults)]
    return f"{name}({', '.join(text for text in texts if text not in ('self', 'cls'))})".replace("'", '"')


def members(kind):
    """Return the public members of a class: methods and properties, fields, and attributes that it creates."""
    found, assigned = [], []
    for node in kind.body:
        if isinstance(node, ast.FunctionDef) and (not node.name.startswith("_") or node.name in SPECIAL):
            plain = any(ast.unparse(decorator) == "property" for decorator in node.decorator_list)
            found.append(f".{node.name}" if plain else signature(node, f".{node.name}"))
        elif isinstance(node, (ast.Assign, ast.AnnAssign)):
            assigned += [node.target] if isinstance(node, ast.AnnAssign) else node.targets
        elif isinstance(node, ast.FunctionDef) and node.name == "__init__":
            parameters = {argument.arg for argument in node.args.args}
            assigned += [
                ast.Name(target.attr)
                for inner in ast.walk(node)
                if isinstance(inner, ast.Assign)
                for target in inner.targets
                if isinstance(target, ast.Attribute)
                and ast.unparse(target.value) == "self"
                and target.attr not in parameters
            ]
    return found + [f".{target.id}" for target in assigned if not target.id.startswith("_")]


def names(nodes):
    """Return the public names that statements of a module define."""
    found = []
    for node in nodes:
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)) and not node.name.startswith("_"):
            found.append(signature(node, node.name))
        elif isinstance(node, ast.ClassDef):
            start = [inner for inner in node.body if getattr(inner, "name", "") == "__init__"]
            found += [signature(start[0], node.name) if start else node.name, *members(node)]
        elif isinstance(node, ast.Assign):
            found += [target.id for target in node.targets if isinstance(target, ast.Name)]
        elif isinstance(node, ast.Try) or isinstance(node, ast.If) and "__main__" not in ast.unparse(node.test):
            found += names(node.body)
    return list(dict.fromkeys(found))


def compiled(text):
    """Return the public names of a Cython module."""
    kind = re.search(r"^cdef class (\w+)", text, re.MULTILINE)[1]
    arguments = re.sub(r"\b(self, |double |bint )", "", re.search(r"def __init__\((.*)\):", text)[1])
    methods = re.findall(r"^ +(?:cp)?def (?!__c?init)(\w+)\(self\)", text, re.MULTILINE)
    return [f"{kind}({arguments})", *(f".{method}()" for method in methods)]


def options(nodes):
    """Return the options of the argument parsers in syntax trees, with their defaults: --rate=200."""
    found = []
    for call in (inner for node in nodes for inner in ast.walk(node)):
        if isinstance(call, ast.Call) and getattr(call.func, "attr", "") == "add_argument":
            flags = "/".join(ast.literal_eval(flag) for flag in call.args)
            default = [ast.unparse(word.value) for word in call.keywords if word.arg == "default"]
            found.append(flags + "".join(f"={value}" for value in default).replace("'", '"'))
    return found


def commands(folder):
    """Return {command: its options} of the entry points of the project."""
    found = {}
    scripts = re.findall(r'^(ep-[\w-]+) = "(.*):(\w+)"', (folder / "pyproject.toml").read_text(), re.MULTILINE)
    for command, module, entry in sorted(scripts):
        tree = ast.parse((folder / f"{module.replace('.', '/')}.py").read_text())
        functions = {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}
        called = [name for name in functions if name.startswith("_") and f"{name}(" in ast.unparse(functions[entry])]
        found[command] = options([functions[name] for name in called])
    return found


def collected(folder):
    """Return everything that is stored. folder : folder of the unpacked source distribution"""
    package, modules = folder / "epicallypowerful", {}
    for path in sorted(package.rglob("*.py*")):
        name = ".".join(path.relative_to(package).with_suffix("").parts).replace(".__init__", "")
        text = path.read_text()
        found = compiled(text) if path.suffix == ".pyx" else names(ast.parse(text).body)
        if found:
            modules[name] = found
    calibration = ast.parse((package / "sensing" / "mpu9250" / "calibrate_mpu9250.py").read_text())
    table = ast.parse((package / "actuation" / "motor_data.py").read_text())
    models = [node.value for node in table.body if isinstance(node, ast.Assign) and "MOTOR_PARAMS" in ast.unparse(node)]
    sources = [path.read_text() for path in package.rglob("*.py")]
    scripts = sorted((folder / "examples").glob("*.py"))
    return {
        "version": re.search(r'^version = "(.*)"', (folder / "pyproject.toml").read_text(), re.MULTILINE)[1],
        "modules": modules,
        "commands": commands(folder) | {"calibrate_mpu9250": options([calibration])},
        "environment": sorted({name for text in sources for name in re.findall(r"(?:environ|getenv)\W+(\w+)", text)}),
        "files": sorted({name for text in sources for name in re.findall(r"[\"'](\w+\.(?:json|log))[\"']", text)}),
        "models": ast.literal_eval(models[0]),
        "examples": {path.name: len(path.read_text().splitlines()) for path in scripts},
    }


if __name__ == "__main__":
    STORED.write_text(json.dumps(collected(Path(sys.argv[1])), indent=1, ensure_ascii=False) + "\n")
