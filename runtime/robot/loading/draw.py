"""Drawings of diagram files as SVG, PNG, Mermaid text, an interactive HTML page, or the robot's URDF."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from graph.drawing import draw, mermaid, page, svg
from runtime.host.console.styles import count, place
from runtime.host.console.terminal import program
from runtime.host.errors import BadInput
from runtime.host.replaced_file import write
from runtime.robot.loading.file import call_code_of_blocks, load
from runtime.robot.loading.urdf import urdf

if TYPE_CHECKING:
    from runtime.robot.loading.overrides import Settings

FORMATS = {"svg": ".svg", "png": ".png", "mermaid": ".mmd", "html": ".html", "urdf": ".urdf"}
BY_SUFFIX = {suffix: name for name, suffix in FORMATS.items()} | {".htm": "html", ".mermaid": "mermaid"}
PNG_SIZE_LIMIT = 12_000  # px, of the longer side


def draw_file(
    path: Path,
    settings: Settings = (),
    rate: float | None = None,
    output: str | None = None,
    form: str | None = None,
    all_ports: bool = False,
    whole: bool = False,
) -> tuple[list[str], list[str]]:
    """Draw a diagram file.

    settings, rate : as in a run
    output : file to write, "-" for standard output, None for the diagram's name
    form : a key of FORMATS; None for the format of the output's suffix, or svg
    all_ports : whether ports without a connection are drawn
    whole : whether a subsystem that is like another, such as the right leg, is drawn with its blocks in a picture too

    Returns (lines for standard output, remarks for standard error). Raises BadInput.
    """
    _, diagram = load(path, settings)
    if rate is not None:
        diagram.rate = rate
    form, target = choose(form, output, diagram.name)
    if form == "urdf":
        text = urdf(diagram)
        if target is not None:
            _save(target, text.encode())
        return [text.rstrip("\n") if target is None else f"{target}: {count(text.count('<joint '), 'joint')}"], []
    fold = form in ("svg", "png") and not whole
    drawing = call_code_of_blocks(path, lambda: draw(diagram, all_ports=all_ports, fold=fold, place=place))
    wrong = sum(len(box.wrong) for box in drawing.boxes)
    remarks = [f"{count(wrong, 'error')} drawn in red: {program()} check {path} lists them"] if wrong else []
    text = {"svg": svg, "png": svg, "mermaid": mermaid, "html": page}[form](drawing)
    if target is None:
        return [text.rstrip("\n")], remarks
    if form == "png":
        rasterise(text, target)
    else:
        _save(target, text.encode())
    size = "" if form in ("mermaid", "html") else f", {drawing.width:.0f} × {drawing.height:.0f} px"
    return [f"{target}: {count(len(drawing.cards), 'block')}{size}"], remarks


def choose(form: str | None, output: str | None, name: str) -> tuple[str, Path | None]:
    """Return (format, Path or None for standard output). Raises BadInput.

    form, output : as in `draw_file`
    name : name of the diagram, which names the file
    """
    if output == "-" and form == "png":
        raise BadInput("a PNG cannot be written to standard output: name a file with -o")
    if output == "-":
        return form or "svg", None
    if output is None:
        return form or "svg", Path(
            "".join(c if c.isalnum() or c in "-_." else "_" for c in name) + FORMATS[form or "svg"]
        )
    suffix = Path(output).suffix.lower()
    if form is None and suffix and suffix not in BY_SUFFIX:
        raise BadInput(
            f"-o {output}: unknown format {suffix}: use one of {', '.join(FORMATS.values())}, or pass --format"
        )
    form = form or BY_SUFFIX.get(suffix, "svg")
    return form, Path(output) if suffix else Path(output + FORMATS[form])


def _save(target: Path, data: bytes) -> None:
    try:
        write(target, data)
    except OSError as error:
        raise BadInput(f"cannot write {target}: {error.strerror}") from None


def rasterise(text: str, target: Path, scale: float = 2.0) -> None:
    """Write an SVG as PNG. Raises BadInput if the file cannot be written.

    text : text of the SVG
    scale : px of the PNG per px of the SVG, reduced where a side would exceed PNG_SIZE_LIMIT

    The fonts are those of the system and, for a system without fonts, those that matplotlib contains.
    """
    import resvg_py

    size = [float(text.split(f'{side}="', 1)[1].split('"', 1)[0]) for side in ("width", "height")]
    scale = min(scale, PNG_SIZE_LIMIT / max(size))
    matplotlib = find_spec("matplotlib")
    assert matplotlib and matplotlib.origin
    fonts = Path(matplotlib.origin).parent / "mpl-data" / "fonts" / "ttf"
    _save(target, bytes(resvg_py.svg_to_bytes(svg_string=text, zoom=scale, font_dirs=[str(fonts)])))
