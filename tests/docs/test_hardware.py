"""Pages of docs/hardware: the table of actuators is fresh, rigs are valid, and statements have a source."""

import re
from pathlib import Path

import pytest

from runtime.rig.file import parse
from tests.checkout import ROOT
from tests.docs import compatibility

PAGES = sorted((ROOT / "docs" / "hardware").glob("*.md"))


def test_table_of_actuators_is_fresh():
    assert compatibility.PAGE.read_text() == compatibility.page()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_rigs_of_the_hardware_guide_are_valid(page):
    for text in re.findall(r"^```toml\n(.*?)^```", page.read_text(), re.DOTALL | re.MULTILINE):
        assert parse(Path("lab.toml"), text)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_hardware_page_states_what_was_tried_and_has_its_sources(page):
    text = page.read_text()
    assert "tried here" in text
    used = set(re.findall(r"\]\[([^\]]+)\]", text))
    defined = set(re.findall(r"^\[([^\]]+)\]: https://\S+$", text, re.MULTILINE))
    assert used == defined
