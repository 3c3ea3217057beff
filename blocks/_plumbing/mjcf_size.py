"""Size of the model that an MJCF file describes, before MuJoCo compiles it."""

from __future__ import annotations

import math
from pathlib import Path
from xml.etree import ElementTree

COPIES_LIMIT = 10_000  # of bodies and other elements, by <replicate>, <composite> and <flexcomp>
HEIGHTS_LIMIT = 10_000_000  # points of a height field without a file
COPYING = ("replicate", "composite", "flexcomp")


def check_size(path: Path) -> None:
    """Raise ValueError for files of a few lines that describe a model of any size."""
    root = whole(path, path.parent, {path})
    if root is None:
        return
    if (copies := copies_in(root)) > COPIES_LIMIT:
        raise ValueError(
            f"its elements {', '.join(f'<{tag}>' for tag in COPYING)} make {copies} copies, above the limit of "
            f"{COPIES_LIMIT}: reduce their count"
        )
    for field in root.iter("hfield"):
        if (points := counted(field.get("nrow", "0")) * counted(field.get("ncol", "0"))) > HEIGHTS_LIMIT:
            raise ValueError(
                f"the hfield {field.get('name', '')!r} has {points} points, above the limit of {HEIGHTS_LIMIT}: reduce "
                "nrow and ncol"
            )


def whole(path: Path, folder: Path, read: set[Path]) -> ElementTree.Element | None:
    """Return the root of an MJCF file with the elements that it includes, each file once; None if it cannot be read.

    folder : from which the names of included files count; read : files that have been read
    """
    try:
        root = ElementTree.parse(path).getroot()
    except (ElementTree.ParseError, OSError):  # MuJoCo names the error
        return None
    for element in list(root.iter()):
        for include in element.findall("include"):
            file = folder / include.get("file", "")
            if file not in read:
                read.add(file)
                element.extend(whole(file, folder, read) or ())
    return root


def copies_in(element: ElementTree.Element) -> int:
    """Return the number of copies that an element makes of others, also nested."""
    inside = sum(map(copies_in, element))
    return counted(element.get("count", "1")) * max(1, inside) if element.tag in COPYING else inside


def counted(text: str) -> int:
    """Return the product of the whole numbers in an attribute; 1 where MuJoCo will reject them."""
    try:
        return math.prod(int(word) for word in text.split())
    except ValueError:
        return 1
