"""Limbs against closed forms."""

import math

import numpy as np
import pytest

from blocks.models import Limb
from graph import Diagram, DiagramError, deg
from tests.blocks.running import both_ways, inside, player, run

RATE = 1000


def limb(seconds, inputs=None, rate=RATE, **parameters):
    """(t, position, velocity) of a limb, its inputs arrays or constants by name."""
    ticks = int(seconds * rate)
    given = {name: np.broadcast_to(np.asarray(value, dtype=float), ticks) for name, value in (inputs or {}).items()}
    found = inside(lambda: Limb(**parameters), rate=rate, ticks=ticks, **given)
    return np.arange(ticks) / rate, found["position"], found["velocity"]


FREE = {"stiffness": 0.0, "reflex": 0.0, "damping": 0.0}


def test_a_free_limb_under_a_constant_torque_accelerates_evenly():
    """Semi-implicit Euler gives ω exactly and θ half a step ahead: τ t dt / 2 I."""
    t, position, velocity = limb(1.0, {"torque": 2.0}, inertia=0.5, **FREE)
    assert np.abs(velocity - 4.0 * t).max() < 1e-12
    assert np.abs(position - (2.0 * t**2 + 2.0 * t / RATE)).max() < 1e-12


def test_free_limb_with_friction_reaches_final_speed():
    """ω = τ / d (1 − exp(−d t / I)), within Euler's d dt / 2 I of it."""
    t, _, velocity = limb(3.0, {"torque": 1.0}, inertia=0.1, damping=0.25, stiffness=0.0, reflex=0.0)
    assert np.abs(velocity - 4.0 * (1.0 - np.exp(-2.5 * t))).max() < 4.0 * 0.25 / (2 * 0.1 * RATE)


@pytest.mark.parametrize("stiffness, reflex, damping", [(50.0, 0.5, 0.2), (120.0, 8.0, 1.0), (20.0, 0.0, 0.0)])
def test_a_wearer_holds_a_limb_like_a_spring_with_a_damper(stiffness, reflex, damping):
    """Free response from 0.3 rad to an intention of 0.1 rad, within 0.7 % of its size."""
    inertia, start, target = 0.35, 0.3, 0.1
    t, position, _ = limb(
        2.0, {"angle": target}, inertia=inertia, stiffness=stiffness, reflex=reflex, damping=damping, start=start
    )
    natural, share = math.sqrt(stiffness / inertia), (reflex + damping) / (2.0 * math.sqrt(stiffness * inertia))
    assert share < 1.0
    damped = natural * math.sqrt(1.0 - share**2)
    wanted = target + (start - target) * np.exp(-share * natural * t) * (
        np.cos(damped * t) + share * natural / damped * np.sin(damped * t)
    )
    assert np.abs(position - wanted).max() < 0.007 * abs(start - target)


def intended_and_moved(seconds, torque):
    """(intended angle, position) of a wearer who bends the joint from 0.1 to 1.1 rad and back, once a second."""
    turn = 2.0 * np.pi * np.arange(int(seconds * RATE)) / RATE
    angle, rate, acceleration = 0.6 - 0.5 * np.cos(turn), np.pi * np.sin(turn), 2.0 * np.pi**2 * np.cos(turn)
    with Diagram("wearer", rate=RATE) as diagram:
        Limb(start=0.1, name="limb")(
            torque=torque, angle=player(angle), rate=player(rate), acceleration=player(acceleration)
        )
    return angle, run(diagram, len(angle))["limb.position"]


def test_limb_without_torque_follows_intended_motion():
    """The acceleration of the intended motion moves the limb: within 0.2° of it, at the rate of the plant."""
    angle, position = intended_and_moved(3.0, torque=0.0)
    assert np.abs(position - angle)[RATE:].max() < deg(0.2)


def test_torque_of_the_drive_moves_a_limb_away_from_its_intended_motion():
    free, helped = (intended_and_moved(1.0, torque)[1] for torque in (0.0, 5.0))
    shift = (helped - free)[500:]
    assert shift.min() > 0.9 * 5.0 / 120.0 and shift.max() < 1.1 * 5.0 / 120.0


def test_a_steady_torque_moves_a_held_limb_by_torque_over_stiffness():
    _, position, velocity = limb(4.0, {"torque": 6.0}, stiffness=120.0)
    assert position[-1] == pytest.approx(6.0 / 120.0, abs=1e-9) and abs(velocity[-1]) < 1e-9


def test_a_straight_knee_is_stopped_by_its_ligaments():
    """Pushed with 5 N·m against 500 N·m/rad below −1°: it comes to rest 0.01 rad beyond, and is not pulled above."""
    _, position, _ = limb(4.0, {"torque": -5.0}, lower=deg(-1.0), stiffness=0.0, reflex=2.0)
    assert position[-1] == pytest.approx(deg(-1.0) - 0.01, abs=1e-6)
    _, position, _ = limb(1.0, {"torque": 1.0}, lower=deg(-1.0), **FREE)
    assert position[-1] == pytest.approx(0.5 / 0.35, rel=0.01)


def test_limb_starts_at_initial_angle_at_rest():
    with Diagram("start", rate=RATE):
        block = Limb(start=0.7)
    assert block.step() == (0.7, 0.0)
    block.update(torque=1.0)
    assert block.step()[1] != 0.0
    block.reset()
    assert block.step() == (0.7, 0.0)


def test_limb_outputs_current_state_and_may_close_a_loop():
    """Torque moves it a tick later: no direct feedthrough."""
    torque = np.zeros(10)
    torque[4] = 1.0
    found = both_ways(lambda: Limb(**FREE), rate=RATE, torque=torque)
    assert not np.any(found["velocity"][:5]) and found["velocity"][5] > 0.0


def test_nan_torque_of_a_limb_appears_in_its_outputs():
    found = both_ways(Limb, rate=RATE, torque=np.array([0.0, math.nan, 0.0, 0.0]))
    assert np.isnan(found["position"][2:]).all() and not np.isnan(found["position"][:2]).any()


@pytest.mark.parametrize(
    "parameters, said",
    [
        ({"inertia": 0.0}, "inertia: must be above 0.0 kg·m², got 0.0"),
        ({"damping": -1.0}, "damping: must be at least 0.0"),
        ({"stiffness": -1.0}, "stiffness: must be at least 0.0 N·m/rad"),
        ({"reflex": math.nan}, "reflex: NaN"),
        ({"ligament": -1.0}, "ligament: must be at least"),
    ],
)
def test_parameters_of_a_limb_are_refused(parameters, said):
    with pytest.raises(DiagramError, match=f"Limb: {said}"):
        Limb(**parameters)
