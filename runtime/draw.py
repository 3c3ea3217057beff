"""`python -m runtime draw FILE`: a diagram as SVG, PNG, Mermaid text, or a page to explore."""

import os
import shutil
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

from graph.drawing import draw, mermaid, page, svg
from runtime.cli import Parser, setting
from runtime.errors import OK, BadInput
from runtime.lines import count, place
from runtime.load import load
from runtime.terminal import complain, program, tell

SUFFIXES = {"svg": ".svg", "png": ".png", "mermaid": ".mmd", "html": ".html"}
FORMATS = {suffix: name for name, suffix in SUFFIXES.items()} | {".htm": "html", ".mermaid": "mermaid"}
ENOUGH = 12_000                 # px, the longer side of a PNG at most
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")


def draw_command(arguments):
    """Run the command. Returns the exit code."""
    parser = Parser("draw", "Draw a diagram, from left to right; feedback goes back below, dashed.")
    parser.add_argument("file", type=Path, help="a diagram file, such as diagrams/knee_exo.py")
    parser.add_argument("-o", "--output", metavar="NAME", help="file to write, - for standard output (default: the diagram's name)")
    parser.add_argument("--format", choices=list(SUFFIXES), help="svg, for papers; png; mermaid, for Markdown; html, a page to explore (default: by NAME, else svg)")
    parser.add_argument("--all-ports", action="store_true", help="show the ports that nothing is wired to as well")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", dest="settings", help="a parameter, as in a run")
    options = parser.parse_args(arguments)
    _, diagram = load(options.file, [setting(s) for s in options.settings])
    drawing = draw(diagram, all_ports=options.all_ports, place=place)
    form, target = choose(options.format, options.output, diagram.name)
    if target is None:
        if form == "png":
            raise BadInput("a PNG cannot go to standard output: name a file with -o")
        sys.stdout.write({"svg": svg, "mermaid": mermaid, "html": page}[form](drawing))
        return OK
    if form == "png":
        rasterise(svg(drawing), target)
    else:
        save(target, {"svg": svg, "mermaid": mermaid, "html": page}[form](drawing))
    size = "" if form in ("mermaid", "html") else f", {drawing.width:.0f} × {drawing.height:.0f} px"
    tell([f"{target}: {count(len(drawing.boxes), 'block')}{size}"])
    wrong = sum(len(box.wrong) for box in drawing.boxes)
    if wrong:
        complain([f"{count(wrong, 'error')} drawn in red: {program()} check {options.file} tells more"])
    return OK


def choose(form, output, name):
    """(format, Path or None for standard output) from what was asked for."""
    if output == "-":
        return form or "svg", None
    if output is None:
        return form or "svg", Path("".join(c if c.isalnum() or c in "-_." else "_" for c in name) + SUFFIXES[form or "svg"])
    suffix = Path(output).suffix.lower()
    if form is None and suffix and suffix not in FORMATS:
        raise BadInput(f"-o {output}: a drawing cannot be written as {suffix}: choose from {', '.join(SUFFIXES.values())}, or say --format")
    form = form or FORMATS.get(suffix, "svg")
    return form, Path(output) if suffix else Path(output + SUFFIXES[form])


def save(target, text):
    try:
        target.write_text(text, encoding="utf-8")
    except OSError as error:
        raise BadInput(f"cannot write {target}: {error.strerror}") from None


def rasterise(text, target, scale=2.0):
    """Write an SVG as PNG with the first tool there is. BadInput if there is none, or it fails."""
    tools = (with_cairosvg, with_rsvg, with_inkscape, with_browser)
    size = [float(text.split(f'{side}="', 1)[1].split('"', 1)[0]) for side in ("width", "height")]
    scale = min(scale, ENOUGH / max(size))
    with tempfile.TemporaryDirectory(prefix="tickwork-draw-") as folder:
        source, picture = Path(folder) / "drawing.svg", Path(folder) / "drawing.png"
        source.write_text(text, encoding="utf-8")
        for tool in tools:
            if tool(source, picture, size, scale, Path(folder)):
                break
        else:
            raise BadInput("no tool here turns SVG into PNG: `pip install cairosvg`, or `sudo apt install librsvg2-bin`, or write an SVG and open it in a browser")
        if not picture.exists():
            raise BadInput(f"{tool.__name__.removeprefix('with_')} wrote no PNG: write an SVG instead, with --format svg")
        try:
            shutil.copyfile(picture, target)
        except OSError as error:
            raise BadInput(f"cannot write {target}: {error.strerror}") from None


# Each tool returns whether it is installed.

def with_cairosvg(source, picture, size, scale, folder):
    if find_spec("cairosvg") is None:
        return False
    import cairosvg

    cairosvg.svg2png(url=str(source), write_to=str(picture), scale=scale)
    return True


def with_rsvg(source, picture, size, scale, folder):
    return call("rsvg-convert", "--zoom", f"{scale:g}", "--output", picture, source)


def with_inkscape(source, picture, size, scale, folder):
    return call("inkscape", f"--export-width={round(size[0] * scale)}", f"--export-filename={picture}", source)


def with_browser(source, picture, size, scale, folder):
    browser = next(filter(shutil.which, BROWSERS), None)
    as_root = ["--no-sandbox"] if os.geteuid() == 0 else []
    return browser is not None and call(
        browser, "--headless", *as_root, "--disable-gpu", "--no-first-run", "--disable-background-networking", "--disable-component-update",
        "--disable-sync", "--hide-scrollbars", f"--user-data-dir={folder / 'profile'}", f"--force-device-scale-factor={scale:g}",
        f"--window-size={round(size[0])},{round(size[1])}", f"--screenshot={picture}", source.as_uri())


def call(program, *arguments):
    if shutil.which(program) is None:
        return False
    subprocess.run([program, *map(str, arguments)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, timeout=120, check=False)
    return True
