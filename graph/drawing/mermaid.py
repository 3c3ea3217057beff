"""Mermaid text of a drawing, for documents that render it. It contains the connections; Mermaid does the layout."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from graph.drawing.style import FAMILIES
from graph.drawing.svg import used

if TYPE_CHECKING:
    from graph.drawing.model import Drawing, End, Line


def mermaid(drawing: Drawing) -> str:
    """Return a drawing as the text of a Mermaid flowchart."""
    names = {box.path: f"b{index}" for index, box in enumerate(drawing.boxes)}
    lines = ["flowchart LR", *inside(drawing, "", names, "    ")]
    frames = {frame.path: f"f{index}" for index, frame in enumerate(drawing.frames)}
    for source, target, back in wires(drawing):
        block, _, output = source.partition(".")
        if isinstance(target, str):
            other, _, port = target.partition(".")
            label, end = output if output == port else f"{output} → {port}", names.get(f"{other}=command", names[other])
        else:
            label, end = f"{output} → enabled", frames[target[0]]
        lines.append(f"    {names[block]} {'-.->' if back else '-->'}|{quoted(label)}| {end}")
    lines += [
        f"    classDef {name} fill:{FAMILIES[name].head},stroke:{FAMILIES[name].edge},color:#1f2937"
        for name in used(drawing)
    ]
    return "\n".join(lines) + "\n"


def inside(drawing: Drawing, subsystem: str, names: dict[str, str], indent: str) -> Iterator[str]:
    """Yield the lines for the boxes and frames in one frame."""
    for box in drawing.boxes:
        if box.subsystem == subsystem:
            text = f"{box.title}<br>{box.subtitle}" if box.subtitle else box.title
            yield f"{indent}{names[box.path]}[{quoted(text)}]:::{box.family}"
    for index, frame in enumerate(drawing.frames):
        if frame.subsystem == subsystem:
            yield f"{indent}subgraph f{index}[{quoted(frame.title)}]"
            yield from inside(drawing, frame.path, names, indent + "    ")
            yield f"{indent}end"


def wires(drawing: Drawing) -> Iterator[tuple[str, End, bool]]:
    """Yield (port of the source, port of the target or pin of a frame, whether it is feedback) of every wire."""
    following: dict[tuple[str, End], list[Line]] = {}
    for line in drawing.lines:
        following.setdefault((line.signal, line.source), []).append(line)
    for line in drawing.lines:
        if isinstance(line.source, str):
            for target, back in follow(line, following, False):
                yield line.source, target, back


def follow(line: Line, following: dict[tuple[str, End], list[Line]], back: bool) -> Iterator[tuple[End, bool]]:
    """Yield (target, whether it is feedback) for each block that a line reaches through pins."""
    back = back or line.loop
    if isinstance(line.target, str) or line.target[1] == "enabled":
        yield line.target, back
    for further in following.get((line.signal, line.target), ()):
        yield from follow(further, following, back)


def quoted(text: str) -> str:
    """Return text as a Mermaid string."""
    return '"' + text.replace("#", "#35;").replace('"', "#quot;") + '"'
