"""Sensors on the walking adult against the motion that they measure."""

import math
from typing import Any

import numpy as np
import pytest

from blocks.wearer import SegmentIMU, SoleForce, Walker
from graph import Diagram, DiagramError
from tests.blocks.running import run


def measured(seconds, rate=500, speed=1.2, variability=1.0, **imu: Any):
    with Diagram("walk", rate=rate) as diagram:
        SegmentIMU(name="imu", **imu)(Walker(name="w", speed=speed, variability=variability)().left_shank_motion)
    recording = run(diagram, round(seconds * rate))
    assert recording.outcome.status == "ok"
    return recording


def vector(recording, path, size=3):
    return np.stack([recording[f"{path}[{k}]"] for k in range(size)], axis=-1)


def test_specific_force_is_second_derivative_of_place_plus_gravity():
    """Place of the sensor from joint and pitch, differentiated twice, turned into the sensor: within 0.2 m/s²."""
    recording = measured(3.0, along=0.15, forward=0.06)
    x, z, pitch = (recording[f"w.left_shank_motion[{k}]"] for k in (0, 1, 6))
    x, z = x + 0.15 * np.sin(pitch) + 0.06 * np.cos(pitch), z - 0.15 * np.cos(pitch) + 0.06 * np.sin(pitch)
    ax, az = (np.gradient(np.gradient(each, recording.time), recording.time) for each in (x, z))
    accel = vector(recording, "imu.accel")
    inner = slice(2, -2)
    forward = np.cos(pitch) * ax + np.sin(pitch) * (az + 9.80665)
    down = np.sin(pitch) * ax - np.cos(pitch) * (az + 9.80665)
    assert np.abs(accel[inner, 0] - forward[inner]).max() < 0.2 and np.abs(accel[inner, 2] - down[inner]).max() < 0.2
    assert np.all(accel[:, 1] == 0.0) and np.ptp(np.linalg.norm(accel, axis=1)) > 5.0
    assert np.abs(np.gradient(pitch, recording.time) - recording["imu.gyro[1]"])[inner].max() < 0.02


def test_mounting_error_turns_all_three_measurements_alike():
    """Turned back by its attitude, the specific force of a stand is gravity; the rate is that of the pitch."""
    mounting = (0.3, -0.2, 0.5)
    recording = measured(0.2, speed=0.0, variability=0.0, mounting=mounting)
    w, x, y, z = vector(recording, "imu.quaternion", 4)[-1]
    accel = vector(recording, "imu.accel")[-1]
    axis = np.array([x, y, z])
    turned = accel + 2.0 * np.cross(axis, np.cross(axis, accel) + w * accel)
    assert turned == pytest.approx([0.0, 0.0, -9.80665], abs=1e-9)
    straight, turned = (measured(1.0, mounting=each) for each in ((0.0, 0.0, 0.0), mounting))
    lengths = [np.linalg.norm(vector(recording, "imu.gyro"), axis=1) for recording in (straight, turned)]
    assert lengths[0] == pytest.approx(lengths[1], abs=1e-12)


def test_noise_bias_and_drift_are_as_stated():
    ideal = measured(20.0, rate=200)
    noisy = measured(20.0, rate=200, accel_noise=0.05, gyro_noise=0.01, accel_bias=(0.1, 0.0, 0.0), seed=4)
    error = vector(noisy, "imu.accel") - vector(ideal, "imu.accel")
    assert error.mean(axis=0) == pytest.approx([0.1, 0.0, 0.0], abs=0.005)
    assert error.std(axis=0) == pytest.approx([0.05] * 3, rel=0.06)
    assert (vector(noisy, "imu.gyro") - vector(ideal, "imu.gyro")).std(axis=0) == pytest.approx([0.01] * 3, rel=0.06)
    ends = [measured(4.0, rate=100, gyro_drift=0.02, seed=seed)["imu.gyro[0]"][-1] for seed in range(12)]
    assert np.std(ends) == pytest.approx(0.04, rel=0.6)


def test_a_bias_of_two_numbers_is_rejected():
    with Diagram("walk", rate=500), pytest.raises(DiagramError, match="gyro_bias must have three numbers"):
        SegmentIMU(gyro_bias=(0.1, math.pi))


def soles(seconds=4.0, rate=200, **parameters: Any):
    with Diagram("walk", rate=rate) as diagram:
        walker = Walker(name="w", variability=0.0)()
        SoleForce(name="sole", **parameters)(
            walker.left_ground_force, centre_of_pressure=walker.left_centre_of_pressure, phase=walker.left_phase
        )
    recording = run(diagram, round(seconds * rate))
    assert recording.outcome.status == "ok"
    return recording


def test_heel_and_forefoot_share_the_ground_force_about_its_centre():
    recording = soles()
    heel, forefoot, force = (recording[f"sole.{name}"] for name in ("heel", "forefoot", "force"))
    assert heel + forefoot == pytest.approx(force, abs=1e-9)
    assert np.array_equal(force, recording["w.left_ground_force[1]"])
    centre = recording["w.left_centre_of_pressure"]
    between = (force > 100.0) & (centre > 0.15 * 0.258) & (centre < 0.75 * 0.258)
    moment = 0.258 * (0.15 * heel + 0.75 * forefoot)
    assert moment[between] == pytest.approx((centre * force)[between], abs=1e-9)
    assert np.argmax(np.where(recording["w.left_phase"] < 0.1, heel, 0.0)) > 0 and heel.max() > 300.0


def test_forefoot_striker_loads_the_forefoot_first():
    normal, striker = soles(), soles(forefoot_strike=1.0)
    early = (normal["w.left_phase"] < 0.06) & (normal["sole.force"] > 50.0)
    assert np.all(normal["sole.heel"][early] > normal["sole.forefoot"][early])
    assert np.all(striker["sole.forefoot"][early] > striker["sole.heel"][early])
    late = normal["w.left_phase"] > 0.2
    assert np.array_equal(normal["sole.heel"][late], striker["sole.heel"][late])


def test_zero_drift_gain_and_lost_samples_are_as_stated():
    ideal, drifting, lossy = soles(10.0), soles(10.0, zero=20.0, zero_drift=4.0, gain=0.1), soles(10.0, dropped=0.02)
    expected = 0.1 * ideal["sole.force"] + 20.0 + 4.0 * (ideal.time + 0.005)
    assert drifting["sole.force"] == pytest.approx(expected, abs=1e-9)
    loaded = ideal["sole.force"] > 10.0
    assert np.mean(lossy["sole.force"][loaded] == 0.0) == pytest.approx(0.02, abs=0.012)
    noisy = soles(10.0, noise=5.0, seed=7)
    assert (noisy["sole.force"] - ideal["sole.force"]).std() == pytest.approx(5.0, rel=0.06)


def test_dropouts_have_the_stated_share_and_mean_duration():
    with Diagram("stand", rate=200) as diagram:
        SoleForce(name="sole", dropped=0.1, dropout=0.05, zero=-1.0)(ground_force=(0.0, 700.0), centre_of_pressure=0.1)
    lost = run(diagram, 20_000)["sole.force"] == -1.0
    starts = np.flatnonzero(lost[1:] & ~lost[:-1])
    assert lost.mean() == pytest.approx(0.1, abs=0.03)
    assert lost.sum() / len(starts) / 200.0 == pytest.approx(0.05, rel=0.25)
