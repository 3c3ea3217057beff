"""Recording of a wearer who walks forward and then does other things, and what a robot does in each of them.

An adult walks at 1.2 m/s, and the robot learns the gait; then one leg is held for 0.3 s in two swings. Stands separate
the motions that follow: the walk of the same adult, forward and backward, and motions that are made here.
"""

import numpy as np

import runtime
from blocks.wearer import Walker
from graph import Diagram
from runtime.session.simulate import simulate
from tests.diagrams.robots import path

RATE = 100.0  # Hz
LEARNED, STUMBLES, STAND, LENGTH, BLEND = 9.0, 5.0, 1.5, 6.0, 0.4  # s
WORKING = 0.25  # N·m, from which a torque acts
SIDES = ("lt", "rt")
JOINTS = ("hip_flexion_{}_deg", "knee_flexion_{}_deg", "ankle_dorsiflexion_{}_deg")
TIME = np.arange(0.0, LENGTH, 1.0 / RATE)


def walked(speed, duration):
    """Return {column: values} of the average adult. speed : schedule in m/s; duration : s"""
    with Diagram("walk", RATE) as diagram:
        Walker(speed, name="adult")()
    trial = simulate(diagram, duration)
    columns = {"pelvis_tilt_deg": np.degrees(trial["adult.pelvis_motion[6]"])}
    for side, suffix in zip(("left", "right"), SIDES):
        for joint, name in zip(("hip", "knee", "ankle"), JOINTS):
            columns[name.format(suffix)] = np.degrees(trial[f"adult.{side}_{joint}_angle"])
        columns[f"grf_vertical_{suffix}_bw"] = trial[f"adult.{side}_ground_force[1]"] / (70.0 * 9.80665)
    return columns


def made(hips, knees, loads):
    """Return {column: values} from degrees and body weights of the left, then the right leg; the feet stay flat."""
    columns = {"pelvis_tilt_deg": np.zeros_like(TIME)}
    for suffix, hip, knee, load in zip(SIDES, hips, knees, loads):
        columns |= {name.format(suffix): angle for name, angle in zip(JOINTS, (hip, knee, knee - hip))}
        columns[f"grf_vertical_{suffix}_bw"] = load
    return columns


def steps(cadence, hip, knee):
    """Return steps in place: a foot is lifted for 0.45 of a stride. cadence : strides per s; hip, knee : degrees"""
    phases = (TIME * cadence % 1.0, (TIME * cadence + 0.5) % 1.0)
    lifts = [np.where(phase < 0.45, np.sin(np.pi * phase / 0.45) ** 2, 0.0) for phase in phases]
    loads = [np.where(other > 0.02, 1.0, np.where(own > 0.02, 0.0, 0.5)) for own, other in zip(lifts, lifts[::-1])]
    return made([hip * each for each in lifts], [knee * each for each in lifts], loads)


def held(columns, begin):
    """Return a walk in which the left leg stays for 0.3 s where it is, and catches up in as much. begin : s"""
    ticks = np.arange(len(columns["pelvis_tilt_deg"]))
    own = ticks + RATE * np.interp(ticks / RATE - begin, (0.0, 0.3, 0.6), (0.0, -0.3, 0.0))
    names = [name.format("lt") for name in JOINTS]
    return columns | {name: np.interp(own, ticks, columns[name]) for name in names}


def recording():
    """Return ({column: values}, {motion: (begin, end) in s})."""
    learned = LEARNED + STUMBLES
    first = walked(f"0:0 0.5:0 2:1.2 {learned}:1.2 {learned + 0.8}:0", learned + STAND)
    slow = walked(f"0:0 0.5:0 2:0.8 {LENGTH}:0.8", LENGTH)
    bend = 0.5 - 0.5 * np.cos(3.2 * np.pi * TIME)
    down = 0.5 - 0.5 * np.cos(np.pi * np.interp(TIME, (0.0, 1.5, LENGTH - 1.5, LENGTH), (0.0, 1.0, 1.0, 2.0)))
    motions = {
        "walking forward, 0.8 m/s": slow,
        "walking backward, 0.8 m/s": {name: values[::-1] for name, values in slow.items()},
        "stepping in place": steps(0.85, 40.0, 65.0),
        "turning on the spot": steps(0.7, 18.0, 35.0),
        "hopping": made([10.0 + 15.0 * bend] * 2, [15.0 + 35.0 * bend] * 2, [np.where(bend < 0.3, 0.0, 0.75)] * 2),
        "sitting down, standing up": made([85.0 * down] * 2, [90.0 * down] * 2, [0.5 - 0.3 * down] * 2),
    }
    whole = held(held(first, LEARNED + 0.2), LEARNED + 2.7)
    stand = {name: values[-1] for name, values in whole.items()}
    fade = np.clip(TIME / BLEND, 0.0, 1.0)
    fade = np.minimum(fade, fade[::-1])
    spans = {"stumbling": (LEARNED, learned)}
    for motion, columns in motions.items():
        begin = len(whole["pelvis_tilt_deg"]) / RATE
        spans[motion] = begin, begin + LENGTH
        for name, values in columns.items():
            still = np.full(round(STAND * RATE), stand[name])
            whole[name] = np.concatenate((whole[name], stand[name] + fade * (values - stand[name]), still))
    return whole, spans


def write(folder):
    """Write the recording to a folder. Return (path, {motion: (begin, end) in s})."""
    columns, spans = recording()
    file = folder / "motions.csv"
    time = np.arange(len(columns["pelvis_tilt_deg"])) / RATE
    header = ",".join(("time", *columns))
    np.savetxt(file, np.column_stack([time, *columns.values()]), "%.5f", delimiter=",", header=header, comments="")
    return file, spans


def measure(robot, file, spans, settings=()):
    """Return {motion: (s with torque, s from its begin to the last, J given to the wearer, J taken)} of a robot."""
    end = max(end for _, end in spans.values())
    trial = runtime.run(
        path(robot), end, settings={"gait" if robot == "knee_exo" else "recording": str(file), **dict(settings)}
    )
    assert trial.fault is None, (robot, trial.fault)
    drives = [name.removesuffix(".torque_sent") for name in trial.signals if name.endswith(".torque_sent")]
    dt = trial.time[1] - trial.time[0]
    acts = np.any([np.abs(trial[f"{drive}.torque_sent"]) > WORKING for drive in drives], axis=0)
    power = [trial[f"{drive}.torque"] * trial[f"{drive}.velocity"] for drive in drives]
    rows = {}
    for motion, (begin, end) in spans.items():
        inside = (trial.time >= begin) & (trial.time < end)
        last = max(trial.time[inside & acts], default=begin) - begin
        given, taken = (dt * sum((sign * each[inside]).clip(min=0.0).sum() for each in power) for sign in (1.0, -1.0))
        rows[motion] = dt * acts[inside].sum(), last, given, taken
    return rows


def bearing(robot, file, spans, settings=()):
    """Return {motion: (knee flexion under 0.4 body weights, at most, in °, lowest hips in mm)} of a prosthesis."""
    end = max(end for _, end in spans.values())
    chosen = {"recording": str(file), **dict(settings)}
    trial = runtime.run(path(robot), end, settings=chosen, plant_signals="*/lower_leg.drop")
    assert trial.fault is None, (robot, trial.fault)
    rows = {}
    for motion, (begin, end) in spans.items():
        inside = (trial.time >= begin) & (trial.time < end)
        loaded = inside & (trial["left/load.y"] > 0.4)
        knee = np.degrees(trial["left/knee.position"][loaded].max(initial=0.0))
        rows[motion] = knee, 1e3 * trial["plant/left/lower_leg.drop"][inside].min()
    return rows


def table(rows):
    """Return the rows of `measure` as a table."""
    lines = ["| motion | s | torque acts, s | work on the wearer, J |", "|---|--:|--:|--:|"]
    for motion, (time, _, given, taken) in rows.items():
        length = STUMBLES if motion == "stumbling" else LENGTH
        lines.append(f"| {motion} | {length:.0f} | {time:.1f} | {given:.1f}, −{taken:.1f} |".replace("−0.0", "0.0"))
    return "\n".join(lines) + "\n"
