"""The stubs of the native modules are those of the last build, and agree with the compiled modules."""

import ast
import functools
import importlib
import inspect

import pytest

from cext.stubs import UNTYPED, module_name, packages_of_kernels, sources, stub

SOURCES = {module_name(path): path for path in sources()}


@functools.cache
def expected(name):
    """The text of the stub of a module."""
    return stub(SOURCES[name])


def callables(nodes, owner):
    """(name, parameters, object of the compiled module) of the functions of a stub that can be inspected."""
    for node in nodes:
        if isinstance(node, ast.ClassDef):
            yield from callables(node.body, getattr(owner, node.name))
        elif isinstance(node, ast.FunctionDef):
            compiled = inspect.getattr_static(owner, node.name)
            parameters = node.args.args + node.args.kwonlyargs
            if not node.decorator_list and not node.name.startswith("__"):
                yield node.name, [each.arg for each in parameters], compiled


@pytest.mark.soak
@pytest.mark.parametrize("name", SOURCES)
def test_stub_of_native_module_is_fresh(name):
    path = SOURCES[name].with_suffix(".pyi")
    text = path.read_text() if path.exists() else ""
    assert text == expected(name), "run `make build`"


def test_packages_of_kernels_accept_any_name():
    assert {path.with_suffix(".pyi").read_text() for path in packages_of_kernels()} == {UNTYPED}, "run `make build`"


@pytest.mark.parametrize("name", SOURCES)
def test_stub_names_the_parameters_of_the_compiled_functions(name):
    tree = ast.parse(expected(name))
    for function, parameters, compiled in callables(tree.body, importlib.import_module(name)):
        assert parameters == list(inspect.signature(compiled).parameters), function


@pytest.mark.parametrize("name", SOURCES)
def test_stub_has_every_public_function_and_class_of_the_module(name):
    module = importlib.import_module(name)
    own = {
        each
        for each, value in vars(module).items()
        if not each.startswith("_") and getattr(value, "__module__", None) == name and callable(value)
    }
    nodes = ast.parse(expected(name)).body
    assert {node.name for node in nodes if isinstance(node, (ast.ClassDef, ast.FunctionDef))} == own
