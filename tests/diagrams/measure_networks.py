"""Tables of docs/trained_networks.md: errors of the trained networks, and their inference time.

`python -m tests.diagrams.measure_networks` prints them. The recordings need the shared folder of measured data.
"""

import time

import numpy as np

from diagrams.networks.trials import RATE, trial
from runtime.bench.gait import CONDITIONS, Leg, play
from tests.blocks.wearer.measure import PERCENT, rows, stride, walk
from tests.diagrams.networks import NAMES, Network, phase_error

SEEDS = range(60)  # no trial of the training has one of these
DURATION = 60.0  # s
SIDES = {"lt": "left", "rt": "right"}
WALKING = 0.99  # length of the vector of the phase
SPEED, MASS = 1.2, 70.0  # m/s and kg of the Walker beside mean curves
STRIDE_TIME = 1.1  # s, of mean curves, which have none
STANDING_ANGLES = {"hip": 8.0, "opposite_hip": 8.0}  # degrees
CURVES = {"Falisse 2019": "walk_subject_falisse2019", "Pinzone 2014": "walk_norms_pinzone2014_centre1"}
MOMENTS = {"hip": "hip_extensor", "knee": "knee_extensor", "ankle": "ankle_plantarflexor"}


def held_out(networks):
    """Print the errors on simulated trials."""
    print("| network | output | RMSE | R² |\n|---|---|--:|--:|")
    legs = [leg for seed in SEEDS for leg in trial(seed, DURATION)]
    for name, network in networks.items():
        estimates = [network.of_series(leg) for leg in legs]
        for output in estimates[0]:
            true = np.concatenate([leg[output][network.field - 1 :] for leg in legs])
            error = np.concatenate([each[output] for each in estimates]) - true
            print(f"| `{name}` | {output} | {rms(error):.3f} | {1.0 - error.var() / true.var():.3f} |")
        if name == "gait_phase":
            sine, cosine = (
                np.concatenate([leg[f"phase_{part}"][network.field - 1 :] for leg in legs]) for part in ("sin", "cos")
            )
            both = {part: np.concatenate([each[part] for each in estimates]) for part in estimates[0]}
            length, error = np.hypot(sine, cosine), phase_error(both, np.arctan2(sine, cosine))
            estimated = np.hypot(both["phase_sin"], both["phase_cos"])
            walking = length > WALKING
            print(f"phase, walking: RMS {100 * rms(error[walking]):.2f} %, ", end="")
            print(f"95 % {100 * np.quantile(np.abs(error[walking]), 0.95):.2f} %; ", end="")
            print(f"length of the vector above 0.5: {np.mean(estimated[walking] > 0.5):.2%} of walking, ", end="")
            print(f"{np.mean(estimated[length == 0.0] > 0.5):.2%} of standing")


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def young_adult(network):
    """Print the RMS error of the phase on the recorded walk of a young adult, with and without its mean, in %."""
    data = rows("healthy_young")
    print("| leg | " + " | ".join(CONDITIONS) + " |\n|---" + "|--:" * len(CONDITIONS) + "|")
    for side, other in (("lt", "rt"), ("rt", "lt")):
        angles = {"hip": f"thigh_pitch_{side}_deg", "opposite_hip": f"thigh_pitch_{other}_deg"}
        angles = {name: np.radians(data[column]) for name, column in angles.items()}
        leg = Leg(side, data["time"], angles, data[f"contact_{side}"] / 1000.0)
        cells = []
        for condition in CONDITIONS:
            walk = play(leg, condition, RATE)
            signals = {f"{name}_angle": walk.signals[name] for name in angles}
            signals |= {f"{name}_velocity": walk.signals[f"{name}_velocity"] for name in angles}
            phase = walk.phase[network.field - 1 :]
            error = phase_error(network.of_series(signals), 2.0 * np.pi * phase)
            error = error[np.isfinite(phase) & walk.moving[network.field - 1 :]]
            cells.append(f"{100 * rms(error):.1f} ({100 * rms(error - error.mean()):.1f})")
        print(f"| {SIDES[side]} | " + " | ".join(cells) + " |")


def curves(networks):
    """Print the errors of the torques on mean curves of other people, played as a periodic walk."""
    print("| curves | joint | RMSE | of the Walker | RMS of the curve | correlation |\n|---|---|--:|--:|--:|--:|")
    average = walk(SPEED)
    phase = np.arange(1000) / RATE / STRIDE_TIME
    for source, file in CURVES.items():
        data = rows(file)

        def curve(column, shift=0.0):
            at = 100.0 * np.mod(phase + shift, 1.0)  # noqa: B023
            return np.interp(at, data["gait_cycle_percent"], data[f"{column}_mean"])  # noqa: B023

        leg = {}
        for name, shift in (("knee", 0.0), ("hip", 0.0), ("opposite_hip", 0.5)):
            angle = curve(f"{name.removeprefix('opposite_')}_flexion_deg", shift) - STANDING_ANGLES.get(name, 0.0)
            leg[f"{name}_angle"] = np.radians(angle)
            leg[f"{name}_velocity"] = np.gradient(leg[f"{name}_angle"]) * RATE
        for joint, column in MOMENTS.items():
            network = networks[f"{joint}_torque"]
            estimate = network.of_series(leg)[f"{joint}_torque"]
            true = -curve(f"{column}_moment_Nm_kg")[network.field - 1 :]
            own = stride(average, average[f"left_{joint}_torque"]) / MASS
            own = np.interp(np.mod(phase, 1.0)[network.field - 1 :], PERCENT / 100.0, own, period=1.0)
            figures = rms(estimate - true), rms(own - true), rms(true), np.corrcoef(estimate, true)[0, 1]
            print(f"| {source} | {joint} | " + " | ".join(f"{figure:.3f}" for figure in figures) + " |")


def times(network):
    """Print processor time and largest difference of the streaming form and of windows."""
    leg = trial(0, 6.0)[0]
    for name, run in (("streaming", network.of_samples), ("window", network.of_windows)):
        begin = time.process_time()
        count = len(run(leg))
        print(f"{name}: {1e6 * (time.process_time() - begin) / count:.0f} µs")
    streaming, window = network.of_samples(leg)[network.field - 1 :], network.of_windows(leg)
    print(f"largest difference {np.abs(streaming - window).max():.1e}")


if __name__ == "__main__":
    made = {name: Network(name) for name in NAMES}
    held_out(made)
    print()
    young_adult(made["gait_phase"])
    print()
    curves(made)
    print()
    times(made["hip_torque"])
