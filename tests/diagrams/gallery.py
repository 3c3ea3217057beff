"""Line drawings of the robots on their wearer, for the gallery of the site: devices where their paths name a place.

Left leg and arm are near the viewer, the right ones behind. A device without a known place or symbol is an error.
"""

from __future__ import annotations

from html import escape
from math import cos, radians, sin
from typing import NamedTuple

import numpy as np

from blocks.imus import ICM20948, MicroStrain
from blocks.sensors import ADS1115, FSR, NAU7802, Insole, Microcontroller
from graph import Device
from graph.device import Actuator

WIDTH, HEIGHT = 300, 264  # px
GROUND = 246
HIP, NECK, HEAD = (80.0, 122.0), (85.0, 60.0), (88.0, 33.0)
THIGH, SHANK, FOOT = 58.0, 56.0, 24.0  # px
POSE = {"left": (21.0, 9.0, 12.0), "right": (-17.0, 14.0, -22.0)}  # degrees: hip and knee flexion, foot from the ground
LIMBS = {"left": ("#aab4c0", 14.0), "right": ("#d3d9e0", 12.0)}  # colour and width of a leg
ARM = "#95a1ae"
DRIVE, IMU, FORCE, BOARD = "#d55e00", "#0072b2", "#009e73", "#5f6b7a"
SYMBOLS = {  # type of a block: (symbol, its name in the key)
    Actuator: ("drive", "drive"),
    MicroStrain: ("imu", "inertial sensor"),
    ICM20948: ("imu", "inertial sensor"),
    Insole: ("insole", "insole"),
    FSR: ("force", "force sensor"),
    NAU7802: ("cell", "load cell"),
    Microcontroller: ("board", "computer, microcontroller or converter"),
    ADS1115: ("board", "computer, microcontroller or converter"),
}
SPARK = (164.0, 128.0)  # px: left end and width of the curves
TALL, STEP = 50.0, 84.0  # px: height of a curve, and from one to the next


class Leg(NamedTuple):
    """Points of a leg in px."""

    hip: tuple[float, float]
    knee: tuple[float, float]
    ankle: tuple[float, float]
    heel: tuple[float, float]
    toe: tuple[float, float]


def leg(side):
    """Return the Leg of a side in its pose."""
    hip, knee, foot = map(radians, POSE[side])
    at_knee = (HIP[0] + THIGH * sin(hip), HIP[1] + THIGH * cos(hip))
    at_ankle = (at_knee[0] + SHANK * sin(hip - knee), at_knee[1] + SHANK * cos(hip - knee))
    heel = along(at_ankle, (at_ankle[0] - cos(foot), at_ankle[1] + sin(foot)), 7.0)
    heel = (heel[0] + 8.0 * sin(foot), heel[1] + 8.0 * cos(foot))
    return Leg(HIP, at_knee, at_ankle, heel, (heel[0] + FOOT * cos(foot) + 7, heel[1] - FOOT * sin(foot)))


def along(start, end, length):
    """Return the point at a distance in px from `start` towards `end`."""
    size = np.hypot(end[0] - start[0], end[1] - start[1])
    return start[0] + (end[0] - start[0]) * length / size, start[1] + (end[1] - start[1]) * length / size


def between(start, end, share, aside=0.0):
    """Return the point at a share of a segment, so many px in front of it."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    size = np.hypot(dx, dy)
    return start[0] + share * dx + aside * dy / size, start[1] + share * dy - aside * dx / size


def place(block):
    """Return (side, point, points of the segment along which it lies) of a device, by its path. Raises ValueError."""
    *folders, name = block.path.split("/")
    side = folders[0] if folders else ""
    word = name.removesuffix("_imu").removesuffix("_cell")
    if side in POSE:
        points = leg(side)
        places = {
            "hip": (points.hip, (points.hip, points.knee)),
            "abduction": ((HIP[0] - 14.0, HIP[1] - 10.0), (points.hip, points.knee)),
            "knee": (points.knee, (points.hip, points.knee)),
            "ankle": (points.ankle, (points.knee, points.ankle)),
            "thigh": (between(points.hip, points.knee, 0.55, 8.0), (points.hip, points.knee)),
            "shank": (between(points.knee, points.ankle, 0.4, 7.0), (points.knee, points.ankle)),
            "converter": (between(points.knee, points.ankle, 0.72, -7.0), (points.knee, points.ankle)),
            "foot": (between(points.ankle, points.toe, 0.45, 4.0), (points.heel, points.toe)),
            "insole": (points.heel, (points.heel, points.toe)),
            "heel": (between(points.heel, points.toe, 0.08), (points.heel, points.toe)),
            "forefoot": (between(points.heel, points.toe, 0.72), (points.heel, points.toe)),
        }
        places["pylon"] = (between(points.knee, points.ankle, 0.6), (points.knee, points.ankle))
        if name == "ankle_cell":
            places["ankle"] = (between(points.knee, points.ankle, 0.3, 8.0), (points.knee, points.ankle))
    else:
        places = {
            "pelvis": (between(NECK, HIP, 0.87, 12.0), (NECK, HIP)),
            "trunk": (between(NECK, HIP, 0.35, 13.0), (NECK, HIP)),
        }
    if word not in places:
        raise ValueError(f"{block.path}: no place on the body for a device of this name; add it in gallery.place")
    return side, *places[word]


def symbol(block):
    """Return (symbol, name) of a device. Raises ValueError."""
    for kind, entry in SYMBOLS.items():
        if isinstance(block, kind):
            return entry
    raise ValueError(f"{block.path}: no symbol for {type(block).__name__}; add it to SYMBOLS")


def devices(diagram):
    """Return the blocks of a diagram that are worn: those on a bus, and resistors behind a converter."""
    return [block for block in diagram if isinstance(block, (Device, FSR))]


def body(side, residual=False):
    """Return the limbs of a side. residual : whether the leg ends above the knee"""
    points, (colour, width) = leg(side), LIMBS[side]
    limb = line(points.hip, points.knee, points.ankle) + line(points.ankle, points.heel, points.toe, width=8)
    if residual:
        limb = line(points.hip, between(points.hip, points.knee, 0.7))
    return (
        f'<g fill="none" stroke="{colour}" stroke-width="{width:g}" stroke-linecap="round" stroke-linejoin="round">'
        f"{limb}</g>"
    )


def prosthetic(worn):
    """Return the sides on which shank and foot are those of the robot: their shank has a load cell. worn : blocks"""
    return {place(block)[0] for block in worn if block.path.endswith("/pylon_cell")}


def line(*points, width=None, colour=""):
    """Return a path through points."""
    more = f' stroke-width="{width:g}"' if width else ""
    more += f' stroke="{colour}"' if colour else ""
    return f'<path d="M{" L".join(f"{x:.1f} {y:.1f}" for x, y in points)}"{more}/>'


def trunk():
    """Return the right arm, trunk and head, and the left arm."""
    (near, _), (far, _) = LIMBS.values()
    right, left = ((86, 68), (98, 92), (115, 106)), ((83, 70), (71, 95), (83, 117))
    return (
        '<g fill="none" stroke-linecap="round" stroke-linejoin="round">'
        f"{line(*right, width=8, colour=far)}{line((84, 68), (80.5, 116), width=24, colour=near)}"
        f"{line(NECK, HEAD, width=9, colour=near)}{line(*left, width=8, colour=ARM)}</g>"
        f'<circle cx="{HEAD[0]}" cy="{HEAD[1]}" r="13" fill="{near}"/>'
    )


def drawn(block, replaced=()):
    """Return the symbol of a device at its place. A drive has bars along the segments that it moves, with cuffs.

    replaced : sides with a prosthesis
    """
    side, (x, y), (start, end) = place(block)
    kind, _ = symbol(block)
    angle = np.degrees(np.arctan2(end[1] - start[1], end[0] - start[0])) - 90.0
    if kind == "drive":
        return (limb(block, side) if side in replaced else bars(block, side)) + disc(x, y)
    if kind == "insole":
        return (
            f'<g fill="none" stroke-linecap="round">{line(shifted(start), shifted(end), width=3.6, colour=FORCE)}</g>'
        )
    if kind == "force":
        x, y = shifted((x, y))
        return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3.2" fill="{FORCE}"/>'
    return small(kind, x, y, angle)


def small(kind, x, y, angle=0.0):
    """Return the symbol of a sensor or a board."""
    at = f'transform="translate({x:.1f} {y:.1f}) rotate({angle:.0f})"'
    if kind == "cell":
        return f'<path {at} d="M0 -5L5 0L0 5L-5 0Z" fill="{FORCE}" stroke="#fff" stroke-width="1"/>'
    wide, tall, colour = (6.4, 9.6, IMU) if kind == "imu" else (7.5, 11.0, BOARD)
    return (
        f'<rect {at} x="{-wide / 2}" y="{-tall / 2}" width="{wide}" height="{tall}" rx="1.6" fill="{colour}" '
        'stroke="#fff" stroke-width="1"/>'
    )


def shifted(point):
    """Return the point below the sole."""
    return point[0], point[1] + 5.5


def disc(x, y):
    """Return a drive."""
    return (
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="9" fill="{DRIVE}" stroke="#fff" stroke-width="1.2"/>'
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3.2" fill="#fff"/>'
    )


def bars(block, side):
    """Return the frame of a drive: a bar along each segment that it moves, and the cuff at its end."""
    points = leg(side)
    joint = block.path.rpartition("/")[2]
    waist = (HIP[0] - 2.0, HIP[1] - 26.0)
    chains = {
        "hip": (waist, points.hip, between(points.hip, points.knee, 0.62)),
        "abduction": (waist, (HIP[0] - 14.0, HIP[1] - 10.0)),
        "knee": (between(points.hip, points.knee, 0.4), points.knee, between(points.knee, points.ankle, 0.6)),
        "ankle": (between(points.knee, points.ankle, 0.3), points.ankle, between(points.heel, points.toe, 0.5)),
    }
    chain = chains[joint]
    cuffs = [chain[0], chain[2]] if joint == "knee" else [chain[2]] if joint == "hip" else [chain[0]]
    text = line(*chain, width=3.4)
    for cuff in cuffs if joint != "abduction" else []:
        start, end = (points.hip, points.knee) if cuff[1] < points.knee[1] else (points.knee, points.ankle)
        text += line(across(cuff, start, end, -8.0), across(cuff, start, end, 8.0), width=5.0)
    if joint in ("hip", "abduction"):
        text += line((waist[0] - 9.0, waist[1]), (waist[0] + 14.0, waist[1]), width=5.0)
    return f'<g fill="none" stroke="{DRIVE}" stroke-linecap="round" stroke-linejoin="round">{text}</g>'


def limb(block, side):
    """Return the part of a prosthesis that a drive moves: a socket above the knee and the shank, or the foot."""
    points = leg(side)
    if block.path.endswith("/knee"):
        top = between(points.hip, points.knee, 0.45)
        edges = [across(top, points.hip, points.knee, 9.0), points.knee, across(top, points.hip, points.knee, -9.0)]
        parts = line(*edges, width=4.0) + line(points.knee, points.ankle, width=6.0)
    else:
        parts = line(points.ankle, points.heel, points.toe, width=6.0)
    return f'<g fill="none" stroke="{DRIVE}" stroke-linecap="round" stroke-linejoin="round">{parts}</g>'


def across(point, start, end, distance):
    """Return the point beside a segment, at a distance in px."""
    size = np.hypot(end[0] - start[0], end[1] - start[1])
    return point[0] + distance * (end[1] - start[1]) / size, point[1] - distance * (end[0] - start[0]) / size


def sparkline(top, name, unit, curve, toe_off):
    """Return a curve over the gait cycle below its name and largest value.

    top : px
    curve : array (101,)
    toe_off : fraction of the stride, or None
    """
    (left, width), (low, high) = SPARK, (min(0.0, curve.min()), max(0.0, curve.max()))
    places = top + TALL * (high - curve) / (high - low or 1.0)
    zero = top + TALL * high / (high - low or 1.0)
    points = [(left + width * share, y) for share, y in zip(np.linspace(0.0, 1.0, len(curve)), places)]
    lift = line((left + width * toe_off, top), (left + width * toe_off, top + TALL), colour=BOARD) if toe_off else ""
    return (
        f'<text x="{left}" y="{top - 10}">{escape(name)}</text>'
        f'<text x="{left + width}" y="{top - 10}" text-anchor="end">{np.abs(curve).max():.0f} {unit}</text>'
        f'<g fill="none" stroke-linejoin="round">{line((left, zero), (left + width, zero), colour=LIMBS["left"][0])}'
        f'<g stroke-dasharray="1.5 2.5">{lift}</g>{line(*points, width=2, colour=IMU if unit == "°" else DRIVE)}</g>'
    )


def draw(diagram, title, curves):
    """Return the drawing of a robot, an SVG.

    diagram : Diagram
    title : of the robot, for a screen reader
    curves : [(name, unit, array (101,), toe-off as fraction of the stride or None)] of the sparklines
    """
    worn, first = devices(diagram), HEIGHT / 2 - 0.5 * STEP * (len(curves) - 1) - 0.5 * TALL
    far, near = ([block for block in worn if (place(block)[0] == "right") is right] for right in (True, False))
    frames = sorted(near, key=lambda block: symbol(block)[0] != "drive")
    replaced = prosthetic(worn)
    names = ", ".join(sorted({f"{symbol(block)[1].split(',')[0]} {block.path}" for block in worn}))
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" '
            f'height="{HEIGHT}" font-family="system-ui, sans-serif" font-size="12" fill="{BOARD}" role="img" '
            'aria-labelledby="title desc">',
            f'<title id="title">{escape(title)}</title>',
            f'<desc id="desc">A person who walks to the right, with {escape(names)}</desc>',
            f'<path d="M20 {GROUND}H146" stroke="#aab4c0" stroke-width="1.5" stroke-linecap="round"/>',
            body("right", "right" in replaced),
            f'<g opacity="0.5">{"".join(drawn(block, replaced) for block in far)}</g>',
            computer(),
            trunk(),
            body("left", "left" in replaced),
            "".join(drawn(block, replaced) for block in frames),
            *(sparkline(first + STEP * number, *curve) for number, curve in enumerate(curves)),
            "</svg>\n",
        ]
    )


def computer():
    """Return the computer on the back, which every robot has."""
    return f'<rect x="56" y="66" width="15" height="30" rx="3.5" fill="{BOARD}"/>'


def curves_of(columns):
    """Return the curves of the sparklines: torque of each joint, or the angles of a suit.

    columns : as in stride_picture, without
    title for a suit
    """
    curves = []
    for title, panels in columns.items():
        for panel in panels:
            name, unit = panel.label.removesuffix(")").split(" (")
            if unit == ("N·m" if title else "°"):
                first = panel.curves[0]
                joint = title.replace("dorsiflexion", "torque")  # beside the largest value
                curves.append((joint if len(columns) > 1 else name, unit, first.mean, first.toe_off))
    return curves


def key():
    """Return the meaning of the symbols, an SVG."""
    entries = [
        (disc(12, 16), "drive"),
        (small("imu", 12, 16), "inertial sensor"),
        (f'<g fill="none" stroke-linecap="round">{line((3, 16), (21, 16), width=3.6, colour=FORCE)}</g>', "insole"),
        (f'<circle cx="12" cy="16" r="3.2" fill="{FORCE}"/>', "force-sensing resistor"),
        (small("cell", 12, 16), "load cell"),
        (small("board", 12, 16), "computer, microcontroller, converter"),
    ]
    cells, left, top = [], 0, 0
    for mark, text in entries:
        if left + 44 + 6.3 * len(text) > 2 * WIDTH:
            left, top = 0, top + 28
        cells.append(f'<g transform="translate({left} {top})">{mark}<text x="28" y="20.5">{text}</text></g>')
        left += round(44 + 6.3 * len(text))
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {2 * WIDTH} {top + 32}" width="{2 * WIDTH}" '
            f'height="{top + 32}" font-family="system-ui, sans-serif" font-size="12" fill="#5f6b7a">',
            *cells,
            "</svg>\n",
        ]
    )
