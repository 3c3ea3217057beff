"""Tables of docs/explanation/wearer.md: the average walking adult.

`python -m tests.blocks.wearer.measure` prints them. It needs the shared folder of measured data.
"""

import time
from typing import Any

import numpy as np

from blocks.mathematics import Gain
from blocks.wearer import Walker
from blocks.wearer.body import ANKLE_HEIGHT, BALL, HEEL
from blocks.wearer.norms import MOTIONS
from blocks.wearer.stride import FORCE_SINES, sines
from cext.memory.shared_state import SharedState
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Diagram, compile
from tests.blocks.running import run
from tests.shared import shared

JOINTS = {"hip": "hip_flexion", "knee": "knee_flexion", "ankle": "ankle_dorsiflexion"}
MOMENTS = {"hip": "hip_extensor", "knee": "knee_extensor", "ankle": "ankle_plantarflexor"}
WEIGHT = 9.80665  # N per kg
PERCENT = np.arange(100)


def walk(speed, seconds=5.0, rate=500, **parameters):
    """Return the outputs of a walker by name, without variation."""
    with Diagram("walk", rate=rate) as diagram:
        Walker(speed, name="w", variability=0.0, **parameters)()
    recording = run(diagram, round(seconds * rate))
    return {"time": recording.time} | {path[2:]: values for path, values in recording.signals.items()}


def stride(trace, values):
    """Return a signal of the left leg at every percent of a stride."""
    strikes = np.flatnonzero(np.diff(trace["left_phase"]) < -0.5) + 1
    inside = slice(strikes[1] - 1, strikes[2] + 2)
    phase = np.unwrap(2.0 * np.pi * trace["left_phase"][inside]) / (2.0 * np.pi)
    return np.interp(PERCENT / 100.0, phase - np.round(phase[1]), values[inside])


def measures(angle, stride_time, cutoff=np.inf):
    """Return range in degrees, peak velocity and peak acceleration of a stride, from 12 harmonics.

    cutoff : Hz, -3 dB of a second-order low-pass in both directions
    """
    closed = angle - (angle[-1] - angle[0]) * np.linspace(-0.5, 0.5, len(angle))
    wave = np.fft.rfft(closed[:-1])[:13] / (len(angle) - 1)
    k, phases = np.arange(13), np.arange(400) / 400
    wave /= 1.0 + (np.sqrt(2.0) - 1.0) * (k / stride_time / cutoff) ** 4
    turns = np.exp(2j * np.pi * np.outer(phases, k)) * np.where(k, 2.0, 1.0)
    curves = [(turns @ (wave * (2j * np.pi * k / stride_time) ** order)).real for order in range(3)]
    return np.degrees(np.ptp(curves[0])), np.abs(curves[1]).max(), np.abs(curves[2]).max()


def rows(name):
    return np.genfromtxt(shared(f"gait/{name}.csv"), delimiter=",", names=True, dtype=None, encoding="utf-8")


def of_walker(speed):
    """Yield range in degrees, peak velocity and peak acceleration of each joint."""
    trace = walk(speed, 3.0)
    late = trace["time"] > 1.0
    for joint in JOINTS:
        angle, *rates = (trace[f"left_{joint}_{name}"][late] for name in ("angle", "velocity", "acceleration"))
        yield np.degrees(np.ptp(angle)), *(np.abs(rate).max() for rate in rates)


def motion_table():
    print("| | hip: range ° | rad/s | rad/s² | knee: ° | rad/s | rad/s² | ankle: ° | rad/s | rad/s² |")
    print("|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|")
    for speed in (0.85, 1.05, 1.21, 1.5, 1.96):
        cells = [
            f"{angle:.0f} | {velocity:.1f} | {acceleration:.0f}" for angle, velocity, acceleration in of_walker(speed)
        ]
        print(f"| `Walker(speed={speed})` |", " | ".join(cells), "|")


def distances(trace, mean, deviation):
    """Return mean distance over mean deviation, and the share of the curve within one deviation."""
    return f"{np.abs(trace - mean).mean() / deviation.mean():.2f} ({np.mean(np.abs(trace - mean) < deviation):.0%})"


def curve_table():
    norms, adult, stances = (
        rows(name)
        for name in (
            "walk_norms_pinzone2014_centre1",
            "walk_subject_falisse2019",
            "stance_grf_cop_treadmill_fukuchi2018_WBDS04",
        )
    )
    trace = walk(1.2)
    print("| | distance from Pinzone 2014 | from the adult of Falisse 2019 |")
    print("|---|--:|--:|")

    def line(name, values, column):
        at = np.interp(norms["gait_cycle_percent"], np.append(PERCENT, 100), np.append(values, values[0]))
        spread = norms[f"{column}_sd"]
        other = np.interp(norms["gait_cycle_percent"], adult["gait_cycle_percent"], adult[f"{column}_mean"])
        print(f"| {name} | {distances(at, norms[f'{column}_mean'], spread)} | {distances(at, other, spread)} |")

    for joint, column in JOINTS.items():
        line(f"{joint} angle", np.degrees(stride(trace, trace[f"left_{joint}_angle"])), f"{column}_deg")
    for joint, column in MOMENTS.items():
        line(f"{joint} moment per kg", -stride(trace, trace[f"left_{joint}_torque"]) / 70.0, f"{column}_moment_Nm_kg")
    print()
    print(
        "| RMS difference from the man of Fukuchi 2018"
        + "".join(f" | {v} m/s | SD of adults | SD of his stances" for v in ("1.30", "1.69"))
        + " |"
    )
    print("|---|--:|--:|--:|--:|--:|--:|")
    cells: dict[str, list[str]] = {"vertical force": [], "forward force": [], "centre of pressure": []}
    for speed in (1.30, 1.69):
        man = stances[np.isclose(stances["speed_m_s"], speed)]
        inside = (man["stance_percent"] >= 5) & (man["stance_percent"] <= 95)
        trace = walk(speed, height=1.84, mass=61.05)
        loaded = np.flatnonzero(trace["left_ground_force[1]"] > 0.05 * 61.05 * WEIGHT)
        first = np.flatnonzero(np.diff(loaded) > 10) + 1
        stance = loaded[first[0] : first[1]]
        at = np.interp(man["stance_percent"], np.linspace(0.0, 100.0, len(stance)), np.arange(len(stance)))
        for name, path, column, scale in (
            ("vertical force", "left_ground_force[1]", "grf_vertical_bw", 61.05 * WEIGHT),
            ("forward force", "left_ground_force[0]", "grf_forward_bw", 61.05 * WEIGHT),
            ("centre of pressure", "left_centre_of_pressure", "cop_from_midstance_m", 1.0),
        ):
            values = np.interp(at, np.arange(len(stance)), trace[path][stance]) / scale
            if column.startswith("cop"):
                values -= values[50]
            text = np.sqrt(np.mean((values - man[f"{column}_mean"])[inside] ** 2))
            spread = np.sqrt(np.mean(man[f"{column}_sd"][inside] ** 2))
            cells[name].append(f"{text:.3f} | {between(name, speed)} | {spread:.3f}")
    for name, values in cells.items():
        print(f"| {name} |", " | ".join(values), "|")


def between(name, speed):
    """Return the root mean square of the standard deviation between adults over the stance, in body weights."""
    key = {"vertical force": "vertical_deviation", "forward force": "forward_deviation"}.get(name)
    if key is None:
        return ""
    entries = MOTIONS["walk"]
    curves = [sines(np.linspace(0.05, 0.95, 50), FORCE_SINES) @ entry[key] for entry in entries]
    sizes = [np.sqrt(np.mean(curve**2)) for curve in curves]
    return f"{np.interp(speed, [entry['speed'] for entry in entries], sizes):.3f}"


def slip_table():
    print("| m/s | slip of the heel, mm | slip of the ball, mm | vertical motion of the pelvis, mm |")
    print("|--:|--:|--:|--:|")
    for speed in (0.3, 0.85, 1.21, 1.5, 1.96):
        trace = walk(speed, 8.0)
        strikes = np.flatnonzero(np.diff(trace["left_phase"]) < -0.5)
        cells = []
        for along, begin, end in ((HEEL, 0.03, 0.30), (BALL, 0.15, 0.50)):
            pitch, d, h = trace["left_foot_pitch"], along * 1.7, ANKLE_HEIGHT * 1.7
            x = (trace["left_foot_motion[0]"] + d * np.cos(pitch) + h * np.sin(pitch))[strikes[0] + 1 : strikes[1]]
            phase = trace["left_phase"][strikes[0] + 1 : strikes[1]]
            cells.append(1e3 * np.ptp(x[(phase > begin) & (phase < end)]))
        height = 1e3 * np.ptp(trace["pelvis_motion[1]"])
        print(f"| {speed} | {cells[0]:.0f} | {cells[1]:.0f} | {height:.0f} |")


def response_table():
    """Assist both joints by 20 % of their nominal torque, or oppose them, and compare with an adult without robot."""
    kinds = {"helpful, `adaptation=0`": (0.2, 0.0), "helpful": (0.2, 0.8), "opposing": (-0.2, 0.8)}
    print("| 20 % of a joint's torque |", " | ".join(kinds), "|")
    print("|---|--:|--:|--:|")
    for joint in JOINTS:
        cells = []
        for share, adaptation in kinds.values():
            with Diagram("assisted", rate=500) as diagram:
                alone = Walker(1.25, variability=0.0, name="alone")()
                walker = Walker(1.25, variability=0.0, adaptation=adaptation, name="assisted")
                for side in ("left", "right"):
                    own = getattr(alone, f"{side}_{joint}_torque")
                    walker(**{f"{side}_{joint}_assistance": Gain(share)(own)})
            recording = run(diagram, 3000)
            late = recording.time > 3.0
            before, after, angle, moved = (
                recording[f"{name}.left_{joint}_{signal}"][late]
                for signal in ("torque", "angle")
                for name in ("alone", "assisted")
            )
            apart = np.degrees(np.sqrt(np.mean((moved - angle) ** 2)))
            change = (
                recording["assisted.metabolic_change"][late].mean() / recording["alone.metabolic_power"][late].mean()
            )
            cells.append(f"{(after - before) @ before / (before @ before):+.0%}, {apart:.1f}°, {change:+.0%}")
        print(f"| {joint} |", " | ".join(cells), "|")


def cost(**parameters: Any):
    """Return the processor time of a step and its update, µs."""

    def seconds(walker, ticks=200_000):
        with Diagram("cost", rate=1000) as diagram:
            for _ in range(walker):
                Walker(**parameters)()
        schedule = compile(diagram)
        executor = Executor(Program(schedule, []), 1000.0, shared=SharedState(1 << 16), virtual=True)
        begin = time.process_time()
        executor.run(ticks)
        return (time.process_time() - begin) / ticks

    return 1e6 * (min(seconds(2) for _ in range(5)) - min(seconds(1) for _ in range(5)))


if __name__ == "__main__":
    motion_table()
    print()
    curve_table()
    print()
    slip_table()
    print()
    response_table()
    print()
    changing = "0:0.8 " + " ".join(f"{2 * k}:{0.8 + 0.6 * (k % 2)}" for k in range(1, 100))
    print(f"µs a substep: {cost(speed=1.2):.2f} at a constant speed, {cost(speed=changing):.2f} while it changes")
