"""Public functions, classes and methods have docstrings and annotations."""

import ast
import functools

from tests.checkout import PACKAGES, ROOT

STEPS = ("step", "reset", "update")  # methods of blocks, which the class describes
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)


@functools.cache
def modules():
    """The syntax tree of every module, by path."""
    return {
        path: ast.parse(path.read_text()) for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))
    }


@functools.cache
def classes():
    """The classes of all modules by name, since a base class is known by its name only."""
    found = {}
    statements = list(modules().values())
    for node in statements:  # which grows; expressions contain no class
        statements += [
            child for child in ast.iter_child_nodes(node) if isinstance(child, (ast.stmt, ast.excepthandler))
        ]
        if isinstance(node, ast.ClassDef):
            found.setdefault(node.name, []).append(node)
    return found


def public(nodes, kinds):
    return [
        node
        for node in nodes
        if isinstance(node, kinds) and not node.name.startswith("_") and "overload" not in decorators(node)
    ]


def decorators(node):
    return [ast.unparse(decorator) for decorator in node.decorator_list]


def methods(kind):
    """The public methods of a class that a block does not inherit its description of."""
    return [method for method in public(kind.body, FUNCTIONS) if method.name not in STEPS]


def inherits_docstring(kind, name):
    """Whether a base class in this tree documents a method or an attribute of this name."""
    for base in map(ast.unparse, kind.bases):
        for parent in classes().get(base.rpartition(".")[2].partition("[")[0], ()):
            own = [each for each in public(parent.body, FUNCTIONS) if each.name == name and ast.get_docstring(each)]
            if parent is not kind and (own or inherits_docstring(parent, name)):
                return True
    return False


def undocumented(tree):
    """Names of the public functions and classes of a module that have no docstring."""
    return [node.name for node in public(tree.body, (*FUNCTIONS, ast.ClassDef)) if not ast.get_docstring(node)]


def undocumented_methods(tree):
    """Names of the public methods and properties of public classes without a docstring, also in a base class."""
    return [
        f"{kind.name}.{method.name}"
        for kind in public(tree.body, ast.ClassDef)
        for method in methods(kind)
        if not ast.get_docstring(method) and not inherits_docstring(kind, method.name)
    ]


def unannotated(tree):
    """Names of the public functions and methods of a module that lack the annotation of a parameter or the result."""
    functions = [(node.name, node, False) for node in public(tree.body, FUNCTIONS)]
    for kind in public(tree.body, ast.ClassDef):
        functions += [(f"{kind.name}.{method.name}", method, True) for method in methods(kind)]
    return [name for name, node, is_method in functions if not is_annotated(node, is_method)]


def is_annotated(node, is_method):
    arguments = node.args
    positional = arguments.posonlyargs + arguments.args
    if is_method and "staticmethod" not in map(ast.unparse, node.decorator_list):
        positional = positional[1:]
    rest = [each for each in (arguments.vararg, arguments.kwarg) if each is not None]
    return node.returns is not None and all(each.annotation for each in positional + arguments.kwonlyargs + rest)


def test_public_interface_is_complete():
    """In one test, since the syntax trees take seconds."""
    for check in undocumented, undocumented_methods, unannotated:
        missing = {str(path.relative_to(ROOT)): names for path, tree in modules().items() if (names := check(tree))}
        assert not missing, check.__doc__


def test_missing_docstring_is_reported():
    source = (
        'def a():\n    """A."""\ndef b():\n    pass\nclass C:\n    x = 1\n    def m(self): ...\ndef _d():\n    pass\n'
    )
    assert undocumented(ast.parse(source)) == ["b", "C"]
    assert undocumented_methods(ast.parse(source)) == ["C.m"]


def test_missing_annotation_is_reported():
    source = "def a(x: int) -> int: ...\ndef b(x) -> int: ...\nclass C:\n    def m(self, *y: int): ...\n"
    assert unannotated(ast.parse(source)) == ["b", "C.m"]
