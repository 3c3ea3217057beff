"""The sample of the design page and the two blocks of the style page, as they stand there."""

import math

import pytest

from graph import Block, Input, Output, Param, compile


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
        if not u <= self.peak:              # NaN fails every comparison and passes
            if u != u:
                return u
            self.peak = u
        return self.peak


def test_peak_hold_lets_nan_pass_and_forgets_it():
    hold = PeakHold()
    assert hold.step(1.0) == 1.0 and math.isnan(hold.step(math.nan)) and hold.step(0.5) == 1.0


def test_the_impedance_of_the_style_page_agrees_with_the_native_one():
    from blocks.controllers import Impedance as Native

    page, native = Impedance(stiffness=40.0, damping=2.0), Native(stiffness=40.0, damping=2.0)
    assert page.step(0.1, 0.2, 0.3) == native.step(0.1, 0.2, 0.3) == pytest.approx(7.6, rel=1e-15)


def test_the_sample_of_the_design_page_compiles_and_is_proved():
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
        CsvRecorder()                                     # unwired: records every port

    schedule = compile(diagram)
    assert [step.name for step in schedule.output] == ["left/butterworth", "left/impedance", "left/torque_limiter"]
    assert all(proof.holds for proof in schedule.proofs) and schedule.warnings == [] and schedule.buses == ["legs"]
    assert [column.path for column in schedule.sinks[0].columns] == sorted(schedule.signals)
    assert "left/knee.torque_sent" in schedule.signals and schedule.gil_sections == 0
