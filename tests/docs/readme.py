"""Picture of the README: the diagram of the tutorial's exoskeleton above its average stride."""

import io
import re

import matplotlib
import numpy as np

import runtime
from runtime.record.analysis import picture, stride_picture
from runtime.record.analysis.picture import BLUE, GREEN, INK, ORANGE

NAME = "exoskeleton.svg"
MARGIN = 24  # px


def average_stride(trial, width):
    """Return an SVG of angle, torque and power of the knee, side by side. width : inches"""
    torque, velocity = trial.strides("knee.torque"), trial.strides("knee.velocity")
    rows = (
        ("knee flexion (°)", np.degrees(trial.strides("knee.position")), BLUE),
        ("torque of the drive (N·m)", torque, ORANGE),
        ("power of the drive (W)", torque * velocity, GREEN),
    )
    figure = picture.figure(width, 2.4)
    for axis, (label, strides, colour) in zip(figure.subplots(1, len(rows)), rows):
        picture.gait_cycle(axis, size=9, step=20)
        stride_picture.plot(axis, stride_picture.averaged("", colour, "-", strides))
        axis.set_title(label, fontsize=10, color=INK)
        axis.set_xlabel("gait cycle (%)", fontsize=9, color=INK)
    file = io.BytesIO()
    with matplotlib.rc_context({"svg.hashsalt": "readme"}):
        picture.save(figure, file, "svg")
    return file.getvalue().decode()


def draw(recording, diagram):
    """Return the picture, an SVG. recording : path or folder; diagram : SVG that `draw` has written"""
    width, height = (int(re.search(rf'{name}="(\d+)"', diagram)[1]) for name in ("width", "height"))
    stride = average_stride(runtime.load(recording), width / 96.0)
    box = re.search(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', stride)
    below = round(width * float(box[2]) / float(box[1]))
    parts = []
    for text, top, tall in ((diagram, 0, height), (stride, height + MARGIN, below)):
        text = text[text.index("<svg") :]
        head, rest = text[: text.index(">") + 1], text[text.index(">") + 1 :]
        shape = re.search(r'viewBox="[^"]*"', head)[0]
        links = 'xmlns:xlink="http://www.w3.org/1999/xlink"'
        parts.append(f'<svg y="{top}" width="{width}" height="{tall}" {shape} {links}>{rest}')
    total = height + MARGIN + below
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{total}" viewBox="0 0 {width} {total}">\n'
        f'<rect width="{width}" height="{total}" fill="#ffffff"/>\n' + "".join(parts) + "</svg>\n"
    )
