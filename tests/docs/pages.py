"""The pages that are in the tree: README and docs, without the generated pages of a site."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]  # not from tests.checkout, which needs pytest: a site does not
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *sorted(path for path in DOCS.rglob("*.md") if DOCS / "api" not in path.parents)]
NAMES = [path.relative_to(ROOT).as_posix() for path in PAGES]


def anchors(path):
    """Return the anchors of a page's headings, as GitHub forms them."""
    text = re.sub(r"^```.*?^```", "", path.read_text(), flags=re.DOTALL | re.MULTILINE)
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).strip().replace(" ", "-") for heading in headings}
