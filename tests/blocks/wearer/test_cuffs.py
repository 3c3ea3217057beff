"""Cuff of a robot on a limb: its force is that of the drive, on the load cells of a robot too."""

from typing import Any

import numpy as np
import pytest

from blocks.actuators import CubeMars
from blocks.sensors import ADS1115, NAU7802, LoadCell, Microcontroller
from blocks.sources import Sine
from blocks.wearer import Cuff, Walker
from graph import Diagram
from tests.blocks.running import player, run

STIFFNESS = 4500.0 * 0.3**2  # N·m/rad


def pressed(torque, rate=1000, **parameters: Any):
    torque = np.asarray(torque)
    with Diagram("cuff", rate=rate) as diagram:
        angle, velocity = (player(np.full(len(torque), value), unit) for value, unit in ((0.5, "rad"), (0.1, "rad/s")))
        Cuff(name="cuff", **parameters)(torque=player(torque, "N·m"), angle=angle, velocity=velocity)
    recording = run(diagram, len(torque))
    assert recording.outcome.status == "ok"
    return recording


def test_tissue_yields_by_the_force_over_its_stiffness_with_the_relaxation_time():
    recording = pressed([6.0] * 300)
    ahead = recording["cuff.position"] - 0.5
    assert ahead == pytest.approx(6.0 / STIFFNESS * (1.0 - np.exp(-recording.time / 0.02)), abs=1e-12)
    assert recording["cuff.speed"][1:] - 0.1 == pytest.approx(np.diff(ahead) * 1000.0, abs=1e-9)
    assert recording["cuff.force"][1:] == pytest.approx(np.full(299, 20.0))


def test_measured_force_has_gain_zero_drift_and_noise():
    ideal, noisy = pressed([6.0] * 4000), pressed([6.0] * 4000, gain=0.9, zero=3.0, zero_drift=0.5, noise=0.4)
    error = noisy["cuff.measured"] - (0.9 * ideal["cuff.force"] + 3.0 + 0.5 * ideal.time)
    assert error.mean() == pytest.approx(0.0, abs=0.02) and error.std() == pytest.approx(0.4, rel=0.05)
    assert np.array_equal(ideal["cuff.measured"], ideal["cuff.force"])


def test_load_cells_of_every_device_measure_the_torque_of_the_drive_over_the_lever():
    """Byte for byte: a drive, an NAU7802, an ADS1115 and a microcontroller with an HX711, on a walking adult."""
    with Diagram("ankle", rate=200) as robot:
        drive = CubeMars("AK80-9", bus="legs", name="ankle")
        drive(torque_command=Sine(amplitude=6.0, frequency=1.0, unit="N·m")())
        NAU7802(name="amplifier", bus="chips", rate=320, capacity=200.0, tare_at_start=False)
        volts = ADS1115(name="converter", bus="chips", channels=("a0",))
        teensy = Microcontroller((("load", "int32"),), packet_rate=200.0, name="teensy")
        LoadCell(name="on_converter", capacity=200.0, at_capacity=1.0, tare_at_start=False)(volts.a0)
        LoadCell(name="on_teensy", capacity=200.0, at_capacity=1.2e6, tare_at_start=False)(teensy.load)
    with Diagram("wearer", rate=1000) as plant:
        adult = Walker(1.2, variability=0.0)
        motion, cuff, ankle = adult(), Cuff(lever=0.3), robot["ankle"].emulator()
        contact = cuff(angle=motion.left_ankle_angle, velocity=motion.left_ankle_velocity)
        ankle(position=contact.position, velocity=contact.speed)
        cuff(torque=ankle.torque)
        adult(left_ankle_assistance=ankle.torque)
        robot["amplifier"].emulator()(force=contact.measured)
        robot["converter"].emulator()(a0=robot["on_converter"].emulator()(contact.measured))
        robot["teensy"].emulator()(load=robot["on_teensy"].emulator()(contact.measured))
    recording = run(robot, 800, plant=plant, substeps=5)
    assert recording.outcome.status == "ok"
    torque = recording["ankle.torque"]
    assert np.ptp(torque) > 11.0
    expected = torque[100:] / 0.3
    for name in ("amplifier.force", "on_converter.force", "on_teensy.force"):
        assert recording[name][100:] == pytest.approx(expected, abs=2.5), name  # 20 ms of the sine
