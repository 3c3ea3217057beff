"""HTML page of a drawing, in one file: pan, zoom, search, fold subsystems, and show descriptions of blocks."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from graph.drawing.style import BACK, FAMILIES, FRAME_TITLE
from graph.drawing.svg import FEEDBACK, body, css, used

if TYPE_CHECKING:
    from graph.drawing.model import Drawing

HERE = Path(__file__).parent


def page(drawing: Drawing) -> str:
    """Return the HTML text of a drawing."""
    return f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{escape(drawing.name)}</title>
<style>
{css()}
{asset("page.css")}</style>
</head>
<body>
<header id="bar">
<h1>{escape(drawing.name)}<small>{drawing.rate:g} Hz, {len(drawing.cards)} blocks</small></h1>
<div id="finder">
<input id="search" type="search" placeholder="search   /" aria-label="search blocks" autocomplete="off">
<ul id="results"></ul>
</div>
{"".join(button(*words) for words in BUTTONS)}{"".join(button(*words, hidden=not drawing.frames) for words in FOLDING)}
</header>
<svg id="canvas" xmlns="http://www.w3.org/2000/svg"><g id="scene">
{chr(10).join(body(drawing))}
</g></svg>
<aside id="card" hidden></aside>
<footer id="legend">{"".join(legend(drawing))}</footer>
<script type="application/json" id="data">{data(drawing)}</script>
<script>
{asset("fold.js")}
{asset("card.js")}
{asset("page.js")}</script>
</body>
</html>
"""


BUTTONS = (("further", "zoom out (-)", "−"), ("closer", "zoom in (+)", "+"), ("fit", "the whole drawing (0)", "fit"))
FOLDING = (("fold", "fold every subsystem", "fold all"), ("unfold", "unfold every subsystem", "unfold all"))


def button(name: str, title: str, text: str, hidden: bool = False) -> str:
    """Return the HTML of a button."""
    return f'<button id="{name}" title="{title}"{" hidden" * hidden}>{text}</button>'


def asset(name: str) -> str:
    """Return the text of a file beside this module."""
    return (HERE / name).read_text(encoding="utf-8")


def data(drawing: Drawing) -> str:
    """Return the data for the scripts as JSON without "<", which could end the script element."""
    shape: dict[str, Any] = {"width": drawing.width, "height": drawing.height, "head": FRAME_TITLE}
    places = ("path", "subsystem", "x", "y", "width", "height")
    shape["boxes"] = [{key: getattr(item, key) for key in places} for item in drawing.boxes]
    shape["frames"] = [asdict(item) for item in drawing.frames]
    shape["lines"] = [{"subsystem": item.subsystem, "points": item.points} for item in drawing.lines]
    families = {name: asdict(family) for name, family in FAMILIES.items()}
    parts = {"drawing": shape, "cards": drawing.cards, "elements": drawing.elements, "families": families}
    text = json.dumps(parts, ensure_ascii=False)
    return text.replace("<", "\\u003c")


def legend(drawing: Drawing) -> Iterator[str]:
    """Yield the HTML of each entry of the legend."""
    for name in used(drawing):
        family = FAMILIES[name]
        yield f'<span><i style="--edge: {family.edge}; --head: {family.head}"></i>{family.title}</span>'
    if any(line.loop for line in drawing.lines):
        yield f'<span><i class="dashes" style="--edge: {BACK}"></i>{FEEDBACK}</span>'
