"""Links and names of README and docs: every file, heading, path and Python name that a page refers to exists."""

import importlib
import re

from tests.checkout import ROOT
from tests.docs.pages import NAMES, PAGES, anchors

PACKAGES = "blocks|cext|graph|runtime"
PATH = re.compile(rf"`((?:{PACKAGES}|diagrams|docs|tests)/[\w./-]+)`")
NAME = re.compile(rf"`((?:{PACKAGES})\.[\w.]+)(?:\([^`]*\))?`")
OTHERS = {"docs/how_to/laboratory.md": ("diagrams/knee.py", "tests/test_blocks.py")}  # files of another package


def test_links_have_targets():
    missing = []
    for page, name in zip(PAGES, NAMES):
        for target, anchor in re.findall(r"\]\((?!https?:|mailto:)([^)#\s]*)(?:#([^)\s]+))?\)", page.read_text()):
            path = page.parent / target if target else page
            if not path.exists() or anchor and anchor not in anchors(path):
                missing.append(f"{name}: {target}#{anchor}")
    assert not missing, "\n".join(missing)


def test_paths_and_python_names_in_the_text_exist():
    missing = []
    for page in [name for name in NAMES if not name.endswith("CHANGELOG.md")]:
        text = (ROOT / page).read_text()
        missing += [
            f"{page}: {path}"
            for path in PATH.findall(text)
            if path not in OTHERS.get(page, ()) and not (ROOT / path).exists()
        ]
        # a name that ends with .py is a file of the user
        missing += [f"{page}: {name}" for name in NAME.findall(text) if not name.endswith(".py") and not exists(name)]
    assert not missing, "\n".join(missing)


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
