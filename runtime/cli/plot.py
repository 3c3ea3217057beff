"""`plot RECORDING SIGNAL...`: plot signals of a recording."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from runtime.cli import drawing, selection
from runtime.cli.parsing import Parser
from runtime.cli.reading import read
from runtime.host.console.progress import Progress
from runtime.host.console.terminal import print_lines
from runtime.host.errors import OK, BadInput, UnknownName
from runtime.record.analysis import pictures
from runtime.record.storage.parts import newest

if TYPE_CHECKING:
    from argparse import Namespace

MILLIMETRES = {"mm": 1.0, "cm": 10.0, "in": 25.4}
WIDTHS = (40.0, 500.0)  # mm
EPILOG = """\
examples:
  plot recordings                the newest recording of a folder
  plot trial.mcap                one picture per subsystem, one plot per unit
  plot trial.mcap left/knee      all signals of a block or subsystem
  plot trial.mcap left/knee.position left/knee.torque
  plot without.mcap assisted.mcap left/knee.torque
                                 trials over each other in time
  plot trial.mcap --strides      angle, torque and power over the gait cycle
  plot trial.mcap --strides left/knee.torque -o torque.svg
  plot trial.mcap --strides --width 85mm -o figure.pdf
                                 for a column of a paper
  plot without.mcap assisted.mcap --strides
                                 conditions in one picture
  plot trial.mcap --strides --between start "mark 1" --between "mark 1" end
"""


def main(arguments: Sequence[str]) -> int:
    """Run the command. Returns the exit code; raises BadInput for an unknown signal or recording."""
    parser = Parser(
        "plot", "Plot signals of a recording with faults and marks, over time or over the gait cycle.", EPILOG
    )
    parser.add_argument(
        "recording", type=newest, metavar="RECORDING", help="the .mcap file of a recording, or a folder: its newest"
    )
    parser.add_argument(
        "signals",
        nargs="*",
        metavar="SIGNAL",
        help="signal, block or subsystem: left/knee.position, left/knee, left (default: one picture per subsystem); "
        "or further recordings, which are drawn over the first",
    )
    parser.add_argument("--strides", action="store_true", help="mean and standard deviation over the gait cycle")
    selection.add(parser)
    parser.add_argument(
        "--width",
        type=length,
        metavar="WIDTH",
        help="with --strides: width of the picture, such as 85mm, 8.5cm or 3.35in (default: 85mm, or 180mm for more "
        "than two columns of plots)",
    )
    parser.add_argument("--svg", action="store_true", help="write SVG instead of PNG")
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help=".png, .svg or .pdf (default: beside the recording)"
    )
    options = parser.parse_args(arguments, mixed=True)
    selection.check(options, options.strides)
    if options.width and not options.strides:
        raise BadInput("--width needs --strides")
    drawing.check(options.output)
    recordings = [options.recording, *(newest(word) for word in options.signals if is_recording(word))]
    options.signals = [word for word in options.signals if not is_recording(word)]
    with Progress(f"drawing {options.recording.name}") as progress:
        share = 0.5 / len(recordings)
        trials = [read(path, progress, number * share, (number + 1) * share) for number, path in enumerate(recordings)]
        try:
            if options.strides:
                drawn = pictures.over_strides(selection.conditions_of(trials, options), options.signals, options.width)
            else:
                drawn = pictures.over_time(trials, options.signals)
            for number, (name, draw) in enumerate(drawn.items()):
                path = write(options, name if len(drawn) > 1 or options.output is None else "", draw)
                progress(0.5 + 0.5 * (number + 1) / len(drawn))
                progress.terminal.erase()
                print_lines([path])
        except UnknownName as error:
            raise BadInput(error.args[0] + ", nor is there such a recording" * (not error.hint)) from None
    return OK


def length(text: str) -> float:
    """Return the mm of a width, such as "85mm", "8.5 cm" or "3.35in". Raises BadInput."""
    match = re.fullmatch(r"(\d+\.?\d*) ?(mm|cm|in)", text)
    width = float(match[1]) * MILLIMETRES[match[2]] if match else 0.0
    if not WIDTHS[0] <= width <= WIDTHS[1]:
        raise BadInput(f"--width {text}: expected {WIDTHS[0]:g}mm to {WIDTHS[1]:g}mm, as in 85mm, 8.5cm or 3.35in")
    return width


def is_recording(word: str) -> bool:
    """Return whether an argument is the path of a recording, or of a folder with recordings, rather than a signal."""
    return newest(word).suffix == ".mcap"


def write(options: Namespace, name: str, draw: Callable[..., Any]) -> str:
    """Write a picture and return its path. Only a file named with -o is overwritten."""
    name = pictures.file_name(name)
    output = (
        options.output
        if options.output is None or not name
        else options.output.with_stem(f"{options.output.stem}_{name}")
    )
    stem = options.recording.parent / f"{options.recording.stem}_{name}"
    return drawing.write(draw, output, str(stem), ".svg" if options.svg else ".png")
