"""Links of README and docs: every file and every heading that a page refers to exists."""

import re

import pytest

from tests.docs.pages import NAMES, PAGES, anchors


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_links_have_targets(page):
    for target, anchor in re.findall(r"\]\((?!https?:|mailto:)([^)#\s]*)(?:#([^)\s]+))?\)", page.read_text()):
        path = page.parent / target if target else page
        assert path.exists(), target
        assert not anchor or anchor in anchors(path), f"{target}#{anchor}"
