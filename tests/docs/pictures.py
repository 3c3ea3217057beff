"""Hand-drawn wiring pictures: docs/hardware/images, the pages that show them, and the tables beside them."""

import re
from pathlib import Path
from xml.etree import ElementTree

from tests.docs.pages import DOCS, PAGES

PICTURES = sorted((DOCS / "hardware" / "images").glob("*.svg"))
NAMES = [path.stem for path in PICTURES]
SVG = "{http://www.w3.org/2000/svg}"


def parse(path):
    """Return the root element of a picture."""
    return ElementTree.fromstring(path.read_text())


def pages_of(path):
    """Return the pages that show a picture."""
    shown = re.compile(r"!\[[^\]]+\]\((\S+\.svg)\)")
    return [
        page for page in PAGES if path in {(page.parent / name).resolve() for name in shown.findall(page.read_text())}
    ]


def plugs(path):
    """Return {plug: {(pin, signal), ...}} of a picture, from the pins of each group with `data-plug`."""
    return {
        group.get("data-plug"): {
            (int(pin.text), pin.get("data-signal")) for pin in group.iter(f"{SVG}text") if pin.get("data-signal")
        }
        for group in parse(path).iter(f"{SVG}g")
        if group.get("data-plug")
    }


def tables(text):
    """Return the tables of a page, each as a list of rows, and a row as a list of cells."""
    found = re.findall(r"(?:^\|.*\|\n)+", text, re.MULTILINE)
    return [[[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()] for table in found]


def tabulated(page: Path, plug):
    """Return {(pin, signal), ...} of a plug: of the column with its name in a table whose first column is `pin`."""
    for head, _, *rows in tables(page.read_text()):
        if head[0] == "pin" and plug in head:
            column = head.index(plug)
            return {(int(pin), row[column]) for row in rows if row[column] for pin in re.findall(r"\d+", row[0])}
    return None
