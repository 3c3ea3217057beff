"""Fit of the series in blocks/wearer/norms.py to the curves of Bovi et al.

`python -m tests.blocks.wearer.fit_norms` writes it. It needs the shared folder of measured data.
"""

import csv
import textwrap

import numpy as np
from scipy.interpolate import CubicSpline

from blocks.wearer.body import ANKLE_HEIGHT, FOOT_LENGTH, GRAVITY, HEEL
from blocks.wearer.mechanics import pitches_of
from blocks.wearer.stride import (
    FORCE_SINES,
    HARMONICS,
    PHASES,
    balanced,
    centre_basis,
    flat_foot_pitch,
    moments,
    pelvis,
    series,
    sines,
    values,
)
from tests.blocks.wearer.fit_adults import components
from tests.checkout import ROOT
from tests.shared import shared

NORMS = ROOT / "blocks/wearer/norms.py"

MOTIONS = {
    "walk": ("walk_very_slow", "walk_free", "walk_medium", "walk_fast"),
    "on_toes": ("walk_on_toes",),
    "on_heels": ("walk_on_heels",),
    "stairs_up": ("stairs_up",),
    "stairs_down": ("stairs_down",),
}
JOINTS = ("hip_flexion", "knee_flexion", "ankle_dorsiflexion")
MOMENTS = ("hip_extensor_moment", "knee_extensor_moment", "ankle_plantarflexor_moment")
DEVIATION_HARMONICS = 6
DECONVOLUTION_STEPS = 2  # from there on the forces of people who were not used come no closer
BODY_HEIGHT = 1.70  # m, mean of the subjects: speed in m/s over speed in body heights per second
ANKLE_NEUTRAL = np.radians(19.9)  # of that laboratory, from the one of other laboratories


def fitted():
    """Return {motion: list of dicts of one speed each}."""
    rows = list(csv.DictReader(shared("gait/walk_stairs_norms_adult_bovi2011.csv").open()))
    table = list(csv.DictReader(shared("gait/bovi2011_parameters_adult.csv").open()))
    parameters = {row["condition"]: row for row in table}
    conditions = {condition: [r for r in rows if r["condition"] == condition] for condition in parameters}
    pitch = flat_foot_pitch([values(each) for each in angles_of(conditions["walk_free"])])
    for name in MOTIONS["walk"]:
        conditions[name] = registered(conditions[name], parameters[name])
    return {
        motion: [
            fit(conditions[name], parameters[name], motion == "walk", pitch, motion.startswith("stairs"))
            for name in names
        ]
        for motion, names in MOTIONS.items()
    }


def registered(rows, parameters):
    """Return rows with the means of curves that are aligned at foot-off, instead of the means of curves that are not.

    The strides of the table are aligned at heel strike only. Their foot-off has a standard deviation of 2 % of the
    stride, so the mean over all of them is smoother at push-off than the curve of an adult. Phases are assumed to be
    shifted in proportion to `share`. Each step adds the difference of the measured mean from the mean of the shifted
    estimate. (registration by landmarks: Kneip and Gasser 1992; of gait: Sadeghi et al. 2000, Gait & Posture
    12:257-264; deconvolution: van Cittert 1931)
    """
    foot_off, deviation = (float(parameters[name]) / 100.0 for name in ("foot_off_pct", "foot_off_sd"))
    phases = np.arange(101) / 100.0
    way = np.where(phases < foot_off, phases / foot_off, (1.0 - phases) / (1.0 - foot_off))
    share = way**2 * (3.0 - 2.0 * way)
    nodes, weights = np.polynomial.hermite_e.hermegauss(5)
    shifted = phases - deviation * np.outer(nodes, share)

    def sharpened(curve):
        estimate = curve
        for _ in range(DECONVOLUTION_STEPS):
            estimate = estimate + curve - weights @ CubicSpline(phases, estimate)(shifted) / weights.sum()
        return estimate

    means = {name: sharpened(column(rows, name)) for name in rows[0] if name.endswith("_mean") and rows[0][name]}
    return [row | {name: curve[i] for name, curve in means.items()} for i, row in enumerate(rows)]


def torque_deviations():
    """Yield the standard deviations at PHASES of the torques of each speed of the walk in N·m/kg.

    Each is at least 30 % of its mean.
    """
    rows = list(csv.DictReader(shared("gait/walk_stairs_norms_adult_bovi2011.csv").open()))
    for condition in MOTIONS["walk"]:
        own = [row for row in rows if row["condition"] == condition]
        curves = [np.interp(100.0 * PHASES, np.arange(101), column(own, f"{name}_Nm_kg_sd")) for name in MOMENTS]
        yield [np.maximum(curve, 0.3 * curve.mean()) for curve in curves]


def fit(rows, parameters, level, pitch, stairs):
    """Fit one condition.

    level : whether it is level walking with flat feet. The pitch of the pelvis is then that with which the foot is flat
    in mid-stance, else `pitch`; and the moments are the mean of those measured and those of the series by inverse
    dynamics, since the hip's place differs between laboratories by centimetres.
    """
    stride_time = 120.0 / float(parameters["cadence_steps_min_mean"])
    stride_length = float(parameters["stride_length_m_mean"]) / BODY_HEIGHT
    foot_off = float(parameters["foot_off_pct"]) / 100.0
    angles = angles_of(rows)
    curves = [values(each) for each in angles]
    measured = [-closed_series(column(rows, f"{name}_Nm_kg_mean")) for name in MOMENTS]
    pitch = flat_foot_pitch(curves) if level else pitch

    # Forces over stance: the mean vertical force of two legs is one body weight, and the mean forward force zero.
    stance = np.linspace(0.0, 1.0, 201)
    vertical, forward, *deviations = (
        np.linalg.lstsq(
            sines(stance, FORCE_SINES),
            np.interp(stance * foot_off * 100.0, np.arange(101), column(rows, f"grf_{name}")),
            rcond=None,
        )[0]
        for name in ("vertical_bw_mean", "forward_bw_mean", "vertical_bw_sd", "forward_bw_sd")
    )
    vertical, forward = balanced(vertical, forward, foot_off)

    # Centre of pressure in the foot's frame, from the ankle's measured moment and the force.
    waves = sines(PHASES / foot_off, FORCE_SINES)
    force = waves @ forward + 1j * np.maximum(waves @ vertical, 0.0)
    inside = (PHASES > 0.06 * foot_off) & (PHASES < 0.92 * foot_off)
    foot = pitches_of(pitch, curves)[2]
    centre = pressure_centre(*(each[inside] for each in (values(measured[2]), force, foot)), BODY_HEIGHT)
    centre, s = np.clip(centre, 0.02, 0.95), (PHASES / foot_off)[inside]
    s, centre = np.append(s, np.linspace(0.95, 1.0, 5)), np.append(centre, np.full(5, max(centre[-1], 0.8)))
    height, ahead, rise = pelvis(curves, pitch, force.imag, stride_time, stride_length, stairs)
    entry = {
        "speed": stride_length * BODY_HEIGHT / stride_time,
        "stride_time": stride_time,
        "foot_off": foot_off,
        "slope": rise / stride_length,
        "pelvis_pitch": pitch,
        "angles": angles,
        "moments": measured,
        "vertical": vertical,
        "forward": forward,
        "centre": np.linalg.lstsq(centre_basis(s), centre, rcond=None)[0],
        "pelvis_height": height,
        "pelvis_forward": ahead,
    }
    if level:
        spreads = (closed_series(np.radians(column(rows, f"{name}_deg_sd")), DEVIATION_HARMONICS) for name in JOINTS)
        entry |= {"angle_deviations": list(spreads)} | dict(
            zip(("vertical_deviation", "forward_deviation"), deviations)
        )
        entry["moments"] = [0.5 * sum(each) for each in zip(measured, moments(entry, BODY_HEIGHT))]
    return entry


def pressure_centre(ankle, force, foot, height):
    """Return the centre of pressure from the heel in foot lengths. The inertia of the foot is neglected.

    ankle : torque in N·m/kg, dorsiflexion positive; force : of the ground in body weights; foot : its pitch; height :
    of the body, m
    """
    in_foot = force * np.exp(-1j * foot)
    return ((-ankle / (GRAVITY * height) - ANKLE_HEIGHT * in_foot.real) / in_foot.imag - HEEL) / FOOT_LENGTH


def angles_of(rows):
    """Return the series of hip, knee and ankle in rad, the ankle from the neutral of other laboratories."""
    angles = [np.pi / 180.0 * closed_series(column(rows, f"{name}_deg_mean")) for name in JOINTS]
    angles[2][0] += ANKLE_NEUTRAL
    return angles


def column(rows, name):
    return np.array([float(row[name]) for row in rows])


def closed_series(curve, harmonics=HARMONICS):
    """Return the series of a curve of 101 points, the step at its seam spread over the stride."""
    return series((curve - (curve[-1] - curve[0]) * (np.arange(101) / 100.0 - 0.5))[:100], harmonics)


HEADER = '''"""Series of the average adult's gait. Made by tests/blocks/wearer/fit_norms.py; do not edit.

20 adults, 22 to 72 years. Bovi G, Rabuffetti M, Mazzoleni P, Ferrarin M (2011) A multiple-task gait analysis approach:
kinematic, kinetic and EMG reference data for healthy young and adult subjects. Gait & Posture 33:6-13, electronic
addendum. The ankle's zero is shifted by 19.9° to that of other laboratories, and the means of the walk are those of
curves that are aligned at foot-off.

Of each motion one entry per speed, ascending: speed in m/s of an adult of BODY_HEIGHT; stride_time in s; foot_off as a
share of the stride; slope of the way, up over forward; pelvis_pitch in rad; angles of hip, knee and ankle in rad and
moments in N·m/kg (of the walk the mean of the measured ones and those of the series by inverse dynamics), flexion
positive, each as mean, cosines and sines of the harmonics of the stride; vertical and forward force of a foot in body
weights as sines of k π s over its stance s; centre of pressure from the heel in foot lengths as 1, s and sines of
k π s; height of the hips and their progress ahead of the mean speed in body heights (stride.py has the harmonics). Of
the walk also standard deviations between adults, of the angles over the stride and of the forces over the stance.
COMPONENTS has what deviates together, the largest first, as weights of adults.py per standard deviation.
"""
'''


def text(values, indent, form=".6g"):
    """Return the lines of a tuple."""
    numbers = ", ".join(f"{value:{form}}" for value in values)
    return textwrap.indent("\n".join(textwrap.wrap(f"({numbers}),", 119 - indent)), " " * indent)


def module():
    """Return the source of blocks/wearer/norms.py."""
    lines = [HEADER, "from typing import Any", "", f"BODY_HEIGHT = {BODY_HEIGHT}  # m", "", "# fmt: off"]
    lines.append("MOTIONS: dict[str, tuple[dict[str, Any], ...]] = {")
    motions = fitted()
    for motion, speeds in motions.items():
        lines.append(f'    "{motion}": (')
        for entry in speeds:
            lines.append("        {")
            for name, value in entry.items():
                if not np.ndim(value):
                    lines.append(f'            "{name}": {value:.6g},')
                    continue
                tuples = [text(v, 16) for v in value] if np.ndim(value) == 2 else None
                lines.append(f'            "{name}": (' if tuples else f'            "{name}":')
                lines += [*tuples, "            ),"] if tuples else [text(value, 16)]
            lines.append("        },")
        lines.append("    ),")
    lines += ["}", "COMPONENTS = ("]
    for row in components(motions["walk"], torque_deviations()):
        lines += text(row, 4, ".3f").splitlines()
    return "\n".join([*lines, ")"]) + "\n"


if __name__ == "__main__":
    NORMS.write_text(module(), encoding="utf-8")
