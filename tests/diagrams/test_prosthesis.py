"""The prosthetic knee and ankle in virtual time: walking on both controllers, weight in swing, the simulated leg."""

import itertools

import numpy as np
import pytest

import runtime
from runtime.host.errors import BadInput
from runtime.robot.loading.file import load
from tests.diagrams import motions
from tests.diagrams.robots import path

ROBOT = path("knee_ankle_prosthesis")
EARLY_STANCE, LATE_STANCE, EARLY_SWING, LATE_SWING, STANDING = range(5)


@pytest.mark.parametrize(
    "controller, mass, speed, side",
    [
        ("states", 70, 1.2, "left"),
        ("phase", 50, 1.2, "right"),
        *(
            pytest.param(*case, marks=pytest.mark.soak)
            for case in (("states", 90, 0.8, "right"), ("states", 50, 1.0, "left"), ("phase", 70, 1.6, "left"))
        ),
    ],
)
def test_the_wearer_stands_walks_and_stands_again(controller, mass, speed, side):
    settings = {"controller": controller, "mass": mass, "side": side, "seed": mass}
    settings["speed"] = f"0:0 1:0 2.5:{speed} 12:{speed} 13:0"
    trial = runtime.run(ROBOT, 15.0, settings=settings, plant_signals="*")
    assert trial.fault is None
    load_, knee, ankle = (trial[f"{side}/{name}"] for name in ("load.y", "knee.position", "ankle.position"))
    phase, force = trial[f"plant/walker.{side}_phase"], trial[f"plant/{side}/lower_leg.ground_force[1]"]
    steady, standing = (trial.time > 6.0) & (trial.time < 12.0), (trial.time > 0.6) & (trial.time < 1.0)
    assert load_[standing].min() > 0.4 and knee[standing].max() < 0.1  # body weights, rad
    assert 0.95 < knee[steady].max() < 1.4
    assert (force[steady & (phase > 0.72) & (phase < 0.92)] > 10.0).mean() < 0.1  # N: the foot hardly scuffs
    assert 0.7 < np.percentile(force[steady], 99) / (9.81 * mass) < 1.5
    assert np.abs(trial[f"plant/{side}/lower_leg.drop"]).max() < 0.07  # m, of the hips
    power = trial[f"{side}/ankle.torque"] * trial[f"{side}/ankle.velocity"]
    assert speed > 1.2 or power[steady & (phase > 0.45) & (phase < 0.62)].mean() > 0.1 * mass  # W, in push-off
    if controller == "states":
        state = trial[f"{side}/machine.state"].astype(int)
        turns = state[1:][steady[1:] & (np.diff(state) != 0)]
        assert len(turns) > 16 and (np.diff(turns) % 4 == 1).mean() > 0.85  # each state in its turn
        assert state[-1] in (EARLY_STANCE, STANDING)
    else:
        swing, used = phase_estimate(trial, side)[steady] > 0.6, trial[f"{side}/phase.y"][steady]
        assert (used[swing & (load_[steady] > 0.4)] < 0.2).all()


def phase_estimate(trial, side):
    """Return the gait phase that the robot estimates."""
    return trial[f"{side}/gait_phase.phase"]


@pytest.mark.hazard("H12g")
@pytest.mark.parametrize("controller", ["states", pytest.param("phase", marks=pytest.mark.soak)])
def test_the_knee_bears_the_weight_in_other_motions(controller, tmp_path):
    """Stumbling, walking backward, stepping in place, turning: without a fault, which would leave the leg limp."""
    for motion, (knee, drop) in motions.bearing(
        ROBOT.stem, *motions.write(tmp_path), {"controller": controller}
    ).items():
        assert (knee < 40.0 or motion == "hopping") and drop > -70.0, motion  # °, mm; the adult bends it in a hop


def test_a_wearer_whose_weight_the_ankle_cannot_repeat_is_refused():
    with pytest.raises(BadInput, match="mass is at most 90 kg, got 110"):
        runtime.run(ROBOT, 1.0, settings={"mass": 110})


@pytest.mark.hazard("H12g")
@pytest.mark.parametrize("swing", [EARLY_SWING, LATE_SWING])
def test_weight_on_the_foot_ends_a_swing(swing):
    """As after a stumble: the knee is stiff again one tick after the load."""
    machine = load(ROBOT)[1]["left/machine"]
    unloaded = {"load": 0.0, "ankle": 0.0, "ankle_velocity": 0.0, "knee": 0.3, "knee_velocity": 1.0}
    periods = [(40.0 if state == swing else -1.0, -1.0) for state in range(len(machine.names))]
    machine.current = [swing, 1.0, *itertools.chain(*periods)]
    before, after = (dict(zip(machine.outputs, machine.step(**unloaded | {"load": load}))) for load in (0.0, 0.5))
    assert before["state"] == swing and before["knee_stiffness"] < 60.0
    assert after["state"] == EARLY_STANCE and after["knee_stiffness"] > 100.0


def test_a_leg_in_the_air_keeps_its_energy():
    """Shank and foot swing freely from a knee at rest, as a double pendulum without friction."""
    amputee = load(ROBOT)[0].module.plant.__globals__
    leg = amputee["LowerLeg"]()
    leg.dt = 1e-3
    thigh = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0])  # whose knee does not become straight
    shank = np.array([0.0, 2.0, 0.0, 0.0, 0.0, 0.0, -0.5, 0.0, 0.0])
    leg.reset()
    leg.step(thigh, shank)
    energies = []
    for _ in range(2000):
        leg.update(thigh, shank, np.array([0.0, 0.0]), 0.0, 0.0)
        leg.raised = leg.rising = 0.0  # the knee is held
        energies.append(energy(leg, amputee))
    assert min(angle for angle in leg.angles) < 0.0 and np.ptp(energies) < 0.02 * 3.0  # J, of 3 J of swing


def energy(leg, constants):
    """Return the energy of a leg whose knee is at rest, J."""
    (s, p), (ds, dp) = leg.angles, leg.rates
    length = constants["SHANK_LENGTH"] * leg.height
    (m1, c, i1), (m2, ahead, above, i2) = constants["SHANK"], constants["FOOT"]
    along, forward, rotor = np.exp(1j * s), np.exp(1j * p), constants["ROTOR"]
    first, first_rate = -1j * c * along, c * along * ds
    centre = complex(ahead, above) * forward
    second, second_rate = -1j * length * along + centre, length * along * ds + 1j * centre * dp
    moving = m1 * abs(first_rate) ** 2 + m2 * abs(second_rate) ** 2 + i1 * ds**2 + i2 * dp**2
    moving += rotor * (ds**2 + (dp - ds) ** 2)
    return 0.5 * moving + constants["GRAVITY"] * (m1 * first.imag + m2 * second.imag)
