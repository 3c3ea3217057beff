"""Outputs that blocks keep while they do not run obey their live limits in the tick of the change."""

import math

import numpy as np
import pytest

from blocks.controllers import PID
from blocks.discrete import Integrator
from blocks.limiters import RMSTorqueLimiter, Saturation, TorqueLimiter
from blocks.mathematics import Gain
from blocks.sources import StepSource
from cext.schedule.mailbox_writer import Writer
from graph import Block, Diagram, Input, Live, Output, Param, compile, subsystem
from tests.cext.rigs import Rig
from tests.cext.schedule.test_live import Poster

RATE = 100


class On(Block):
    """True in the first ticks of each 40."""

    share = Param(10, "1", "ticks", min=0, max=40, fixed=True)
    y = Output("1", dtype=bool)

    def step(self, tick):
        return tick % 40 < self.share


class Clip(Block):
    """A limiter in Python. late : tick from which its step raises"""

    held_within = {"y": ("-limit", "limit")}

    limit = Param(8.0, "N·m", "limit", min=0.0)
    late = Param(10**6, "1", "tick", min=0, fixed=True)
    u = Input("N·m")
    y = Output("N·m")

    def step(self, u, tick):
        if tick >= self.late:
            raise ValueError("late")
        return min(max(u, -self.limit), self.limit)


def limit(value=8.0, slew=math.inf):
    return Live(value, min=0.0, max=9.0, slew=slew)


def upper(slew=math.inf):
    return {"lower": -8.0, "upper": Live(8.0, min=0.0, max=9.0, slew=slew)}


LIMITERS = {
    "torque limiter": lambda u: TorqueLimiter(limit=limit(), slew=math.inf, name="last")(u),
    "saturation": lambda u: Saturation(**upper(), name="last")(u),
    "RMS": lambda u: RMSTorqueLimiter(limit=limit(), window=0.1, fade=0.1, name="last")(u),
    "PID": lambda u: PID(kp=100.0, **upper(), unit="N·m", name="last")(u, 0.0),
    "integrator": lambda u: Integrator(method="backward", **upper(), name="last")(Gain(1e4)(u)),
    "Python": lambda u: Clip(limit=limit(), name="last")(u),
}


def rig(make, script):
    """A rig of what `make` wires to a torque of 20 N·m and a switch that is true for 0.1 s of each 0.4 s."""
    with Diagram("held", rate=RATE) as diagram:
        make(StepSource(20.0, 20.0, unit="N·m", name="torque").y, On(name="on").y)
        poster = Poster(name="z_poster")
    found = Rig(diagram)
    poster.script, poster.writer = script, Writer(found.shared)
    return found


def output(found):
    (path,) = (path for path in found.signals if path.rpartition("/")[2].startswith("last.") and "state" not in path)
    return found[path]


@pytest.mark.hazard("H1g")
@pytest.mark.parametrize("name", LIMITERS)
@pytest.mark.parametrize("nested", [False, True])
def test_a_disabled_limiter_follows_its_live_limit_and_fades_on_when_it_is_enabled_again(name, nested):
    def make(torque, enabled):
        with subsystem("assist", enabled=enabled):
            if nested:
                with subsystem("inner", enabled=enabled):
                    LIMITERS[name](torque)
            else:
                LIMITERS[name](torque)

    found = rig(make, {20: lambda writer: writer.set([(0, 2.0)])})
    assert not found.run(60).faulted
    y = output(found)
    held = 8.0 if name != "RMS" else y[9]
    assert held > 4.0 and np.all(y[9:21] == held) and np.all(y[21:40] == 2.0)
    assert np.all(y[40:50] <= 2.0 + 1e-12) and (y[49] == pytest.approx(2.0) or name == "RMS")


def test_a_limit_that_is_lowered_and_raised_again_raises_nothing_at_once():
    """The torque limiter begins at the torque that was held, and rises with its slew."""

    def make(torque, enabled):
        with subsystem("assist", enabled=enabled):
            TorqueLimiter(limit=limit(), slew=100.0, name="last")(torque)

    found = rig(make, {20: lambda writer: writer.set([(0, 2.0)]), 30: lambda writer: writer.set([(0, 8.0)])})
    found.run(60)
    y = output(found)
    assert y[10] == 8.0 and np.all(y[21:40] == 2.0)
    np.testing.assert_allclose(y[40:46], [3.0, 4.0, 5.0, 6.0, 7.0, 8.0], rtol=0, atol=1e-12)


def test_a_ramp_of_the_limit_lowers_the_held_torque_tick_by_tick():
    def make(torque, enabled):
        with subsystem("assist", enabled=enabled):
            TorqueLimiter(limit=limit(slew=50.0), slew=math.inf, name="last")(torque)

    found = rig(make, {20: lambda writer: writer.set([(0, 2.0)])})
    found.run(40)
    np.testing.assert_allclose(output(found)[20:34], [8.0, *np.arange(7.5, 1.9, -0.5), 2.0], rtol=0, atol=1e-12)


def test_an_output_that_never_ran_stays_zero_and_nothing_moves_away_from_zero():
    def make(torque, enabled):
        with subsystem("assist", enabled=On(share=0, name="never").y):
            Saturation(lower=Live(-1.0, min=-9.0, max=9.0, slew=math.inf), upper=9.0, name="last")(torque)

    found = rig(make, {20: lambda writer: writer.set([(0, 5.0)])})
    found.run(40)
    assert not output(found).any()


@pytest.mark.parametrize("how", ["every", "exceptions"])
def test_a_slow_limiter_and_one_whose_exceptions_are_held_follow_the_limit(how):
    def make(torque, enabled):
        options = {"every": 40} if how == "every" else {"late": 5, "hold_exceptions": 100}
        Clip(limit=limit(), name="last", **options)(torque)

    found = rig(make, {20: lambda writer: writer.set([(0, 2.0)])})
    assert not found.run(39).faulted
    y = output(found)
    assert np.all(y[:21] == 8.0) and np.all(y[21:] == 2.0)


def test_check_names_the_live_parameters_that_wait_until_the_subsystem_is_enabled():
    from blocks.actuators import CubeMars

    with Diagram("d", rate=RATE) as diagram:
        with subsystem("assist", enabled=StepSource(name="on")()):
            law = Gain(Live(1.0, min=0.0, max=2.0), unit="N·m", name="law")(1.0)
            torque = TorqueLimiter(limit=Live(5.0, min=0.0, max=9.0), name="limiter")(law)
        CubeMars("AK80-9", name="knee")(torque_command=torque)
    (warning,) = [warning for warning in compile(diagram).warnings if warning.code == "TW021"]
    assert warning.message == (
        "assist/limiter.limited keeps its last value while on.y is false; live changes of assist/law.gain take effect "
        "when it is true again"
    )
