"""A live change is no step unless it is asked to be: every live number ramps."""

import math
import sys

import numpy as np
import pytest

from blocks.controllers import Impedance
from blocks.limiters import TorqueLimiter
from blocks.sources import Constant
from cext.schedule.mailbox_writer import Writer
from graph import Block, Diagram, Live, Param
from tests.cext.rigs import Rig, one_drive
from tests.cext.schedule.test_live import Poster

RATE = 200


class Settings(Block):
    """A live parameter of each kind."""

    share = Param(0.5, "1", min=0.25, max=1.0, live=True)
    count = Param(3, "1", min=0, max=9, live=True)
    on = Param(True, "1", min=False, max=True, live=True)
    quick = Param(0.5, "1", min=0.0, max=1.0, live=True, slew=math.inf)
    wide = Param(0.0, "1", min=-sys.float_info.max, max=sys.float_info.max, live=True)
    still = Param(1.0, "1", min=1.0, max=1.0, live=True)
    mass = Param(70.0, "kg", min=0.0)

    def step(self):
        pass


def test_live_numbers_ramp_over_their_range_in_a_second_and_others_step():
    settings = Settings()
    assert {name: settings.live(name).slew for name in ("share", "count", "on", "quick", "still")} == {
        "share": 0.75,
        "count": math.inf,
        "on": math.inf,
        "quick": math.inf,
        "still": math.inf,
    }
    assert settings.live("wide").slew == sys.float_info.max, "no range is so wide that it steps"
    assert Settings(mass=Live(70.0, min=50.0, max=90.0)).live("mass").slew == 40.0
    assert Settings(mass=Live(70.0, max=90.0, slew=math.inf)).live("mass").slew == math.inf


def test_a_live_parameter_has_finite_bounds():
    with pytest.raises(TypeError, match="a live parameter needs both bounds, min and max, both finite"):
        Param(1.0, "1", min=0.0, max=math.inf, live=True)


def live_rig(make, letters):
    """A rig on a drive whose torque `make` gives, and the letters to post in each tick."""
    poster = []

    def law(drive):
        poster.append(Poster(name="z_poster"))
        return make(drive)

    rig = one_drive(law)
    poster[0].script, poster[0].writer = letters, Writer(rig.shared)
    return rig


@pytest.mark.hazard("H3b")
def test_changing_the_stiffness_of_a_deflected_spring_makes_no_torque_step():
    """It goes from 30 to 150 N·m/rad by 0.75 a tick: over a deflection of 0.06 rad by 0.045 N·m a tick, and not by 7
    N·m at once.
    """

    def spring(drive):
        torque = Impedance(stiffness=Live(30.0, min=0.0, max=150.0), name="impedance")(
            position=0.0, velocity=0.0, equilibrium=0.06
        )
        return TorqueLimiter(limit=9.0, slew=math.inf, name="limiter")(torque)

    rig = live_rig(spring, {20: lambda writer: writer.set([(0, 150.0)])})
    assert rig.run(200, fade=0.0).status == "ok"
    torque = rig["impedance.torque"]
    np.testing.assert_allclose(np.diff(torque[20:180]), 0.06 * 150.0 / RATE, rtol=0, atol=1e-12)
    assert torque[20] == pytest.approx(1.8) and torque[199] == pytest.approx(9.0)


def test_a_live_constant_crosses_its_range_in_a_second():
    rig = live_rig(
        lambda drive: TorqueLimiter(limit=9.0, slew=math.inf)(
            Constant(Live(8.0, min=-8.0, max=8.0), unit="N·m", name="push")()
        ),
        {20: lambda writer: writer.set([(0, -8.0)])},
    )
    assert rig.run(240, fade=0.0).status == "ok"
    push = rig["push.y"]
    np.testing.assert_allclose(np.diff(push[20:220]), -16.0 / RATE, rtol=0, atol=1e-12)
    assert push[20] == 8.0 and push[-1] == -8.0


def test_a_script_ramps_with_the_slew_that_was_recorded():
    """A recording of a diagram whose change was a step, or another ramp, is repeated as it was."""
    with Diagram("live", rate=RATE) as diagram:
        Constant(Live(0.0, min=0.0, max=1.0), name="value")()
    rig = Rig(diagram)
    rig.control.live.follow([(3, 0, 1.0, math.inf), (6, 0, 0.0, 20.0)])
    rig.run(20)
    np.testing.assert_allclose(rig["value.y"][:9], [0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.9, 0.8, 0.7], rtol=0, atol=1e-12)
    assert [change.slew for change in rig.changes] == [math.inf, 20.0]
