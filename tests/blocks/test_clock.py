"""The clock as signals: nominal time, wake-up, lateness and the time since the tick before, also where ticks are
missed.
"""

import time

import pytest

from blocks.clock import Clock
from graph import Block, Diagram, Output
from tests.cext.rigs import Rig

RATE = 100


class Holds(Block):
    """Holds the loop once."""

    y = Output("1")

    def step(self, tick):
        if tick == 5:
            end = time.monotonic() + 0.035
            while time.monotonic() < end:
                pass
        return 0.0


def run(virtual, ticks=20):
    with Diagram("d", rate=RATE) as diagram:
        Clock(name="clock")
        Clock(every=4, name="slow")
        Holds()
    rig = Rig(diagram, virtual=virtual)
    assert rig.run(ticks).status == "ok"
    return rig


def test_in_virtual_time_the_clock_is_the_grid():
    rig = run(virtual=True)
    assert rig["clock.time"].tolist() == rig["clock.wake"].tolist() == [tick / RATE for tick in range(20)]
    assert set(rig["clock.lateness"]) == {0.0} and rig["clock.elapsed"] == pytest.approx([1 / RATE] * 20)
    assert rig["slow.elapsed"] == pytest.approx([4 / RATE] * 20)


def test_real_time_clock_reports_late_and_missed_ticks():
    rig = run(virtual=False)
    ticks = rig.tick.tolist()
    assert rig["clock.time"].tolist() == [tick / RATE for tick in ticks]
    assert rig["clock.elapsed"] == pytest.approx(
        [(now - before) / RATE for before, now in zip([-1, *ticks], ticks)], rel=1e-12
    )
    assert max(rig["clock.elapsed"]) >= 3 / RATE
    assert rig["clock.wake"] == pytest.approx(rig["clock.time"] + rig["clock.lateness"], abs=1e-15)
    assert all(0.0 <= late < 1 / RATE for late in rig["clock.lateness"])
    awaited = [before + 1 for before in [-1, *ticks[:-1]]]  # statistics count from the grid point that was awaited
    behind = [wake - tick / RATE for wake, tick in zip(rig["clock.wake"], awaited)]
    assert max(behind) == pytest.approx(rig.statistics()["lateness"]["max"], abs=1e-9)


def test_clock_called_directly_returns_first_tick():
    clock = Clock()
    clock.dt = 0.005
    assert clock.step()[2] == 0.0
