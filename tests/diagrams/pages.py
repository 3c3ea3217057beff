"""Pages of the robots in docs/robots: what each does, its parts, drawing, average stride and work.

python -m tests.diagrams.pages [--pictures] [ROBOT...]
"""

import ast
import io
import re
import sys
import tempfile
from collections import Counter
from pathlib import Path

import matplotlib
import numpy as np

import runtime
from blocks.networks import OnnxModel
from blocks.sensors import FSR
from graph import Actuator, Device
from runtime.record.analysis import stride_picture
from runtime.record.analysis.conditions import conditions
from runtime.record.analysis.legs import legs
from runtime.robot.loading.draw import draw_file
from runtime.robot.loading.file import load
from runtime.session.loop import Loop
from tests.checkout import ROOT
from tests.diagrams import gallery, motions
from tests.diagrams.robots import HEAVIEST, PROSTHESES, ROBOTS, SUITS, path

FOLDER = ROOT / "docs" / "robots"
MASSES, SPEEDS = (50, 70, 90, 110), (0.8, 1.2, 1.6)  # kg, m/s
SECONDS, STRIDES = 25.0, 8
WIDTH = 120.0  # mm


def head(robot):
    """Return the part of a page that follows from the diagram: text, parts, rate and pictures."""
    text = ast.get_docstring(ast.parse(path(robot).read_text()))
    _, diagram = load(path(robot))
    parts = Counter(part(block) for block in diagram if isinstance(block, (Device, FSR, OnnxModel)))
    listed = ", ".join(f"{name} × {number}" for name, number in parts.items())
    pictures = f"![block diagram](images/{robot}.svg)\n\n![average stride of the left leg](images/{robot}_stride.svg)"
    return f"# {robot}\n\n{text}\n\nParts: {listed}; {diagram.rate:g} Hz.\n\n{pictures}\n"


def part(block):
    """Return the name of a part: its model, the file of a network, or its type."""
    if isinstance(block, OnnxModel):
        return f"network {Path(block.file).stem}"
    return getattr(block, "model", type(block).__name__)


def work(robot):
    """Return the table of the work per stride of each joint of the left leg, on different walkers."""
    lines = ["| joint | kg |" + "".join(f" {speed} m/s |" for speed in SPEEDS), "|---|--:|" + "--:|" * len(SPEEDS)]
    for mass in [mass for mass in MASSES if mass <= HEAVIEST.get(robot, mass)]:
        body = {"mass": mass, "height": 1.55 + 0.005 * (mass - 50), "seed": mass}
        walks = [strides(robot, body | {"speed": speed}) for speed in SPEEDS]
        for joints in zip(*walks):
            cells = (f" {joint['positive_work']:.1f}, {joint['negative_work']:.1f} |" for joint in joints)
            lines.append(f"| {joints[0]['title']} | {mass} |" + "".join(cells).replace("-0.0", "0.0").replace("-", "−"))
    return (
        "Positive and negative work per stride in J, for adults of different mass and speed:\n\n"
        + "\n".join(lines)
        + "\n"
    )


def behaviour(robot):
    """Return the table of what a robot does in motions other than walking forward."""
    with tempfile.TemporaryDirectory() as folder:
        if robot in PROSTHESES:
            rows = motions.bearing(robot, *motions.write(Path(folder)))
            lines = [f"| {motion} | {knee:.0f}° | {-drop:.0f} mm |" for motion, (knee, drop) in rows.items()]
            head = "| motion | knee under 0.4 body weights, at most | hips lower by at most |\n|---|--:|--:|\n"
            return "A [recording](../reference/gait.md#direction) of several motions as the wearer:\n\n" + (
                head + "\n".join(lines) + "\n"
            )
        rows = motions.measure(robot, *motions.write(Path(folder)))
    return (
        "A [recording](../reference/gait.md#direction) of several motions as the wearer: time with a torque above\n"
        "0.25 N·m, and work:\n\n" + motions.table(rows)
    )


def margins(robot):
    """Return the table of the margins of each drive of the left leg, or of the only leg, measured in walking."""
    _, diagram = load(path(robot))
    drives = [block.path for block in diagram if isinstance(block, Actuator) and not block.path.startswith("right/")]
    lines = []
    for loop in (Loop(path(robot), f"{drive}.torque_command") for drive in drives):
        found = [number(20.0 * np.log10(loop.margins["gain"]), ".0f"), number(loop.margins["distance"], ".2f")]
        found = found if loop.linear else ["not linear", ""]
        largest, error = np.abs(loop.response).max(), loop.error.max()
        lines.append(f"| {loop.name} | {largest:.2f} | {' | '.join(found)} | {error:.3f} |")
    return (
        "Loop L of each drive, opened at its command, [measured](../how_to/analysis.md#of-a-robot) in walking, with\n"
        "the delays of bus and drive:\n\n"
        "| loop | largest \\|L\\| | gain margin, dB | least \\|1 + L\\| | error of 1 + L |\n|---|--:|--:|--:|--:|\n"
        + "\n".join(lines)
        + "\n"
    )


def number(value, form):
    """Return a margin as text, "none" without one."""
    return f"{value:{form}}" if np.isfinite(value) else "none"


def strides(robot, settings):
    """Return the measured strides of the joints of the left leg, or of the only leg."""
    joints = legs(run(robot, settings), last=STRIDES)
    return [joint for joint in joints if joint["title"].startswith("left")] or joints


def run(robot, settings):
    """Return the Trial of a run without fault."""
    trial = runtime.run(path(robot), SECONDS, settings=settings)
    assert trial.fault is None, (robot, settings, trial.fault)
    return trial


def write(robot):
    """Write the page of a robot."""
    parts = [head(robot)]
    parts += [work(robot), behaviour(robot), margins(robot)] if robot not in SUITS else []
    (FOLDER / f"{robot}.md").write_text("\n".join(parts))


def draw(robot):
    """Write the pictures of a robot: its block diagram, its average stride, and its wearer."""
    (FOLDER / "images").mkdir(parents=True, exist_ok=True)
    draw_file(path(robot), output=str(FOLDER / "images" / f"{robot}.svg"))
    picture = io.BytesIO()
    with matplotlib.rc_context({"svg.hashsalt": robot}):
        if robot in SUITS:
            trial = run(robot, {})
            names = (f"left/{joint}_{name}.y" for joint in SUITS[robot] for name in ("angle", "torque"))
            signals = [name for name in names if name in trial.signals]
            columns, about = stride_picture.of_signals(conditions([trial], last=STRIDES), signals), ", ".join(signals)
        else:
            joints = strides(robot, {})
            columns, about = stride_picture.by_joint(joints), stride_picture.about_legs(robot, joints)
        stride_picture.draw(columns, about, picture, "svg", width=WIDTH)
    rounded = re.sub(r"(\d\.\d)\d+", r"\1", picture.getvalue().decode())  # a third of the size, and few changes
    (FOLDER / "images" / f"{robot}_stride.svg").write_text(rounded)
    person = gallery.draw(load(path(robot))[1], robot, gallery.curves_of(columns))
    (FOLDER / "images" / f"{robot}_person.svg").write_text(person)


if __name__ == "__main__":
    (FOLDER / "images" / "key.svg").write_text(gallery.key())
    pictures_only = "--pictures" in sys.argv
    for name in [word for word in sys.argv[1:] if word != "--pictures"] or ROBOTS:
        draw(name)
        if not pictures_only:
            write(name)
