"""A robot with a torque profile on each leg, and a signal of the cost of its wearer, who has a hidden optimum."""

from tests.runtime.runs import write

PROFILES = '''
import math

import numpy as np

from blocks.recorders import CsvRecorder
from graph import Block, Diagram, Input, Output, Param, subsystem


class Profile(Block):
    """Parameters of a torque profile."""

    peak = Param(6.0, "N·m", "of the profile", min=0.0, max=12.0, live=True, slew=100.0)
    timing = Param(0.44, "1", "of the peak", min=0.3, max=0.7, live=True, slew=4.0)
    on = Param(True, "1", min=False, max=True, live=True)
    torque = Output("N·m")
    phase = Output("1")

    def step(self):
        return self.peak if self.on else 0.0, self.timing


class Metabolism(Block):
    """Metabolic power of the wearer, a first-order response with noise."""

    noise = Param(0.0, "1")
    seed = Param(1, "1")
    torque = Input("N·m")
    timing = Input("1")
    power = Output("W")

    def reset(self):
        self.source, self.steady = np.random.default_rng(self.seed), 400.0

    def step(self, torque, timing, dt):
        cost = 300.0 + 400.0 * (((torque - 9.0) / 8.0) ** 2 + ((timing - 0.52) / 0.2) ** 2)
        self.steady += ((cost if torque else 380.0) - self.steady) * -math.expm1(-dt / {time_constant})
        return self.steady * (1.0 + self.noise * self.source.standard_normal())


def build(noise=0.0):
    with Diagram("profiles", rate={rate}) as diagram:
        for side in ("left", "right"):
            with subsystem(side):
                profile = Profile(name="profile")()
        Metabolism(noise=noise, name="wearer")(profile.torque, profile.phase)
        CsvRecorder()
    return diagram
'''


def profiles(folder, rate=100, time_constant=0.02):
    """A diagram file. time_constant : of the wearer in s"""
    return write(folder, PROFILES.format(rate=rate, time_constant=time_constant), "profiles.py")
