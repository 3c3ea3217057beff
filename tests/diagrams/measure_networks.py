"""Tables of docs/explanation/trained_networks.md: errors of the trained networks, and their inference time.

`python -m tests.diagrams.measure_networks` prints them. The recordings need the shared folder of measured data.
"""

import tempfile
import time

import numpy as np

from blocks.gait import BiologicalTorque
from blocks.limiters import Saturation
from blocks.mathematics import Gain
from blocks.networks import OnnxModel
from blocks.sources import Constant
from blocks.wearer import Walker
from cext.memory.shared_state import SharedState
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from diagrams.networks import export
from diagrams.networks.trials import RATE, trial
from graph import Diagram, compile
from runtime.session.simulate import simulate
from runtime.setup.bench.gait import CONDITIONS, Leg, play
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
MASSES, SPEEDS, DELAYS = (50.0, 110.0), (0.8, 1.2, 1.6), (0.0, 0.05, 0.1, 0.15, 0.2)  # kg, m/s, s
STEADY_SPEEDS, PERSONS = (0.4, 0.8, 1.2, 1.6, 1.8), range(1, 13)  # m/s, drawn adults
LIMIT, ASSISTED_RATE = 12.0, 500.0  # N·m, Hz
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


def steady(networks):
    """Print the errors on drawn adults who walk at a constant speed."""
    print("| m/s | phase RMS % | without the mean % | " + " | ".join(MOMENTS) + " |\n|--:|--:|--:" + "|--:" * 3 + "|")
    for speed in STEADY_SPEEDS:
        phases, torques = [], {joint: [] for joint in MOMENTS}
        for person in PERSONS:
            with Diagram("steady", RATE) as diagram:
                Walker(speed, person=person, seed=person, mass=MASS, height=1.75, name="walker")()
            run = simulate(diagram, 12.0)
            signals = leg_signals(lambda name: run[f"walker.{name}"], "left", "right")  # noqa: B023
            field = networks["gait_phase"].field - 1
            error = phase_error(
                networks["gait_phase"].of_series(signals), 2.0 * np.pi * run["walker.left_phase"][field:]
            )
            phases.append((error, error - error.mean()))
            for joint, errors in torques.items():
                true = run[f"walker.left_{joint}_torque"][field:] / MASS
                errors.append(networks[f"{joint}_torque"].of_series(signals)[f"{joint}_torque"] - true)
        figures = [f"{100 * rms(errors):.2f}" for errors in zip(*phases)] + [
            f"{rms(each):.3f}" for each in torques.values()
        ]
        print(f"| {speed} | " + " | ".join(figures) + " |")


def leg_signals(signal, side, other):
    """Return the channels of one leg by name. signal : function that returns an output of a Walker by name"""
    names = {"hip_angle": f"{side}_thigh_pitch", "opposite_hip_angle": f"{other}_thigh_pitch"}
    names |= {"hip_velocity": f"{side}_hip_velocity", "opposite_hip_velocity": f"{other}_hip_velocity"}
    names |= {f"knee_{name}": f"{side}_knee_{name}" for name in ("angle", "velocity")}
    return {channel: signal(name) for channel, name in names.items()}


def squats(network):
    """Print how often the vector of the phase is long in squats, and how often of both legs half a stride apart."""
    data = rows("series_squat_opencap")
    forth = np.arange(len(data))
    angles = {
        side: np.radians(data[f"hip_flexion_{side}_deg"] - STANDING_ANGLES["hip"])[np.r_[forth, forth[::-1]]]
        for side in SIDES
    }
    vectors = {}
    for side, other in (("lt", "rt"), ("rt", "lt")):
        signals = {"hip_angle": angles[side], "opposite_hip_angle": angles[other]}
        signals |= {name.replace("angle", "velocity"): RATE * np.gradient(angle) for name, angle in signals.items()}
        estimate = network.of_series(signals)
        vectors[side] = estimate["phase_cos"] + 1j * estimate["phase_sin"]
    apart = np.abs(np.angle(vectors["lt"] / vectors["rt"])) / (2.0 * np.pi) > 0.35
    long = {side: np.abs(vector) > 0.5 for side, vector in vectors.items()}
    print("squats: " + ", ".join(f"{SIDES[side]} {each.mean():.1%}" for side, each in long.items()), end="")
    print(f" of the time above 0.5; both, half a stride apart: {np.mean(long['lt'] & long['rt'] & apart):.1%}")


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


def assistance(network, joint):
    """Print the work of a share of the estimated torque on walkers, J a stride, positive and negative."""
    cases = [(mass, speed) for mass in MASSES for speed in SPEEDS]
    print(f"| {joint}, delay s | " + " | ".join(f"{mass:.0f} kg, {speed} m/s" for mass, speed in cases) + " |")
    print("|--:" * (1 + len(cases)) + "|")
    for delay in DELAYS:
        cells = []
        for mass, speed in cases:
            run = assisted(network, joint, mass, speed, delay)
            strides = np.flatnonzero(np.diff(run["walker.left_phase"]) < -0.5)[4:]
            power = (run["left_torque.y"] * run[f"walker.left_{joint}_velocity"])[strides[0] : strides[-1]]
            scale = ASSISTED_RATE * (len(strides) - 1)
            cells.append(f"{power.clip(min=0.0).sum() / scale:+.1f} {power.clip(max=0.0).sum() / scale:+.1f}")
        print(f"| {delay} | " + " | ".join(cells) + " |")


def assisted(network, joint, mass, speed, delay):
    """Return the walk of an adult whom both legs' networks assist. mass : kg; speed : m/s; delay : s"""
    with Diagram("assisted", ASSISTED_RATE) as diagram:
        adult = Walker(f"0:0 0.5:0 2:{speed}", mass=mass, seed=3, name="walker")
        motion = adult()
        for side, other in (("left", "right"), ("right", "left")):
            signals = leg_signals(lambda name: getattr(motion, name), side, other)
            block = OnnxModel(str(network.path), name=f"{side}_network")
            estimate = block(**{each["name"]: signals[each["name"]] for each in network.channels})
            moment = Gain(mass, unit="kg", name=f"{side}_moment")(getattr(estimate, f"{joint}_torque"))
            torque = BiologicalTorque(scale=0.2, delay=delay, cutoff=6.0, name=f"{side}_share")(moment)
            limited = Saturation(-LIMIT, LIMIT, name=f"{side}_torque")(torque)
            adult(**{f"{side}_{joint}_assistance": limited})
    return simulate(diagram, 12.0)


def cost(path, network):
    """Return the processor time of an inference in the tick, µs. path : of the file; network : with its channels"""

    def seconds(count, ticks=2000):
        with Diagram("cost", RATE) as diagram:
            zero = Constant(0.0, unit="rad")(), Constant(0.0, unit="rad/s")()
            for _ in range(count):
                OnnxModel(str(path))(**{each["name"]: zero[each["unit"] == "rad/s"] for each in network.channels})
        executor = Executor(Program(compile(diagram), []), RATE, shared=SharedState(1 << 16), virtual=True)
        begin = time.process_time()
        executor.run(ticks)
        return (time.process_time() - begin) / ticks

    return 1e6 * (min(seconds(3) for _ in range(5)) - min(seconds(1) for _ in range(5))) / 2.0


def forms(network):
    """Print the processor time of the streaming form and of a window, and the largest difference of their results."""
    leg = trial(0, 10.0)[0]
    streaming, window = network.of_samples(leg)[network.field - 1 :], network.of_windows(leg)
    print(f"largest difference of {len(window)} results: {np.abs(streaming - window).max():.1e}")
    with tempfile.NamedTemporaryFile(suffix=".onnx") as file:
        layers = network.layers, network.dilations, network.metadata
        file.write(export.model(*layers, network.field).SerializeToString())
        file.flush()
        print(f"streaming {cost(network.path, network):.0f} µs, window {cost(file.name, network):.0f} µs")


if __name__ == "__main__":
    made = {name: Network(name) for name in NAMES}
    held_out(made)
    print()
    steady(made)
    print()
    squats(made["gait_phase"])
    young_adult(made["gait_phase"])
    print()
    curves(made)
    print()
    for joint in MOMENTS:
        assistance(made[f"{joint}_torque"], joint)
        print()
    forms(made["hip_torque"])
