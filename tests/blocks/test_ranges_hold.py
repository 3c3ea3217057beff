"""No block leaves the range it states: inputs from anywhere in their intervals, huge and subnormal ones, infinities and
NaN too.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blocks.controllers import PD, PI, PID, Admittance, FeedForward, GravityCompensation, P
from blocks.discrete import Delay, Derivative, Integrator
from blocks.filters import Butterworth, Complementary, Exponential, Median, Notch
from blocks.limiters import DeadZone, PowerLimiter, RMSTorqueLimiter, SoftStart, SoftStop, TemperatureDerating
from blocks.linear import BiquadCascade, StateSpace, TransferFunction
from blocks.thermal import ThermalModel
from blocks.windows import MovingAverage, MovingMaximum, MovingMinimum, MovingRMS
from tests.blocks.playing import made
from tests.blocks.proofs import keeps_its_range

MAKE = {
    "low-pass": lambda: Butterworth(3, 20.0),
    "high-pass": lambda: Butterworth(2, 1.0, "highpass"),
    "notch": lambda: Notch(50.0, 3.0),
    "band-pass": lambda: Butterworth(2, (3.0, 9.0), "bandpass"),
    "exponential": lambda: Exponential(0.1),
    "median": lambda: Median(5),
    "complementary": lambda: Complementary(0.3),
    "cascade": lambda: BiquadCascade(((1.0, 2.0, 1.0, 2.0, 0.0, 0.5), (1.0, 0.0, 0.0, 1.0, -0.9, 0.0))),
    "delay": lambda: Delay(3, 2.0),
    "derivative": lambda: Derivative(0.01),
    "difference": Derivative,
    "integral": lambda: Integrator(1.0, -3.0, 4.0),
    "free integral": lambda: Integrator(method="trapezoidal"),
    "transfer function": lambda: TransferFunction((1.0, -0.5), (1.0, -1.2, 0.5)),
    "lead": lambda: TransferFunction((0.2, 1.0), (0.01, 1.0), "s"),
    "state space": lambda: StateSpace(
        ((0.9, 0.3), (-0.3, 0.7)), ((0.0,), (1.0,)), ((1.0, 0.0), (0.0, 9.0)), start=(1.0, -1.0)
    ),
    "average": lambda: MovingAverage(0.03),
    "rms": lambda: MovingRMS(0.03),
    "maximum": lambda: MovingMaximum(0.03),
    "minimum": lambda: MovingMinimum(0.03),
    "P": lambda: P(-3.0),
    "PI": lambda: PI(2.0, 9.0, lower=-4.0, upper=5.0),
    "PD": lambda: PD(2.0, 0.3, 0.01, 0.8, 0.2),
    "PID": lambda: PID(2.0, 9.0, 0.1, 0.01, lower=-4.0, upper=5.0, anti_windup="back-calculation"),
    "admittance": Admittance,
    "feed-forward": lambda: FeedForward(0.3, 0.5, 2.0),
    "gravity": GravityCompensation,
    "dead zone": DeadZone,
    "power": lambda: PowerLimiter(30.0),
    "soft stop": SoftStop,
    "rms torque": lambda: RMSTorqueLimiter(4.0, 0.05, 0.01),
    "derating": TemperatureDerating,
    "soft start": lambda: SoftStart(0.04),
    "thermal": lambda: ThermalModel(rated=9.0),
    "cold thermal": lambda: ThermalModel(loss=0.1, start=-30.0),
}


@pytest.mark.parametrize("name", MAKE)
@given(data=st.data())
def test_no_output_leaves_its_range(name, data):
    with np.errstate(all="ignore"):
        keeps_its_range(data, made(MAKE[name]), nan=True, ticks=12)
