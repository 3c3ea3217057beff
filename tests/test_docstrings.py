"""Public functions and classes have docstrings, in the folders that are listed as complete."""

import ast

import pytest

from tests.checkout import ROOT

COMPLETE = (
    "blocks",
    "blocks/_plumbing",
    "blocks/actuators",
    "blocks/controllers",
    "blocks/imus/invensense",
    "blocks/imus/microstrain",
    "blocks/sensors",
    "graph",
    "graph/drawing",
    "runtime/commissioning/configure",
)


def undocumented(source):
    """Names of the public functions and classes of a module that have no docstring."""
    kinds = ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef
    public = [node for node in ast.parse(source).body if isinstance(node, kinds) and not node.name.startswith("_")]
    return [node.name for node in public if not ast.get_docstring(node)]


@pytest.mark.parametrize("folder", COMPLETE)
def test_public_functions_and_classes_have_docstrings(folder):
    paths = sorted((ROOT / folder).glob("*.py"))
    assert paths
    assert {path.name: names for path in paths if (names := undocumented(path.read_text()))} == {}


def test_missing_docstring_is_reported():
    source = 'def a():\n    """A."""\ndef b():\n    pass\nclass C:\n    x = 1\ndef _d():\n    pass\n'
    assert undocumented(source) == ["b", "C"]
