"""The sample of the design page and the two blocks of the style page, as they stand there."""

import math

import numpy as np
import pytest

from blocks.actuators import CubeMars, EmulatedCubeMars
from blocks.limiters import TorqueLimiter
from blocks.models import Limb
from blocks.wearer import Walker
from graph import Block, Diagram, Input, Output, Param, compile
from tests.cext.rigs import Rig, plant_of


class Impedance(Block):
    """Virtual spring and damper about an equilibrium: τ = K (θ₀ − θ) − B ω.   (Hogan 1985)"""

    stiffness = Param(30.0, "N·m/rad", min=0.0, max=150.0, live=True)
    damping = Param(1.0, "N·m·s/rad", min=0.0, max=10.0, live=True)

    position = Input("rad")
    velocity = Input("rad/s")
    equilibrium = Input("rad", default=0.0)
    torque = Output("N·m")

    def step(self, position, velocity, equilibrium):
        return self.stiffness * (equilibrium - position) - self.damping * velocity


class PeakHold(Block):
    """Largest input since the last reset: y = max(y, u). NaN passes through and is not held."""

    u = Input("any")
    y = Output("any")

    def reset(self):
        self.peak = -math.inf

    def step(self, u):
        if not u <= self.peak:  # NaN fails every comparison and passes
            if u != u:
                return u
            self.peak = u
        return self.peak


def test_peak_hold_passes_nan_and_does_not_store_it():
    hold = PeakHold()
    assert hold.step(1.0) == 1.0 and math.isnan(hold.step(math.nan)) and hold.step(0.5) == 1.0


def test_the_impedance_of_the_style_page_agrees_with_the_native_one():
    from blocks.controllers import Impedance as Native

    page, native = Impedance(stiffness=40.0, damping=2.0), Native(stiffness=40.0, damping=2.0)
    assert page.step(0.1, 0.2, 0.3) == native.step(0.1, 0.2, 0.3) == pytest.approx(7.6, rel=1e-15)


def sample():
    from blocks.actuators import CubeMars
    from blocks.controllers import Impedance
    from blocks.filters import Butterworth
    from blocks.limiters import TorqueLimiter
    from blocks.recorders import CsvRecorder
    from graph import Diagram, subsystem

    with Diagram("knee", rate=200) as diagram:
        with subsystem("left"):
            knee = CubeMars("AK10-9-V2.0", bus="legs", can_id=1, name="knee")
            velocity = Butterworth(order=2, cutoff=20.0)(knee.velocity)
            torque = Impedance(stiffness=30.0, damping=1.0)(position=knee.position, velocity=velocity)
            knee(torque_command=TorqueLimiter(limit=12.0, slew=200.0)(torque))
        CsvRecorder()  # unwired: records every port

    return diagram


def test_the_sample_of_the_design_page_compiles_and_is_proved():
    schedule = compile(sample())
    assert [step.name for step in schedule.output] == ["left/butterworth", "left/impedance", "left/torque_limiter"]
    assert all(proof.holds for proof in schedule.proofs) and schedule.warnings == [] and schedule.buses == ["legs"]
    assert [column.path for column in schedule.sinks[0].columns] == sorted(schedule.signals)
    assert "left/knee.torque_sent" in schedule.signals and schedule.gil_sections == 0


def test_the_sample_of_the_design_page_runs_and_stays_inside_its_limiter():
    robot = sample()
    with Diagram("wearer", rate=1000) as plant:
        drive, limb, walk = EmulatedCubeMars.of(robot["left/knee"]), Limb(), Walker()
        limb(drive.torque, walk.left_knee_angle, walk.left_knee_velocity, walk.left_knee_acceleration)
        drive(limb.position, limb.velocity)
    rig = Rig(robot, plant)
    outcome = rig.run(1000)
    assert outcome.status == "ok" and rig.statistics()["ticks"] == 1000
    step = 2 * 65.0 / 4095  # of the torque on the wire
    assert np.abs(rig["left/torque_limiter.limited"]).max() <= 12.0
    assert np.abs(rig["left/knee.torque_sent"]).max() <= 12.0 + step
    assert np.abs(np.diff(rig["left/torque_limiter.limited"])).max() <= 200.0 / 200 * (1 + 1e-12)
    position, velocity = rig["left/knee.position"], rig["left/butterworth.y"]
    assert rig["left/impedance.torque"] == pytest.approx(-30.0 * position - velocity, abs=1e-9)
    assert 0.5 < np.ptp(position) < 2.0  # a knee that walks bends by about a radian


def test_the_blocks_of_the_style_page_run_in_a_diagram():
    with Diagram("d", rate=200) as diagram:
        knee = CubeMars("AK10-9-V2.0", can_id=1, name="knee")
        torque = Impedance(stiffness=40.0)(knee.position, knee.velocity, 0.2)
        knee(torque_command=TorqueLimiter(limit=5.0)(torque))
        PeakHold(name="peak")(knee.torque_sent)
    rig = Rig(diagram, plant_of(diagram))
    assert rig.run(200).status == "ok"
    before = np.concatenate(([0.0], rig["knee.torque_sent"][:-1]))  # what was sent is known at the end of the tick
    assert rig["peak.y"].tolist() == np.maximum.accumulate(before).tolist() and rig["peak.y"][-1] > 1.0
