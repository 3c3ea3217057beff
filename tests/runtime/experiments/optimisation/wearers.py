"""A wearer with a hidden optimum, in virtual time: parameters ramp, and breaths follow with 42 s."""

import math

import numpy as np

from runtime.experiments.optimisation.cart import Cart
from runtime.experiments.optimisation.costs import CartCost
from runtime.experiments.optimisation.optimisers import Random, make_optimiser
from runtime.experiments.optimisation.parameters import Parameter, within_step
from runtime.experiments.optimisation.protocol import Protocol, Refused, Robot, Settings

PARAMETERS = [Parameter("peak", 4.0, 12.0, initial=6.0), Parameter("timing", 0.40, 0.60, initial=0.44)]
OPTIMUM = {"peak": 9.0, "timing": 0.52, "rise": 0.30, "fall": 0.13}
PROFILE = [*PARAMETERS, Parameter("rise", 0.10, 0.40, initial=0.20), Parameter("fall", 0.05, 0.20, initial=0.10)]
LOWEST, INITIAL, ZERO = 300.0, 420.25, 380.0  # W: at the optimum, with the initial values, without assistance
PENALTY = 400.0  # W at a distance of the whole range
BREATH = 3.0  # s


class Wearer(Robot):
    """Robot and wearer. `breathe` returns the next breaths as lines of a cart."""

    def __init__(self, noise=0.0, seed=0, slew=1.0, parameters=PARAMETERS):
        self.parameters = parameters
        self.time, self.running, self.zero, self.slew = 0.0, True, False, slew
        self.values, self.targets, self.applied = {}, {}, {}
        self.power, self.breath, self.source, self.noise = 350.0, BREATH, np.random.default_rng(seed), noise
        self.rejects = self.silent = False
        self.lines, self.history = b"", []

    def hold(self, values):
        """Have values from now on, which another process has set."""
        self.values |= values
        self.targets |= values

    @property
    def tick(self):
        return round(self.time * 100)

    def apply(self, values, zero):
        if self.rejects:
            raise Refused("the run rejected peak: out of bounds")
        present = {each.name: self.values.get(each.name, each.low) for each in self.parameters}
        stage = within_step(self.parameters, present, values)
        self.history.append(stage)
        self.applied, self.targets, self.zero = dict(stage), dict(stage), zero
        return stage == values

    def has_arrived(self):
        return self.values == self.applied

    def interference(self):
        return next((f"left/{name}" for name, value in self.applied.items() if self.targets[name] != value), None)

    def cost(self):
        if self.zero:
            return ZERO
        scaled = [
            (self.values.get(each.name, each.low) - OPTIMUM[each.name]) / (each.high - each.low)
            for each in self.parameters
        ]
        return LOWEST + PENALTY * sum(each**2 for each in scaled)

    def advance(self, seconds):
        self.time += seconds
        for each in self.parameters:
            target = self.targets.get(each.name, each.low)
            present, step = self.values.get(each.name, each.low), self.slew * (each.high - each.low) * seconds
            self.values[each.name] = (
                target if abs(target - present) <= step else present + math.copysign(step, target - present)
            )
        self.power += (self.cost() - self.power) * -math.expm1(-seconds / 42.0)
        if self.time >= self.breath:
            self.breath += BREATH
            if not self.silent:
                watts = self.power * (1.0 + self.noise * self.source.standard_normal())
                self.lines += f"{self.time}\t{watts}\n".encode()

    def read(self):
        data, self.lines = self.lines, b""
        return data


class Experiment:
    """Protocol with a wearer, and what it has reported."""

    def __init__(self, optimiser=None, wearer=None, cost=None, accepted=None, validated=None, **settings):
        self.wearer = wearer or Wearer()
        self.optimiser = optimiser or Random(self.wearer.parameters, seed=3)
        self.wearer.parameters = self.optimiser.parameters
        self.events, self.saved = [], 0
        given = {"evaluations": 3, "settle": 30.0, "measure": 120.0, "confirm": False, **settings}
        cost = cost or CartCost(Cart(self.wearer.read, "metabolic.tsv"), 42.0)
        self.protocol = Protocol(
            self.optimiser, self.wearer, cost, Settings(**given), self.report, self.save, accepted, validated
        )

    def report(self, step, lines, **fields):
        self.events.append({"step": step, "lines": lines, "time": self.wearer.time, **fields})

    def save(self):
        self.saved += 1

    def run(self, seconds=1e5, until=lambda: False):
        """Advance until the end, a condition, or a time in s."""
        last = self.wearer.time + seconds
        while self.wearer.time < last and not until() and not self.protocol.step(self.wearer.time):
            self.wearer.advance(0.5)
        return self

    def press(self, key):
        self.protocol.press(key)
        self.run(0.5)

    def steps(self, *names):
        return [event["step"] for event in self.events if not names or event["step"] in names]

    def last(self, step):
        return next(event for event in reversed(self.events) if event["step"] == step)


def cma(seed, parameters=PARAMETERS, population=6):
    return make_optimiser("cma", parameters, seed=seed, population=population)
