"""Recorded people beside the average adult and beside the adult of the family who is closest to each.

`python -m tests.blocks.wearer.measure_people` prints the tables of docs/explanation/wearer.md. It needs the shared
folder of measured data.
"""

import tempfile

import numpy as np

from blocks.wearer.adults import adult
from blocks.wearer.norms import COMPONENTS, MOTIONS
from blocks.wearer.stride import PHASES, other, series, values
from tests.blocks.wearer.measure import JOINTS, MOMENTS, measures, rows, walk

WALK = MOTIONS["walk"]
PERCENT = np.arange(101)
INDEPENDENT_VALUES = 30  # that a curve counts as
TIME_TOLERANCE = 0.05  # of the stride time, relative
FALISSE_TIME, PINZONE_TIME = 1.035, 1.10  # s; of the trials, and assumed
# Range, peak velocity and peak acceleration of hip, knee and ankle of Falisse's adult in single trials: medians of both
# legs in 11 trials, 12 harmonics of the angles by inverse kinematics, not filtered (github antoinefalisse/3dpredictsim,
# commit 2985bf7, OpenSimModel/subject2/IK; MIT). The mean over these trials was low-passed at 6 Hz.
FALISSE_TRIALS = np.array([46.7, 4.3, 49.0, 60.2, 6.8, 129.1, 32.6, 6.8, 187.8])
CUTOFFS = {"adult of Moore 2015": 6.0}  # Hz, at which the recorded angles are low-passed, and those beside them
STEP = 0.2
DRAWS = np.clip(np.random.RandomState(0).normal(size=(200, len(COMPONENTS))), -2.0, 2.0)


def people():
    """Yield (name, stride time in s, angles of the stride at PHASES in rad, torques in N·m/kg or None)."""
    data = rows("healthy_young")
    for side, short in (("left", "lt"), ("right", "rt")):
        strikes = np.flatnonzero(np.diff(data[f"contact_{short}"]) > 500) + 1
        yield f"young adult of Wiles 2023, {side}", *median_stride(data, f"_{short}", strikes, 0.005), None
    data = rows("series_walk_moments_moore2015")
    force = data["grf_vertical_rt_N_kg"]
    strikes = np.flatnonzero((force[1:] > 1.0) & (force[:-1] <= 1.0)) + 1
    torques = [middle(-data[f"{name}_moment_rt_Nm_kg"], strikes) for name in MOMENTS.values()]
    yield "adult of Moore 2015", *median_stride(data, "_rt", strikes, 0.01), closed(torques)
    for name, file, stride_time in (
        ("adult of Falisse 2019", "walk_subject_falisse2019", FALISSE_TIME),
        ("mean of Pinzone 2014", "walk_norms_pinzone2014_centre1", PINZONE_TIME),
    ):
        data = rows(file)
        angles, torques = (
            closed([np.interp(PERCENT, data["gait_cycle_percent"], data[f"{each}_mean"]) for each in columns])
            for columns in ([f"{j}_deg" for j in JOINTS.values()], [f"{m}_moment_Nm_kg" for m in MOMENTS.values()])
        )
        yield name, stride_time, np.radians(angles), -torques


def median_stride(data, suffix, strikes, dt):
    """Return (stride time in s, angles at PHASES in rad)."""
    angles = [middle(data[f"{column}{suffix}_deg"], strikes) for column in JOINTS.values()]
    return float(np.median(np.diff(strikes))) * dt, np.radians(closed(angles))


def middle(curve, strikes):
    """Return the median over the strides at every percent of a stride."""
    strides = [
        np.interp(PERCENT, np.linspace(0, 100, b - a + 1), curve[a : b + 1]) for a, b in zip(strikes, strikes[1:])
    ]
    return np.median(strides, axis=0)


def closed(curves):
    """Return curves of 101 points at PHASES, of 12 harmonics, the step at their seam spread over the stride."""
    return np.array([values(series((c - (c[-1] - c[0]) * (PERCENT / 100.0 - 0.5))[:100])) for c in curves])


def entry_at(speed):
    """Return the series of the average walk at a speed."""
    place = np.interp(speed, [entry["speed"] for entry in WALK], np.arange(len(WALK)))
    first, share = min(int(place), len(WALK) - 2), place - min(int(place), len(WALK) - 2)
    return {
        name: (1.0 - share) * np.array(WALK[first][name]) + share * np.array(WALK[first + 1][name]) for name in WALK[0]
    }


def closest(angles, stride_time):
    """Return the entry of the closest adult of the family, at the speed that suits best.

    The zero of an angle depends on the laboratory and does not count. Least squares of the angles in mean standard
    deviations between adults, of the stride time, and of the scores, which count as one standard deviation each.
    """
    components = np.array(COMPONENTS)

    def residual(person, deviations):
        apart = [(values(each) - angle) / sd for each, angle, sd in zip(person["angles"], angles, deviations)]
        shape = np.ravel([each - each.mean() for each in apart]) * np.sqrt(INDEPENDENT_VALUES / len(PHASES))
        return np.append(shape, np.log(person["stride_time"] / stride_time) / TIME_TOLERANCE)

    candidates = []
    for speed in np.arange(0.86, 1.9, 0.1):
        entry = entry_at(speed)
        deviations = [values(each).mean() for each in entry["angle_deviations"]]
        scores = np.zeros(len(components))
        for _ in range(3):
            here = residual(adult(entry, scores @ components), deviations)
            tried = [
                residual(adult(entry, (scores + STEP * unit) @ components), deviations) for unit in np.eye(len(scores))
            ]
            slopes = (np.array(tried) - here) / STEP
            scores = scores - np.linalg.solve(slopes @ slopes.T + np.eye(len(scores)), slopes @ here + scores)
        person = adult(entry, scores @ components)
        cost = np.sum(residual(person, deviations) ** 2) + np.sum(scores**2)
        candidates.append((cost, person))
    return min(candidates, key=lambda each: each[0])[1]


def average(stride_time):
    """Return the entry of the average adult with a stride time in s."""
    speeds = np.linspace(0.86, 1.9, 200)
    return entry_at(np.interp(-stride_time, [-entry_at(speed)["stride_time"] for speed in speeds], speeds))


def motion_table():
    print("| | hip: range ° | rad/s | rad/s² | knee: ° | rad/s | rad/s² | ankle: ° | rad/s | rad/s² |")
    print("|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|")
    recorded, usual = [], []
    for name, stride_time, angles, _ in people():
        cutoff = CUTOFFS.get(name, np.inf)
        own = FALISSE_TRIALS if "Falisse" in name else figures(angles, stride_time)
        average_one, close = average(stride_time), closest(angles, stride_time)
        line(f"**{name}**, strides of {stride_time:.2f} s", own)
        for kind, entry in (("average", average_one), ("closest", close)):
            line(f"{kind} adult, {float(entry['speed']):.2f} m/s", of_entry(entry, cutoff), own)
        recorded.append(own)
        usual.append(of_entry(average_one, cutoff))
    weights = (0.5, 0.5, 1.0, 1.0)  # both legs of the young adult count as one; Pinzone's mean does not
    own, average_one = (np.average(each[:4], axis=0, weights=weights) for each in (recorded, usual))
    line("**mean of the three people**", own)
    line("mean of the average adults", average_one, own)


def of_entry(entry, cutoff):
    return figures([values(each) for each in entry["angles"]], float(entry["stride_time"]), cutoff)


def figures(angles, stride_time, cutoff=np.inf):
    """Return range in degrees, peak velocity and peak acceleration of the three joints. cutoff : Hz, of a low-pass"""
    return np.ravel([measures(np.append(each, each[0]), stride_time, cutoff) for each in angles])


def line(name, own, recorded=None):
    """Print a row of figures with their deviation from the recorded ones."""
    texts = [f"{figure:.{digits}f}" for figure, digits in zip(own, (0, 1, 0) * 3)]
    if recorded is not None:
        texts = [f"{text} ({ratio - 1.0:+.0%})" for text, ratio in zip(texts, own / recorded)]
    print(f"| {name} |", " | ".join(texts), "|")


def share_table():
    """Print the share of a stride in which a recorded adult is within the standard deviations of drawn adults."""
    print("| | hip | knee | ankle | hip torque | knee torque | ankle torque |")
    print("|---|--:|--:|--:|--:|--:|--:|")
    for name, stride_time, angles, torques in people():
        drawn = [adult(average(stride_time), scores @ np.array(COMPONENTS)) for scores in DRAWS]
        cells = []
        for kind, curves in (("angles", angles), ("moments", torques)):
            for joint in range(3):
                if curves is None:
                    cells.append("")
                    continue
                family = np.array([values(each[kind][joint]) for each in drawn])
                apart = np.abs(curves[joint] - family.mean(axis=0)) / family.std(axis=0)
                cells.append(f"{np.mean(apart < 1.0):.0%} / {np.mean(apart < 2.0):.0%}")
        print(f"| {name} |", " | ".join(cells), "|")


def torque_table():
    """Print the distance of torques from the measured ones, in standard deviations of Pinzone's clinical centre."""
    norms = rows("walk_norms_pinzone2014_centre1")
    deviations = [norms[f"{name}_moment_Nm_kg_sd"].mean() for name in MOMENTS.values()]
    print("| torques of hip, knee and ankle | average adult | recording without torques |")
    print("|---|--:|--:|")
    for name, stride_time, angles, torques in people():
        if torques is not None:
            usual = [values(each) for each in average(stride_time)["moments"]]
            cells = [
                ", ".join(f"{np.abs(a - b).mean() / sd:.2f}" for a, b, sd in zip(each, torques, deviations))
                for each in (usual, played(angles, stride_time))
            ]
            print(f"| {name} |", " | ".join(cells), "|")


def played(angles, stride_time):
    """Return the torques at PHASES that a Walker plays for a recording of the angles of a stride, N·m/kg."""
    columns = [np.tile(np.degrees(each), 6) for each in (*angles, *map(other, angles))]
    times = np.arange(6 * len(PHASES)) * stride_time / len(PHASES)
    contact = [np.tile(each, 6) for each in (PHASES < 0.6, other(PHASES) < 0.6)]
    names = [f"{name}_{side}_deg" for side in ("lt", "rt") for name in JOINTS.values()]
    with tempfile.NamedTemporaryFile("w", suffix=".csv") as file:
        header = ",".join(["time", *names, "contact_lt", "contact_rt"])
        np.savetxt(file, np.column_stack([times, *columns, *contact]), delimiter=",", header=header, comments="")
        file.flush()
        trace = walk(1.2, 4 * stride_time, rate=len(PHASES) / stride_time, recording=file.name, mass=1.0)
    phase = trace["left_phase"]
    begin = np.flatnonzero(np.diff(phase) < -0.5)[1] + 1
    return [trace[f"left_{joint}_torque"][begin : begin + len(PHASES)] for joint in JOINTS]


if __name__ == "__main__":
    motion_table()
    print()
    torque_table()
    print()
    share_table()
