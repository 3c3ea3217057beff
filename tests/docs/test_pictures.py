"""Wiring pictures: each is shown and described, fits its frame, and agrees with the table beside it."""

import re

import pytest

from tests.docs.pictures import NAMES, PICTURES, SVG, pages_of, parse, plugs, tabulated
from tests.graph.drawing.browser import browse, needs_browser

every_picture = pytest.mark.parametrize("path", PICTURES, ids=NAMES)
MEASURE = """
const box = document.querySelector("svg").viewBox.baseVal;
return [...document.querySelectorAll("svg text")].map((text) => {
  const at = text.getBBox();
  return [text.textContent, at.x, at.y, at.x + at.width, at.y + at.height, box.width, box.height];
});
"""


@every_picture
def test_picture_is_shown_by_a_page_with_a_description(path):
    assert pages_of(path)


@every_picture
def test_picture_has_title_and_description_for_a_screen_reader(path):
    root = parse(path)
    assert root.get("role") == "img" and root.get("aria-labelledby") == "title desc"
    title, description = root.find(f"{SVG}title"), root.find(f"{SVG}desc")
    assert title.get("id") == "title" and len(title.text) > 10 and description.get("id") == "desc"
    assert len(description.text) > len(title.text)


@every_picture
def test_picture_needs_no_font_script_or_network(path):
    text = path.read_text()
    assert not re.search(r"@font-face|<script|<image|href=|url\(", text)
    assert len(re.findall(r"https?://", text)) == 1  # the name of the format


def test_pictures_share_one_style():
    styles = {re.search(r"<style>.*</style>", path.read_text(), re.DOTALL)[0] for path in PICTURES}
    assert len(styles) == 1 and len(PICTURES) == 7


@every_picture
def test_pins_agree_with_the_table_beside_the_picture(path):
    for plug, pins in plugs(path).items():
        listed = [found for page in pages_of(path) if (found := tabulated(page, plug)) is not None]
        assert listed == [pins], plug


def test_pictures_have_the_plugs_that_are_wired_by_pin():
    assert sum((list(plugs(path)) for path in PICTURES), []) == [
        "40-pin header",
        "I2C bus 1",
        "J17",
        "UART, V2.0 board",
        "CAN, V2.0 board",
        "UART, V3.0 board",
        "XT30 (2+2), V3.0 board",
    ]


@needs_browser
@every_picture
@pytest.mark.soak
def test_text_fits_the_frame_and_no_text_covers_another(path, tmp_path):
    texts = browse(f"<html><body>{path.read_text()}</body></html>", MEASURE, tmp_path)
    assert texts
    for text, left, top, right, bottom, width, height in texts:
        assert 4 <= left and 0 <= top and right <= width - 4 and bottom <= height, text
    for number, (text, left, top, right, bottom, *_) in enumerate(texts):
        for other, x, y, end, below, *_ in texts[number + 1 :]:
            # a line of a paragraph may touch the next
            assert left >= end or x >= right or top >= below - 3 or y >= bottom - 3, (text, other)
