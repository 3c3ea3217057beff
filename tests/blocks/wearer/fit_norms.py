"""Fit of the series in blocks/wearer/norms.py to the curves of Bovi et al.

`python -m tests.blocks.wearer.fit_norms` writes it. It needs the shared folder of measured data.
"""

import csv
import textwrap

import numpy as np

from blocks.wearer.body import ANKLE_HEIGHT, BALL, FOOT, FOOT_LENGTH, HEEL, SHANK, SHANK_LENGTH, THIGH, THIGH_LENGTH
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
BODY_HEIGHT = 1.70  # m, mean of the subjects: speed in m/s over speed in body heights per second
GRAVITY = 9.80665
ANKLE_NEUTRAL = np.radians(19.9)  # of that laboratory, from the one of other laboratories
HARMONICS = 12  # of angles and moments
FORCE_SINES = 12
CENTRE_SINES = 6
PELVIS_HARMONICS = (2, 4, 6)  # of the stride: both legs move the pelvis alike
PHASES = np.arange(200) / 200


def fitted():
    """Return {motion: list of dicts of one speed each}."""
    rows = list(csv.DictReader(shared("gait/walk_stairs_norms_adult_bovi2011.csv").open()))
    table = list(csv.DictReader(shared("gait/bovi2011_parameters_adult.csv").open()))
    parameters = {row["condition"]: row for row in table}
    conditions = {condition: [r for r in rows if r["condition"] == condition] for condition in parameters}
    pitch = pelvis_pitch(angles_of(conditions["walk_free"]))
    return {
        motion: [fit(conditions[name], parameters[name], motion == "walk", pitch) for name in names]
        for motion, names in MOTIONS.items()
    }


def fit(rows, parameters, level, pitch):
    """Fit one condition.

    level : whether it is level walking with flat feet. The pitch of the pelvis is then that with which the foot is flat
    in mid-stance, else `pitch`; and the moments are the mean of those measured and those of the series by inverse
    dynamics, since the hip's place differs between laboratories by centimetres.
    """
    stride_time = 120.0 / float(parameters["cadence_steps_min_mean"])
    stride_length = float(parameters["stride_length_m_mean"]) / BODY_HEIGHT
    foot_off = float(parameters["foot_off_pct"]) / 100.0
    angles = angles_of(rows)
    moments = [-series(column(rows, f"{name}_Nm_kg_mean"), HARMONICS) for name in MOMENTS]
    pitch = pelvis_pitch(angles) if level else pitch

    # Forces over stance: the mean vertical force of two legs is one body weight, and the mean forward force zero.
    stance = np.linspace(0.0, 1.0, 201)
    at = [
        np.interp(stance * foot_off * 100.0, np.arange(101), column(rows, f"grf_{name}_bw_mean"))
        for name in ("vertical", "forward")
    ]
    vertical, forward = (sines(stance, values, FORCE_SINES) for values in at)
    area = np.array([2.0 / (np.pi * k) if k % 2 else 0.0 for k in range(1, FORCE_SINES + 1)])
    vertical *= 0.5 / (foot_off * vertical @ area)
    forward -= (forward @ area) / (vertical @ area) * vertical

    # Kinematics of the leg from the hip: position of heel, ball and ankle, in body heights.
    q = [at_phases(each) for each in angles]
    thigh, shank, foot = pitch + q[0], pitch + q[0] - q[1], pitch + q[0] - q[1] + q[2]
    ankle = (
        THIGH_LENGTH * np.sin(thigh) + SHANK_LENGTH * np.sin(shank),
        -THIGH_LENGTH * np.cos(thigh) - SHANK_LENGTH * np.cos(shank),
    )
    points = [
        (
            ankle[0] + d * np.cos(foot) + ANKLE_HEIGHT * np.sin(foot),
            ankle[1] + d * np.sin(foot) - ANKLE_HEIGHT * np.cos(foot),
        )
        for d in (HEEL, BALL)
    ]

    # The lower point of the loaded foot neither slips nor lifts; the share of the load weights the two feet.
    on_heel = points[0][1] < points[1][1]
    rate = len(PHASES) / stride_time
    speeds = [0.5 * rate * (np.roll(x, 1) - np.roll(x, -1)) for x, _ in points]
    load = np.where(PHASES < foot_off, np.maximum(sine_sum(vertical, PHASES / foot_off), 0.0), 0.0)
    share = load / (load + np.roll(load, 100))
    both = lambda x: share * x + np.roll(share * x, 100)  # noqa: E731
    speed = both(np.where(on_heel, *speeds))
    height = both(-np.where(on_heel, points[0][1], points[1][1]))
    wave = np.fft.rfft(speed) / len(PHASES) * (stride_length / stride_time / speed.mean())
    k = np.array(PELVIS_HARMONICS)
    forward_wave = wave[k] / (2j * np.pi * k / stride_time)
    height_wave = np.fft.rfft(height) / len(PHASES)

    # Centre of pressure in the foot's frame, from the ankle's moment and the force. (Foot's own inertia neglected)
    inside = (PHASES > 0.06 * foot_off) & (PHASES < 0.92 * foot_off)
    push = np.where(PHASES < foot_off, sine_sum(forward, PHASES / foot_off), 0.0)
    h = ANKLE_HEIGHT
    lever = -at_phases(moments[2]) / (GRAVITY * BODY_HEIGHT) - h * (load * np.sin(foot) + push * np.cos(foot))
    centre = (lever / np.where(inside, load * np.cos(foot) - push * np.sin(foot), 1.0) - HEEL)[inside]
    s, centre = (PHASES / foot_off)[inside], np.clip(centre / FOOT_LENGTH, 0.02, 0.95)
    s, centre = np.append(s, np.linspace(0.95, 1.0, 5)), np.append(centre, np.full(5, max(centre[-1], 0.8)))
    coefficients = np.linalg.lstsq(centre_basis(s), centre, rcond=None)[0]

    if level:
        path = np.exp(2j * np.pi * np.outer(PHASES, k))
        pelvis = 2.0 * ((path @ forward_wave).real + 1j * (path @ height_wave[k]).real)
        sole = np.clip(centre_basis(PHASES / foot_off) @ coefficients, 0.02, 0.95) * FOOT_LENGTH + HEEL
        force = GRAVITY * (np.where(PHASES < foot_off, push, 0.0) + 1j * load)
        dynamic = inverse_dynamics(pelvis, (thigh, shank, foot), sole, force, stride_time)
        waves = [np.fft.rfft(each)[: HARMONICS + 1] / len(PHASES) for each in dynamic]
        moments = [0.5 * (measured + wave) for measured, wave in zip(moments, waves)]
    return {
        "speed": stride_length * BODY_HEIGHT / stride_time,
        "stride_time": stride_time,
        "foot_off": foot_off,
        "pelvis_pitch": pitch,
        "angles": [packed(c) for c in angles],
        "moments": [packed(c) for c in moments],
        "vertical": list(vertical),
        "forward": list(forward),
        "centre": list(coefficients),
        "pelvis_height": [height_wave[0].real, *(2.0 * height_wave[k].real), *(-2.0 * height_wave[k].imag)],
        "pelvis_forward": [*(2.0 * forward_wave.real), *(-2.0 * forward_wave.imag)],
    }


def inverse_dynamics(pelvis, pitches, sole, force, stride_time):
    """Return the torques of hip, knee and ankle in N·m/kg, flexion positive, that move the leg as the series do.

    pelvis : its oscillation, x + i z in body heights; sole : point of the force from the ankle in body heights; force :
    of the ground in N/kg
    """
    k = np.fft.fftfreq(len(PHASES), 1.0 / len(PHASES))
    k[np.abs(k) > 2 * HARMONICS] = 0.0

    def second(curve):
        return np.fft.ifft(np.fft.fft(curve) * (2j * np.pi * k / stride_time) ** 2)

    down = [-1j * np.exp(1j * pitch) for pitch in pitches]  # direction of each segment, the foot's from ankle to sole
    joints = [pelvis, pelvis + THIGH_LENGTH * down[0], pelvis + THIGH_LENGTH * down[0] + SHANK_LENGTH * down[1]]
    lengths = THIGH_LENGTH, SHANK_LENGTH, FOOT_LENGTH
    places = [THIGH[1] * lengths[0], SHANK[1] * lengths[1], 1j * (FOOT[1] * FOOT_LENGTH + HEEL) + 0.5 * ANKLE_HEIGHT]
    pressed = joints[2] + down[2] * (1j * sole + ANKLE_HEIGHT)
    torques, demands = [], []
    for n in (2, 1, 0):
        share, _, gyration = (THIGH, SHANK, FOOT)[n]
        centre = joints[n] + places[n] * down[n]
        inertia = share * (gyration * lengths[n] * BODY_HEIGHT) ** 2
        demands.append(
            (centre, share * (BODY_HEIGHT * second(centre) + 1j * GRAVITY), inertia * second(pitches[n]).real)
        )
        torque = sum(BODY_HEIGHT * ((place - joints[n]).conj() * f).imag + own for place, f, own in demands)
        torques.append(torque - BODY_HEIGHT * ((pressed - joints[n]).conj() * force).imag)
    ankle, knee, hip = torques
    return hip, -knee, ankle


def centre_basis(stance):
    """Return the functions of the centre of pressure: 1, s, sin(k π s)."""
    waves = [np.sin(np.pi * k * stance) for k in range(1, CENTRE_SINES + 1)]
    return np.column_stack([np.ones_like(stance), stance, *waves])


def angles_of(rows):
    """Return the complex series of hip, knee and ankle in rad, the ankle from the neutral of other laboratories."""
    found = [np.pi / 180.0 * series(column(rows, f"{name}_deg_mean"), HARMONICS) for name in JOINTS]
    found[2][0] += ANKLE_NEUTRAL
    return found


def pelvis_pitch(angles):
    """Return the pitch of the pelvis in rad with which the foot is flat from 20 to 35 % of the stride."""
    hip, knee, ankle = (at_phases(each) for each in angles)
    return -float((hip - knee + ankle)[40:70].mean())


def column(rows, name):
    return np.array([float(row[name]) for row in rows])


def series(curve, harmonics):
    """Return the complex series of a curve of 101 points, the step at its seam spread over the stride."""
    closed = curve - (curve[-1] - curve[0]) * (np.arange(101) / 100.0 - 0.5)
    return (np.fft.rfft(closed[:100]) / 100.0)[: harmonics + 1]


def at_phases(coefficients):
    k = np.arange(len(coefficients))
    weights = np.where(k == 0, 1.0, 2.0)
    return ((coefficients * weights) * np.exp(2j * np.pi * np.outer(PHASES, k))).sum(axis=1).real


def sines(stance, values, count):
    """Fit sin(k π s) to a curve over stance."""
    basis = np.column_stack([np.sin(np.pi * k * stance) for k in range(1, count + 1)])
    return np.linalg.lstsq(basis, values, rcond=None)[0]


def sine_sum(coefficients, stance):
    return sum(c * np.sin(np.pi * k * stance) for k, c in enumerate(coefficients, 1))


def packed(coefficients):
    """Return mean, cosine and sine coefficients of a complex series."""
    return [coefficients[0].real, *(2.0 * coefficients[1:].real), *(-2.0 * coefficients[1:].imag)]


HEADER = '''"""Series of the average adult's gait. Made by tests/blocks/wearer/fit_norms.py; do not edit.

20 adults, 22 to 72 years. Bovi G, Rabuffetti M, Mazzoleni P, Ferrarin M (2011) A multiple-task gait analysis approach:
kinematic, kinetic and EMG reference data for healthy young and adult subjects. Gait & Posture 33:6-13, electronic
addendum. The ankle's zero is shifted by 19.9° to that of other laboratories.

Of each motion one entry per speed, ascending: speed in m/s of an adult of BODY_HEIGHT; stride_time in s; foot_off as a
share of the stride; pelvis_pitch in rad; angles of hip, knee and ankle in rad and moments in N·m/kg (of the walk the
mean of the measured ones and those of the series by inverse dynamics), flexion positive, each as mean, cosines and
sines of the harmonics of the stride; vertical and forward force of a foot in body weights as sines of k π s over its
stance s; centre of pressure from the heel in foot lengths as 1, s and sines of k π s; height of the hips and their
progress ahead of the mean speed in body heights, with the harmonics PELVIS_HARMONICS.
"""
'''


def text(values, indent):
    """Return the lines of a tuple."""
    numbers = ", ".join(f"{value:.6g}" for value in values)
    return textwrap.indent("\n".join(textwrap.wrap(f"({numbers}),", 119 - indent)), " " * indent)


def module():
    """Return the source of blocks/wearer/norms.py."""
    lines = [
        HEADER,
        f"BODY_HEIGHT = {BODY_HEIGHT}  # m",
        f"HARMONICS = {HARMONICS}",
        f"PELVIS_HARMONICS = {PELVIS_HARMONICS}",
        "",
        "# fmt: off",
        "MOTIONS = {",
    ]
    for motion, speeds in fitted().items():
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
    return "\n".join([*lines, "}"]) + "\n"


if __name__ == "__main__":
    NORMS.write_text(module(), encoding="utf-8")
