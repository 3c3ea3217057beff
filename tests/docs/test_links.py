"""Links and names of README and docs: every file, heading, path and Python name that a page refers to exists."""

import importlib
import re

import pytest

from tests.checkout import ROOT
from tests.docs.pages import NAMES, PAGES, anchors

PACKAGES = "blocks|cext|graph|runtime"
PATH = re.compile(rf"`((?:{PACKAGES}|diagrams|docs|tests)/[\w./-]+)`")
NAME = re.compile(rf"`((?:{PACKAGES})\.[\w.]+)(?:\([^`]*\))?`")
OTHERS = {"docs/how_to/laboratory.md": ("diagrams/knee.py", "tests/test_blocks.py")}  # files of another package


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_links_have_targets(page):
    for target, anchor in re.findall(r"\]\((?!https?:|mailto:)([^)#\s]*)(?:#([^)\s]+))?\)", page.read_text()):
        path = page.parent / target if target else page
        assert path.exists(), target
        assert not anchor or anchor in anchors(path), f"{target}#{anchor}"


@pytest.mark.parametrize("page", [name for name in NAMES if not name.endswith("CHANGELOG.md")])
def test_paths_and_python_names_in_the_text_exist(page):
    text = (ROOT / page).read_text()
    for path in PATH.findall(text):
        assert path in OTHERS.get(page, ()) or (ROOT / path).exists(), path
    for name in NAME.findall(text):
        assert name.endswith(".py") or exists(name), name  # a file of the user


def exists(name):
    """Return whether a dotted name is a module, or an attribute of one."""
    words = name.split(".")
    for count in range(len(words), 0, -1):
        try:
            thing = importlib.import_module(".".join(words[:count]))
        except ImportError:
            continue
        for word in words[count:]:
            thing = getattr(thing, word, None)
        return thing is not None
    return False
