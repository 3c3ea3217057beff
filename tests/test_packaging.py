"""Structure of the tree: folders, imports, packages, and the content of files."""

import ast
import re
import sys
from fnmatch import fnmatch
from functools import cache

import networkx
import pytest

from tests.checkout import PACKAGES, ROOT, tracked

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
FLOORS = {name: floor for floor, name in enumerate((*PACKAGES, "diagrams"))}


def canonical(requirement):
    """The distribution that a requirement names."""
    return re.match(r"[\w.-]+", requirement)[0].lower().replace("_", "-")


def rooms():
    """Every folder of the four packages that holds a source."""
    return sorted(
        {
            path.parent
            for room in PACKAGES
            for path in (ROOT / room).rglob("*")
            if path.suffix in (".py", ".pyx", ".pxd")
        }
    )


# Imports only go down


def python_imports(text):
    """Top-level packages that Python source imports, wherever in it, with the line."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            yield from ((alias.name.split(".")[0], node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield (node.module or "").split(".")[0] if not node.level else ".", node.lineno


def cython_imports(text):
    """The same for Cython source: import and cimport, at the start of a line."""
    for number, line in enumerate(text.splitlines(), 1):
        found = re.match(r"\s*(?:from\s+(\.|\w+)\S*\s+c?import\b|c?import\s+(\w[\w., ]*))", line)
        if found:
            names = [found[1]] if found[1] else [name.split()[0] for name in found[2].split(",") if name.strip()]
            yield from ((name.split(".")[0] or ".", number) for name in names)


def climbs(room, name):
    return name == "." or name == "tests" or FLOORS.get(name, -1) > FLOORS[room]


def test_packages_import_only_packages_below_them():
    found = []
    for room in FLOORS:
        for path in sorted((ROOT / room).rglob("*")):
            if path.suffix not in (".py", ".pyx", ".pxd", ".pxi"):
                continue
            imports = python_imports if path.suffix == ".py" else cython_imports
            found += [
                f"{path.relative_to(ROOT)}:{line} imports {name}"
                for name, line in imports(path.read_text())
                if climbs(room, name)
            ]
    assert found == []


@pytest.mark.parametrize("imports", [python_imports, cython_imports])
def test_upward_import_is_detected_anywhere_in_file(imports):
    source = (
        "import math, blocks.filters as f\nfrom graph import deg\ndef step():\n    from runtime.cli.main import "
        "main\n    from . import a\n"
    )
    found = [(name, line) for name, line in imports(source) if climbs("graph", name)]
    assert found == [("blocks", 1), ("runtime", 4), (".", 5)]


def test_cimports_are_imports():
    source = "cimport blocks.a, graph\nfrom runtime.x cimport (\n    y)\n"
    assert list(cython_imports(source)) == [("blocks", 1), ("graph", 1), ("runtime", 2)]


# Inside a package its folders have an order, too: each imports only those before it. Modules of a folder itself, such
# as runtime.host.errors, are before its folders.


def documented_order():
    """{package: folders in order} of the tables in docs/explanation/tour.md."""
    page, order = (ROOT / "docs" / "explanation" / "tour.md").read_text(), {}
    for package in ("cext", "runtime"):
        table = page.partition(f"| {package}/ | contents |")[2].partition("\n\n")[0]
        rows = re.findall(r"^\| `(\w+)/` \| (.*) \|$", table, re.MULTILINE)
        order[package] = tuple(name for name, _ in rows)
        for name, contents in rows if package == "runtime" else ():
            folders = tuple(re.findall(r"`(\w+)/`", contents))
            if folders:
                order[f"{package}/{name}"] = folders
    return order


ORDER = documented_order()


@cache
def module_imports(path):
    """(dotted name, line) of everything that a source imports, wherever in it; of `from a import b`, a.b."""
    return list(_module_imports(path))


def _module_imports(path):
    text = path.read_text()
    if path.suffix == ".py":
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Import):
                yield from ((alias.name, node.lineno) for alias in node.names)
            elif isinstance(node, ast.ImportFrom):
                yield from ((f"{node.module}.{alias.name}", node.lineno) for alias in node.names)
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                if re.fullmatch(r"(cext|graph|blocks|runtime)(\.\w+)+(:\w+)?", node.value):
                    yield node.value.partition(":")[0], node.lineno
    else:
        for number, line in enumerate(text.splitlines(), 1):
            if found := re.match(
                r"\s*(?:from|cimport|import)\s+((?:cext|graph)(?:\.\w+)*)(?:\s+c?import\s+(\w+))?", line
            ):
                yield ".".join(filter(None, found.groups())), number


def folder_in(package, name):
    """The folder within a package of a dotted name; "" for a module of the package itself, None for anything else."""
    parts, depth = name.split("."), len(package.split("/"))
    if parts[:depth] != package.split("/"):
        return None
    return parts[depth] if len(parts) > depth and parts[depth] in ORDER[package] else ""


@pytest.mark.parametrize("package", ORDER)
def test_every_folder_is_in_the_documented_order(package):
    folders = {path.name for path in (ROOT / package).iterdir() if (path / "__init__.py").exists()}
    assert folders == set(ORDER[package])


def python_modules():
    """{dotted name: path} of every Python module of the four packages."""
    return {
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
        for room in PACKAGES
        for path in (ROOT / room).rglob("*.py")
    }


def test_folders_import_only_folders_before_them_and_no_modules_each_other_in_a_circle():
    found = []
    for package, folders in ORDER.items():
        order = ("", *folders)
        for path in sorted((ROOT / package).rglob("*")):
            if path.suffix not in (".py", ".pyx", ".pxd") or path.parent == ROOT / package and package in PACKAGES:
                continue
            own = folder_in(package, ".".join(path.relative_to(ROOT).with_suffix("").parts))
            for name, line in module_imports(path):
                other = folder_in(package, name)
                if other is not None and order.index(other) > order.index(own):
                    found.append(f"{path.relative_to(ROOT)}:{line} imports {name}")
    assert found == []
    modules = python_modules()
    imports = networkx.DiGraph()
    for name, path in modules.items():
        for other, _ in module_imports(path):
            while other not in modules and "." in other:
                other = other.rpartition(".")[0]
            if other in modules and other != name and not name.startswith(other + "."):
                imports.add_edge(name, other)
    circles = {
        min(circle): len(circle) for circle in networkx.strongly_connected_components(imports) if len(circle) > 1
    }
    assert circles == {}


# Packages


def test_every_folder_with_sources_is_a_package_and_in_the_wheel():
    included = PYPROJECT["tool"]["setuptools"]["packages"]["find"]["include"]
    for folder in rooms():
        name = ".".join(folder.relative_to(ROOT).parts)
        assert (folder / "__init__.py").exists(), f"{name} has no __init__.py and would not be installed"
        assert any(fnmatch(name, pattern) for pattern in included), f"{name} is not in the wheel"


def test_the_wheel_contains_only_the_four_packages():
    included = PYPROJECT["tool"]["setuptools"]["packages"]["find"]["include"]
    for name in ("tests", "tests.graph", "diagrams", "docs", "blocksmith", "graphics", "build"):
        assert not any(fnmatch(name, pattern) for pattern in included), name


def test_every_file_beside_the_sources_is_installed():
    patterns = [pattern for room in PYPROJECT["tool"]["setuptools"]["package-data"].values() for pattern in room]
    for path in tracked():
        name = path.relative_to(ROOT)
        if name.parts[0] in PACKAGES and path.suffix not in (".py", ".pyx"):
            assert any(fnmatch(path.name, pattern) for pattern in patterns), f"{name} matches none of {patterns}"


def test_changelog_and_citation_have_the_version_of_the_package():
    version = PYPROJECT["project"]["version"]
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text()
    assert re.findall(r"(?m)^## ([\d.]+)", (ROOT / "docs" / "CHANGELOG.md").read_text())[0] == version


def test_tests_that_build_find_build_tools():
    assert set(PYPROJECT["build-system"]["requires"]) <= set(PYPROJECT["project"]["optional-dependencies"]["test"])


def test_every_folder_of_tests_is_a_package():
    for folder in {path.parent for path in (ROOT / "tests").rglob("*.py")}:
        assert (folder / "__init__.py").exists(), (
            f"{folder.relative_to(ROOT)} would be imported under the name of what it tests"
        )


def test_no_file_contains_an_absolute_path_of_a_machine():
    place = re.compile(rb"(?<![\w.~-])/(?:%s)/" % b"|".join([b"work", b"root", b"home", b"Users"]))
    found = []
    for path in tracked():
        for number, line in enumerate(path.read_bytes().splitlines(), 1):
            if place.search(line):
                found.append(f"{path.relative_to(ROOT)}:{number}: {line[:120]!r}")
    assert found == []
