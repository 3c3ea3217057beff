"""Orientation filters against motions whose orientation is known in closed form, and against two libraries.

The libraries, imufusion and ahrs, are of the extra `test`; what needs them is skipped without.
"""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from blocks.orientation import ComplementaryOrientation, Madgwick, Mahony
from graph import Diagram
from tests.blocks.running import by_hand

RATE, G = 200.0, 9.80665
FIELD = np.array([20.0, 0.0, -43.0])  # µT: north, and down
FILTERS = {"Madgwick": Madgwick, "Mahony": Mahony, "Complementary": ComplementaryOrientation}
# else it takes what is wrong at first for a bias, and unlearns that in a minute
FAST = {Mahony: {"kp": 3.0, "ki": 0.0}}


def measured(rotation, turn, field=True, bias=(0.0, 0.0, 0.0)):
    """What an IMU measures at these orientations (body to world) while it turns at `turn` rad/s in its own axes, one
    row each.
    """
    count = len(rotation)
    inputs = {
        "gyro": np.broadcast_to(np.asarray(turn) + bias, (count, 3)),
        "accel": rotation.inv().apply((0.0, 0.0, G)),
    }
    return inputs | ({"mag": rotation.inv().apply(FIELD)} if field else {})


def steady_turn(seconds, turn, start):
    """q(t) = q(0) ⊗ exp(ω t): a turn at a constant rate about an axis of the body, oblique to everything."""
    time = np.arange(round(seconds * RATE)) / RATE
    return start * Rotation.from_rotvec(np.outer(time, turn))


def filtered(kind, inputs, **parameters):
    """(rotations, all outputs)"""
    with Diagram("filter", RATE):
        block = kind(**parameters)
    outputs = by_hand(block, len(inputs["gyro"]), **inputs)
    return Rotation.from_quat(outputs["quaternion"], scalar_first=True), outputs


def error(found, true):
    """rad, of each sample"""
    return (found * true.inv()).magnitude()


def tilt(found, true):
    """rad, between the two ups"""
    ups = [rotation.inv().apply((0.0, 0.0, 1.0)) for rotation in (found, true)]
    return np.arccos(np.clip(np.sum(ups[0] * ups[1], axis=1), -1.0, 1.0))


@pytest.mark.parametrize("kind", FILTERS.values(), ids=FILTERS)
@pytest.mark.parametrize("start", [(0.0, 0.0, 0.0), (2.0, -0.4, 0.3), (-3.0, 1.2, -2.5)])
def test_a_turn_in_closed_form_is_followed(kind, start):
    """To rounding; Madgwick's steps are of a fixed length, so it stays within gain · dt about it."""
    turn = (0.7, -1.1, 1.9)
    true = steady_turn(10.0, turn, Rotation.from_euler("ZYX", start))
    found, outputs = filtered(kind, measured(true, turn))
    assert error(found, true).max() < (1.2 * 0.1 / RATE if kind is Madgwick else 1e-6)
    assert np.abs(np.linalg.norm(outputs["quaternion"], axis=1) - 1.0).max() < 1e-14


@pytest.mark.parametrize("kind", FILTERS.values(), ids=FILTERS)
def test_the_quaternion_has_w_first_and_rotates_body_axes_to_a_z_up_world(kind):
    """A body on its right side: its y points down, which the accelerometer shows as −g on it."""
    with Diagram("filter", RATE):
        block = kind()
    outputs = block.step(gyro=(0.0, 0.0, 0.0), accel=(0.0, -G, 0.0))
    quaternion = outputs if kind is not Mahony else outputs[0]
    assert quaternion == pytest.approx([math.sqrt(0.5), -math.sqrt(0.5), 0.0, 0.0])


@pytest.mark.parametrize("kind", FILTERS.values(), ids=FILTERS)
def test_without_a_field_the_tilt_is_correct_and_the_heading_is_integrated(kind):
    turn = (0.7, -1.1, 1.9)
    true = steady_turn(10.0, turn, Rotation.from_euler("ZYX", (0.0, 0.3, -0.2)))
    found, _ = filtered(kind, measured(true, turn, field=False))
    assert error(found, true).max() < (0.003 if kind is Madgwick else 1e-6)
    free, _ = filtered(kind, measured(true, turn, field=False, bias=(0.0, 0.0, 0.02)))
    assert tilt(free, true).max() < 0.05


@pytest.mark.soak
def test_the_complementary_filters_error_of_a_bias_is_bias_times_time_constant():
    """At rest; of the tilt where it is about a level axis, of the heading where it is about the vertical."""
    still = Rotation.from_euler("ZYX", np.tile((0.5, 0.1, -0.2), (6000, 1)))
    for axis, measure in zip(np.eye(3), (tilt, tilt, error)):
        bias = still[0].inv().apply(0.01 * axis)
        found, _ = filtered(ComplementaryOrientation, measured(still, (0.0, 0.0, 0.0), bias=bias), time_constant=2.0)
        assert measure(found, still)[-1] == pytest.approx(0.01 * 2.0, rel=0.01)


@pytest.mark.soak
def test_mahony_finds_the_bias():
    still = Rotation.from_euler("ZYX", np.tile((0.5, 0.1, -0.2), (12000, 1)))
    bias = (0.02, -0.03, 0.01)
    found, outputs = filtered(Mahony, measured(still, (0.0, 0.0, 0.0), bias=bias), kp=2.0, ki=0.5)
    assert outputs["bias"][-1] == pytest.approx(bias, abs=3e-4) and error(found, still)[-1] < 1e-3


@pytest.mark.parametrize("kind", FILTERS.values(), ids=FILTERS)
def test_a_wrong_start_is_corrected(kind):
    """What it takes for rest at first was none: it begins 0.5 rad off, and ends where it is."""
    still = Rotation.from_euler("ZYX", np.tile((0.0, 0.0, 0.0), (4000, 1)))
    inputs = measured(still, (0.0, 0.0, 0.0))
    inputs["accel"] = inputs["accel"].copy()
    inputs["accel"][0] = G * math.sin(0.5), 0.0, G * math.cos(0.5)
    found, _ = filtered(kind, inputs, **FAST.get(kind, {}))
    assert error(found, still)[0] == pytest.approx(0.5, abs=0.01) and error(found, still)[-1] < 0.002


@pytest.mark.parametrize("kind", FILTERS.values(), ids=FILTERS)
def test_nan_appears_and_is_not_stored(kind):
    true = steady_turn(2.0, (0.5, 0.2, -0.3), Rotation.identity())
    inputs = {name: np.array(values) for name, values in measured(true, (0.5, 0.2, -0.3)).items()}
    inputs["accel"][100] = math.nan
    outputs = by_hand(made(kind), 400, **inputs)
    assert (
        np.isnan(outputs["quaternion"][100]).all() and np.isfinite(np.delete(outputs["quaternion"], 100, axis=0)).all()
    )
    last = Rotation.from_quat(outputs["quaternion"][-1], scalar_first=True)
    # one step of the gyroscope was lost, and most of it has been made good
    assert (last * true[-1].inv()).magnitude() < 0.01


def made(kind, **parameters):
    with Diagram("filter", RATE):
        return kind(**parameters)


@pytest.mark.parametrize("field", [False, True])
def test_madgwick_does_a_step_of_the_library_ahrs(field):
    """With next to no turn in it: it looks for errors before the turn, and ours behind."""
    library = pytest.importorskip("ahrs").filters
    random = np.random.default_rng(1)
    for _ in range(20):
        before = Rotation.random(random_state=random)
        now = at_rest(before * Rotation.from_rotvec(0.3 * random.normal(size=3))) | {"gyro": np.full(3, 1e-9)}
        block = made(Madgwick, gain=0.4)
        block.step(**at_rest(before))
        ours = block.step(**(now if field else {name: now[name] for name in ("gyro", "accel")}))
        theirs, q = library.Madgwick(Dt=1.0 / RATE, gain=0.4), before.as_quat(scalar_first=True)
        step = (
            theirs.updateMARG(q, now["gyro"], now["accel"], now["mag"])
            if field
            else theirs.updateIMU(q, now["gyro"], now["accel"])
        )
        assert Rotation.from_quat(ours, scalar_first=True).as_matrix() == pytest.approx(
            Rotation.from_quat(step, scalar_first=True).as_matrix(), abs=1e-8
        )


def at_rest(rotation):
    return {"gyro": (0.0, 0.0, 0.0), "accel": rotation.inv().apply((0.0, 0.0, G)), "mag": rotation.inv().apply(FIELD)}


@pytest.mark.parametrize("field", [False, True])
def test_filters_agree_with_imufusion_after_a_noisy_motion(field):
    """Half a minute of turns about three axes, with the noise of a cheap IMU: within a degree of the truth, as it
    is.
    """
    imufusion = pytest.importorskip("imufusion")
    random = np.random.default_rng(2)
    time = np.arange(round(30.0 * RATE)) / RATE
    angles = np.stack([0.6 * np.sin(0.9 * time), 0.4 * np.sin(1.3 * time), 0.5 * np.sin(0.7 * time)], axis=-1)
    true = Rotation.from_euler("ZYX", angles)
    turn = (true[:-1].inv() * true[1:]).as_rotvec() * RATE
    inputs = measured(true, np.vstack([turn[:1], turn]), field)
    inputs = {
        name: values + random.normal(0.0, {"gyro": 0.005, "accel": 0.05, "mag": 0.3}[name], values.shape)
        for name, values in inputs.items()
    }
    theirs = imufusion.Ahrs()
    theirs.set_settings(imufusion.AhrsSettings(sample_rate=RATE, gain=0.5))
    library = []
    for gyro, accel, mag in zip(np.degrees(inputs["gyro"]), inputs["accel"] / G, inputs.get("mag", inputs["gyro"])):
        theirs.update(gyro, accel, mag) if field else theirs.update_no_magnetometer(gyro, accel)
        library.append(theirs.get_quaternion())
    settled = slice(round(5.0 * RATE), None)
    reference = tilt(Rotation.from_quat(library, scalar_first=True), true)[settled].max()
    assert reference < math.radians(1.0)
    for kind in FILTERS.values():
        found, _ = filtered(kind, inputs, **FAST.get(kind, {}))
        assert (error if field else tilt)(found, true)[settled].max() < math.radians(1.0), kind
