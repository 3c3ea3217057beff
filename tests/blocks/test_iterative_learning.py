"""Iterative learning: its convergence against the closed form, what teaches nothing, and a drive with friction."""

import cmath
import math

import numpy as np
import pytest

import runtime
from blocks.actuators import CubeMars
from blocks.controllers import GaitPhase, IterativeLearning
from blocks.gait import PeakProfile
from blocks.limiters import TorqueLimiter
from blocks.mathematics import Gain
from blocks.sensors import NAU7802
from blocks.wearer import Walker
from graph import Block, Diagram, Input, Output

DT, TICKS = 0.005, 200  # s, and ticks of a stride
GAIN, POLE, DELAY = 0.8, 0.9, 6  # of the plant: a first-order filter after a delay of 6 ticks
STRIDE = np.arange(TICKS) / TICKS  # phases
HOLD = {"learning": False}


class Loop:
    """A learning block, a linear plant, and the reference over the phase."""

    def __init__(self, reference=lambda phase: 1.0, **parameters):
        self.block = IterativeLearning(**parameters)
        self.block.dt = DT
        self.reference, self.held, self.y = reference, [0.0] * DELAY, 0.0

    def run(self, phases=STRIDE, at=None, **given):
        """Returns errors, commands, and the other outputs in the first tick, which ends the stride before.

        given : inputs that differ, in all ticks or in tick `at`
        """
        errors, commands, ended = [], [], ()
        for tick, phase in enumerate(phases):
            inputs = {"phase": phase, "reference": self.reference(phase), "measurement": self.y}
            errors.append(inputs["reference"] - self.y)
            command, *others = self.block.step(**inputs | (given if at in (None, tick) else {}))
            commands.append(command)
            ended = ended or others
            self.held.append(0.0 if math.isnan(command) else command)
            self.y = POLE * self.y + (1.0 - POLE) * GAIN * self.held.pop(0)
        return np.array(errors), np.array(commands), ended


def waves(phase):
    return 1.0 + sum(math.cos(2.0 * math.pi * h * (phase - 0.1)) / h for h in (1, 2, 3, 5, 9))


@pytest.mark.parametrize("lead, forgetting", [(0.0, 0.0), (0.08, 0.0), (0.08, 0.05)])
def test_the_error_at_each_harmonic_follows_the_closed_form(lead, forgetting):
    """Every third stride teaches: the plant is then in its periodic state, where the closed form is exact."""
    gain, found = 0.6, []
    loop = Loop(waves, gain=gain, lead=lead, forgetting=forgetting, harmonics=5, limit=100.0)
    for _ in range(3):
        loop.run(**HOLD)
    for number in range(5):
        errors, *_ = loop.run()
        *_, (strides, rms) = loop.run(**HOLD)
        loop.run(**HOLD)
        assert strides == number + 1 and rms == pytest.approx(np.sqrt(np.mean(errors**2)), rel=1e-9)
        found.append(np.fft.fft(errors) / TICKS)
    reference = np.fft.fft([waves(phase) for phase in STRIDE]) / TICKS
    for h in range(10):
        z = cmath.exp(2j * math.pi * h / TICKS)
        plant = GAIN * (1.0 - POLE) / (1.0 - POLE / z) * z ** -(DELAY + 1)
        factor = 1.0 - forgetting - gain * plant * z ** (lead / DT)
        for before, after in zip(found, found[1:]):
            expected = forgetting * reference[h] + factor * before[h] if h <= 5 else before[h]
            assert abs(after[h] - expected) < 1e-9
    assert (abs(found[-1][5]) < abs(found[0][5])) == (lead > 0.0)  # the delay makes it grow without a lead


THERE_AND_BACK = np.interp(np.arange(TICKS) / TICKS, (0.0, 0.4, 0.6, 1.0), (0.0, 0.5, 0.3, 1.0))
NOTHING = {
    "held": {"at": 50, **HOLD},
    "disabled": {"at": 50, "enable": False},
    "no phase": {"at": 50, "phase": math.nan},
    "no measurement": {"at": 50, "measurement": math.nan},
    "infinite measurement": {"at": 50, "measurement": math.inf},
    "jump": {"phases": STRIDE + 0.2 * ((STRIDE > 0.3) & (STRIDE < 0.6))},
    "stop": {"phases": np.append(STRIDE[:70], [STRIDE[70]] * 300 + [*STRIDE[71:]])},
    "stumble": {"phases": np.arange(150) / 150},
    "backward": {"phases": THERE_AND_BACK},
}


@pytest.mark.parametrize("case", NOTHING)
def test_a_stride_that_is_not_as_usual_teaches_nothing(case):
    loop = Loop(waves)
    for _ in range(5):
        loop.run()
    _, before, (strides, _) = loop.run()
    loop.run(**NOTHING[case])
    _, after, ended = loop.run(**HOLD)
    _, kept, _ = loop.run()
    assert ended[0] == strides + 1 and np.array_equal(after, kept) and not np.array_equal(after, before)
    *_, (resumed, _) = loop.run()
    assert resumed == strides + 2


def test_the_command_stays_within_its_limit_without_windup_and_is_zero_while_disabled():
    loop = Loop(gain=0.5, harmonics=3, limit=5.0)
    for _ in range(40):
        _, commands, _ = loop.run(measurement=-1.0)
    assert np.abs(commands - 5.0).max() < 1e-9 and commands.max() <= 5.0
    loop.run(measurement=2.0)
    _, commands, _ = loop.run(measurement=2.0)
    assert np.abs(commands - 4.5).max() < 0.1  # the tick at phase 0 belongs to both strides
    _, commands, _ = loop.run(enable=False)
    assert np.all(commands == 0.0)


@pytest.mark.parametrize("harmonics", [3, 8, 64])
def test_a_reference_beyond_the_limit_winds_no_harmonic_up(harmonics):
    def peak(phase):
        return math.exp(-(((phase - 0.5) / 0.05) ** 2))

    loop = Loop(lambda phase: 12.0 * peak(phase), gain=0.3, lead=0.05, harmonics=harmonics, limit=5.0)
    for _ in range(100):
        _, commands, _ = loop.run()
    assert commands.max() > 4.9
    loop.reference = lambda phase: 2.0 * peak(phase)
    for _ in range(8):
        _, commands, _ = loop.run()
    assert commands.max() < 4.0


def test_a_jump_across_phase_0_teaches_nothing_in_both_strides():
    loop = Loop(waves)
    for _ in range(5):
        loop.run()
    *_, (strides, _) = loop.run()
    loop.run(STRIDE[:180])
    *_, (torn, _) = loop.run(STRIDE[24:])
    *_, (short, _) = loop.run()
    assert torn == short == strides + 1


def test_a_harmonic_of_two_ticks_or_fewer_does_not_teach_a_lower_one_again():
    """In 50 ticks, the harmonics 36 and 64 are harmonic 14: three times the gain would diverge."""
    block = IterativeLearning(gain=0.5, harmonics=64, limit=50.0)
    block.dt, command = 0.02, np.zeros(50)
    for _ in range(60):
        for tick in range(50):
            error = math.cos(14 * math.tau * tick / 50) - command[tick]
            command[tick], strides, rms = block.step(phase=tick / 50, reference=error, measurement=0.0)
    assert strides > 50 and rms < 1e-6


class Friction(Block):
    """Coulomb friction of a drive."""

    velocity = Input("rad/s")
    torque = Output("N·m")

    def step(self, velocity):
        return -2.0 * math.tanh(velocity / 0.2)


def test_a_drive_with_friction_tracks_better_from_stride_to_stride_and_learns_nothing_from_a_stop():
    """At the knee of the simulated wearer, who walks, stops and walks on."""
    with Diagram("knee", rate=200) as robot:
        knee = CubeMars("AK10-9-V2.0", bus="legs", name="knee")
        gait = GaitPhase(name="gait")(angle=knee.position, velocity=knee.velocity)
        wanted = PeakProfile(6.0, name="wanted")(gait.phase, gait.walking)
        cell = NAU7802(bus="cells", rate=320, capacity=200.0, timeout=0.1, name="cell")  # with a lever of 0.2 m
        learned = IterativeLearning(lead=0.01, harmonics=12, name="learned")(
            gait.phase, wanted, Gain(0.2, unit="m", name="measured")(cell.force), enable=gait.walking
        )
        knee(torque_command=TorqueLimiter(limit=15.0)(wanted + learned.command))
    with Diagram("adult", rate=1000) as plant:
        walker = Walker("0:0 1:0 2:1.2 30:1.2 31:0 36:0 37:1.2")
        adult = walker()
        drive = robot["knee"].emulator(name="knee")(adult.left_knee_angle, adult.left_knee_velocity)
        torque = drive.torque + Friction(name="friction")(adult.left_knee_velocity)
        walker(left_knee_assistance=torque)
        robot["cell"].emulator(name="cell")(force=Gain(5.0, unit="1/m", name="lever")(torque))
    trial = runtime.run(robot, duration=50.0, plant=plant)
    strides, errors = trial["learned.strides"], trial["learned.rms_error"]
    by_stride = [errors[np.argmax(strides == number)] for number in range(1, 23)]
    assert trial.fault is None and by_stride[0] > 1.5 and np.mean(by_stride[7:]) < by_stride[0] / 4.0
    standing = (trial.time > 32.5) & (trial.time < 36.5)
    assert 15 < strides[standing][0] == strides[standing][-1] < strides[-1]
    assert np.all(trial["learned.command"][standing] == 0.0)
