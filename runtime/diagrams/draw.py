"""Drawings of diagram files as SVG, PNG, Mermaid text or an interactive HTML page."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from graph.drawing import draw, mermaid, page, svg
from runtime.base.errors import BadInput
from runtime.console.styles import count, place
from runtime.console.terminal import program
from runtime.diagrams.file import blamed, load

if TYPE_CHECKING:
    from runtime.diagrams.overrides import Settings

FORMATS = {"svg": ".svg", "png": ".png", "mermaid": ".mmd", "html": ".html"}
BY_SUFFIX = {suffix: name for name, suffix in FORMATS.items()} | {".htm": "html", ".mermaid": "mermaid"}
PNG_SIZE_LIMIT = 12_000  # px, of the longer side
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")


def draw_file(
    path: Path,
    settings: Settings = (),
    rate: float | None = None,
    output: str | None = None,
    form: str | None = None,
    all_ports: bool = False,
) -> tuple[list[str], list[str]]:
    """Draw a diagram file.

    settings, rate : as in a run
    output : file to write, "-" for standard output, None for the diagram's name
    form : a key of FORMATS; None for the format of the output's suffix, or svg
    all_ports : whether ports without a connection are drawn

    Returns (lines for standard output, remarks for standard error). Raises BadInput.
    """
    _, diagram = load(path, settings)
    if rate is not None:
        diagram.rate = rate
    form, target = choose(form, output, diagram.name)
    drawing = blamed(path, lambda: draw(diagram, all_ports=all_ports, place=place))
    wrong = sum(len(box.wrong) for box in drawing.boxes)
    remarks = [f"{count(wrong, 'error')} drawn in red: {program()} check {path} lists them"] if wrong else []
    text = {"svg": svg, "png": svg, "mermaid": mermaid, "html": page}[form](drawing)
    if target is None:
        return [text.rstrip("\n")], remarks
    if form == "png":
        rasterise(text, target)
    else:
        _save(target, text)
    size = "" if form in ("mermaid", "html") else f", {drawing.width:.0f} × {drawing.height:.0f} px"
    return [f"{target}: {count(len(drawing.boxes), 'block')}{size}"], remarks


def choose(form: str | None, output: str | None, name: str) -> tuple[str, Path | None]:
    """Return (format, Path or None for standard output). Raises BadInput.

    form, output : as of `draw_file`
    name : of the diagram, from which the name of the file is made
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


def _save(target: Path, text: str) -> None:
    try:
        target.write_text(text, encoding="utf-8")
    except OSError as error:
        raise BadInput(f"cannot write {target}: {error.strerror}") from None


def rasterise(text: str, target: Path, scale: float = 2.0) -> None:
    """Write an SVG as PNG with the first installed tool. Raises BadInput if none is installed or it fails.

    text : of the SVG
    scale : px of the PNG per px of the SVG, reduced where a side would exceed PNG_SIZE_LIMIT
    """
    tools = (_with_cairosvg, _with_rsvg, _with_inkscape, _with_browser)
    size = [float(text.split(f'{side}="', 1)[1].split('"', 1)[0]) for side in ("width", "height")]
    scale = min(scale, PNG_SIZE_LIMIT / max(size))
    with tempfile.TemporaryDirectory(prefix="tickwork-draw-") as folder:
        source, picture = Path(folder) / "drawing.svg", Path(folder) / "drawing.png"
        source.write_text(text, encoding="utf-8")
        for tool in tools:
            if tool(source, picture, size, scale, Path(folder)):
                break
        else:
            raise BadInput(
                "no converter from SVG to PNG is installed: pip install cairosvg, or sudo apt install librsvg2-bin, or "
                "write an SVG and open it in a browser"
            )
        if not picture.exists():
            raise BadInput(
                f"{tool.__name__.removeprefix('_with_')} failed to write a PNG: write an SVG instead, with --format svg"
            )
        try:
            shutil.copyfile(picture, target)
        except OSError as error:
            raise BadInput(f"cannot write {target}: {error.strerror}") from None


# Each tool returns whether it is installed.


def _with_cairosvg(source: Path, picture: Path, size: Sequence[float], scale: float, folder: Path) -> bool:
    if find_spec("cairosvg") is None:
        return False
    import cairosvg  # pyright: ignore[reportMissingImports]

    cairosvg.svg2png(url=str(source), write_to=str(picture), scale=scale)
    return True


def _with_rsvg(source: Path, picture: Path, size: Sequence[float], scale: float, folder: Path) -> bool:
    return _call("rsvg-convert", "--zoom", f"{scale:g}", "--output", picture, source)


def _with_inkscape(source: Path, picture: Path, size: Sequence[float], scale: float, folder: Path) -> bool:
    return _call("inkscape", f"--export-width={round(size[0] * scale)}", f"--export-filename={picture}", source)


def _with_browser(source: Path, picture: Path, size: Sequence[float], scale: float, folder: Path) -> bool:
    browser = next(filter(shutil.which, BROWSERS), None)
    as_root = ["--no-sandbox"] if os.geteuid() == 0 else []
    return browser is not None and _call(
        browser,
        "--headless",
        *as_root,
        "--disable-gpu",
        "--no-first-run",
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-sync",
        "--hide-scrollbars",
        f"--user-data-dir={folder / 'profile'}",
        f"--force-device-scale-factor={scale:g}",
        f"--window-size={round(size[0])},{round(size[1])}",
        f"--screenshot={picture}",
        source.as_uri(),
    )


def _call(program: str, *arguments: str | Path) -> bool:
    if shutil.which(program) is None:
        return False
    subprocess.run(
        [program, *map(str, arguments)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, timeout=120, check=False
    )
    return True
