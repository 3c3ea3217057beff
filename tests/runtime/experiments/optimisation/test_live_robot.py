"""Changes of the live parameters of a run that an optimisation makes."""

import pytest

from graph import compile
from runtime.experiments.optimisation.live_robot import Targets
from runtime.experiments.optimisation.parameters import Parameter
from runtime.host.live.table import describe, parse
from runtime.robot.loading.file import load
from tests.runtime.experiments.optimisation.diagrams import profiles

PEAK = Parameter("profile.peak", 0.0, 12.0, largest_step=3.0)


class Run:
    """Live parameters of the diagram of profiles."""

    def __init__(self, folder, zero):
        self.table = parse(describe(compile(load(profiles(folder))[1]))[1])
        self.targets = Targets(self.table, [PEAK], zero)
        self.values = {live.path: live.built for live in self.table.parameters}

    def change(self, peak, zero=False):
        """Apply a change at once. Returns the peaks of both legs, and whether they are the requested ones."""
        changes, complete = self.targets.changes({"profile.peak": peak}, zero, lambda live: self.values[live.path])
        self.values |= {live.path: value for live, value in changes}
        return self.values["left/profile.peak"], self.values["right/profile.peak"], complete


@pytest.mark.hazard("H16b")
def test_each_leg_changes_by_largest_step_from_its_own_value(tmp_path):
    run = Run(tmp_path, [])
    run.values["left/profile.peak"] = 0.0  # with a key; the other leg has 6 N·m
    assert run.change(9.0) == (3.0, 9.0, False)
    assert run.change(9.0) == (6.0, 9.0, False)
    assert run.change(9.0) == (9.0, 9.0, True)


@pytest.mark.hazard("H16b")
def test_assistance_is_switched_off_and_on_by_largest_steps(tmp_path):
    run = Run(tmp_path, [("*/profile.peak", "0"), ("*/profile.on", "false")])
    assert run.change(6.0, zero=True) == (3.0, 3.0, False)
    assert run.change(6.0, zero=True) == (0.0, 0.0, True)
    assert run.values["left/profile.on"] == 0.0
    assert run.change(9.0) == (3.0, 3.0, False)
    assert run.values["left/profile.on"] == 1.0
    assert run.change(9.0) == (6.0, 6.0, False)
    assert run.change(9.0) == (9.0, 9.0, True)
