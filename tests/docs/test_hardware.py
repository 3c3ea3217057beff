"""Pages of docs/hardware: the table of actuators is fresh, rigs are valid, and statements have a source."""

import re
from pathlib import Path

import pytest

from runtime.robot.rig.file import parse
from runtime.robot.rig.records import DIFFERS, Record, StepRecord
from tests.checkout import ROOT
from tests.diagrams.robots import ROBOTS, SUITS
from tests.docs import compatibility, energy, parts, verified
from tests.docs.pictures import tables

PAGES = sorted((ROOT / "docs" / "hardware").glob("*.md"))


def test_table_of_actuators_is_fresh():
    assert compatibility.PAGE.read_text() == compatibility.page()


def test_page_of_verified_drives_is_fresh_and_lists_what_was_sent():
    assert verified.PAGE.read_text() == verified.page()
    fields = dict.fromkeys(verified.FIELDS, "x") | {"model": "AK80-9"}
    assert "| AK80-9 | x |" in verified.page([fields]) and "no records" not in verified.page([fields])
    form = (ROOT / ".github" / "ISSUE_TEMPLATE" / "verified.yml").read_text()
    assert re.findall(r"^    id: (\w+)$", form, re.MULTILINE) == list(verified.FIELDS)
    turned = StepRecord("2026-12-01 14:02", DIFFERS, says=["turned by 1.3 rad"], findings=[("wraps", "at a turn")])
    signed = {"name": "x", "date": "2026-12-01"}
    row = verified.row_of(Record("1", "knee", "CubeMars", "AK80-9", signed=signed, steps={"turn": turned}))
    assert tuple(row) == verified.FIELDS and all(row.values())
    assert (row["measured"], row["differed"]) == ("turn: turned by 1.3 rad", "wraps: at a turn")


def test_list_of_parts_is_fresh():
    assert parts.PAGE.read_text() == parts.page()


@pytest.mark.parametrize("title", ["A bench with one motor", "A robot with two joints"])
def test_totals_of_an_order_are_the_sums_of_its_rows(title):
    text = parts.PAGE.read_text().split(f"## {title}\n")[1].split("\n## ")[0]
    [[head, _, *rows]] = tables(text)
    assert head == ["quantity", "part", "number", "mass, g", "price"]
    for currency in "$€":
        total = sum(float(row[4].removeprefix(currency)) for row in rows if row[4].startswith(currency))
        assert f"{currency}{total:.2f}" in text.split("**Total:**")[1]
    grams = sum(int(row[3]) for row in rows if row[3] != "—")
    asked, unknown = sum(row[4] == "ask" for row in rows), sum(row[3] == "—" for row in rows)
    assert f"without the {asked} parts to ask for; {grams} g, without the {unknown} parts of" in text


def test_every_price_has_a_date_and_the_address_of_its_product():
    for part in parts.PARTS.values():
        assert bool(part.price) == bool(part.date)
        if part.price:
            assert re.fullmatch(r"[$€]\d+(\.\d\d)?", part.price) and part.page.startswith("https://")
            assert re.fullmatch(r"\d{4}(-\d\d-\d\d)?", part.date)


def test_the_paper_is_cited_with_title_and_number():
    for name in ("README.md", "CITATION.cff", "docs/hardware/index.md"):
        text = re.sub(r"\s+", " ", (ROOT / name).read_text())
        title = (
            "Epically Powerful: An open-source software and mechatronics infrastructure for wearable robotic systems"
        )
        assert title in text and "10.48550/arXiv.2511.05033" in text, name


def test_every_supply_range_is_listed_with_its_source():
    text = compatibility.PAGE.read_text()
    sections = text.split("\n## ")[1:]
    assert len(sections) == 3
    for section in sections:
        supplies = [row[6] for row in tables(section)[1][2:]]
        assert all(re.fullmatch(r"\d+ to \d+( \(assumed\))?", supply) for supply in supplies)
        assert "\nSupply: " in section and re.search(r"\]\[[^\]]+ manuals?\]", section)


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
