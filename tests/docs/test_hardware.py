"""Pages of docs/hardware: the table of actuators is fresh, rigs are valid, and statements have a source."""

import re
from pathlib import Path

import pytest

from runtime.rig.file import parse
from tests.checkout import ROOT
from tests.diagrams.robots import ROBOTS, SUITS
from tests.docs import compatibility, energy

PAGES = sorted((ROOT / "docs" / "hardware").glob("*.md"))


def test_table_of_actuators_is_fresh():
    assert compatibility.PAGE.read_text() == compatibility.page()


def test_table_of_energy_has_every_robot_and_its_numbers_are_fresh():
    text = energy.PAGE.read_text()
    assert text.startswith(energy.HEAD)
    listed = re.findall(r"^\| \[(\w+)\]", text, re.MULTILINE)
    assert listed == [robot for robot in ROBOTS if robot not in SUITS]
    cells = [line.split(" | ") for line in text.splitlines() if "[m_blue]" in line][0]
    fresh = energy.row("m_blue").strip().split(" | ")
    assert cells[:4] == fresh[:4] and cells[7] == fresh[7]  # the ratings; motion, heat and time follow the wearer
    number = [[float(cell.split()[0]) for cell in row[4:7]] for row in (cells, fresh)]
    assert number[0] == pytest.approx(number[1], rel=0.2)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_rigs_of_the_hardware_guide_are_valid(page):
    for text in re.findall(r"^```toml\n(.*?)^```", page.read_text(), re.DOTALL | re.MULTILINE):
        assert parse(Path("lab.toml"), text)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_hardware_page_states_what_was_tested_and_has_its_sources(page):
    text = page.read_text()
    assert re.search(r"(?i)\b(None|No|Nothing)\b[^.;:]*\bha(s|ve)\s+been\s+tested", text)
    used = set(re.findall(r"\]\[([^\]]+)\]", text))
    defined = set(re.findall(r"^\[([^\]]+)\]: https://\S+$", text, re.MULTILINE))
    assert used == defined
