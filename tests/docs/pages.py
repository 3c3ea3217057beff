"""The pages that are in the tree: README and docs, without the generated pages of a site."""

from tests.checkout import ROOT

DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *sorted(path for path in DOCS.rglob("*.md") if DOCS / "api" not in path.parents)]
NAMES = [path.relative_to(ROOT).as_posix() for path in PAGES]
