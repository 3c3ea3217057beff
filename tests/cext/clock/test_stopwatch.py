"""Where the time of a tick goes: histograms, the GIL taken no more than needed, the profile of every block, and the
window to spin in.
"""

import sys

import pytest

from blocks.actuators import CubeMars
from blocks.discrete import UnitDelay
from blocks.filters import Butterworth
from blocks.limiters import TorqueLimiter
from blocks.mathematics import Gain
from graph import Block, Diagram, Input, Output
from tests.cext.rigs import Rig, one_drive, plant_of

pytestmark = pytest.mark.timing

RATE = 200


class Passes(Block):
    """Python that does next to nothing."""

    u = Input("any")
    y = Output("any")

    def step(self, u):
        return u


class Remembers(Block):
    """Python with an update."""

    u = Input("any")
    y = Output("any")

    def reset(self):
        self.held = 0.0

    def step(self):
        return self.held

    def update(self, u):
        self.held = u


def two_chains():
    """Two chains of native, Python, native, which one hold of the GIL can serve."""
    for name in "ab":
        Gain(2.0, name=f"{name}3")(Passes(name=f"{name}2")(Gain(2.0, name=f"{name}1")(1.0)))


def a_native_block_between():
    Passes(name="c")(Gain(2.0, name="b")(Passes(name="a")(1.0)))


def neighbours_of_other_rates():
    Passes(name="c", every=4)(Passes(name="b", every=2)(Passes(name="a")(1.0)))


def step_and_update():
    Remembers(name="a")(Passes(name="b")(1.0))


def only_slow_ones():
    Passes(name="a", every=5)(1.0)


def native_blocks():
    Gain(2.0, name="a")(1.0)


@pytest.mark.parametrize(
    "build, taken",
    [
        (two_chains, 60),
        (a_native_block_between, 120),
        (neighbours_of_other_rates, 60),
        (step_and_update, 120),
        (only_slow_ones, 12),
        (native_blocks, 0),
    ],
)
def test_the_gil_is_acquired_once_for_adjacent_python_steps_and_never_while_they_are_disabled(build, taken):
    with Diagram("d", rate=RATE) as diagram:
        build()
    rig = Rig(diagram)
    assert rig.run(60).status == "ok" and rig.statistics()["gil_taken"] == taken
    if build is not only_slow_ones:
        assert rig.schedule.gil_sections * 60 == taken


def test_blocks_of_other_rates_in_one_gil_section_are_timed_separately():
    class Tells(Block):
        """Reported elapsed time."""

        u = Input("any")
        passed = Output("s")

        def step(self, u, dt):
            return dt

    with Diagram("d", rate=RATE) as diagram:
        heard = 1.0
        for name, every in (("a", 1), ("b", 4), ("c", 2), ("d", 1)):
            heard = Tells(name=name, every=every)(heard)
        Gain(2.0, name="e")(heard)
    rig = Rig(diagram)
    rig.run(8)
    for name, every in (("a", 1), ("b", 4), ("c", 2), ("d", 1)):
        assert rig[f"{name}.passed"] == pytest.approx([every / RATE] * 8)


def test_other_python_threads_hand_over_the_gil_within_a_tenth_of_a_millisecond_while_it_runs():
    class Looks(Block):
        """How long they may keep it."""

        interval = Output("s")

        def step(self):
            return sys.getswitchinterval()

    with Diagram("d", rate=RATE) as diagram:
        Looks(name="looks")
    rig = Rig(diagram)
    before = sys.getswitchinterval()
    rig.run(1)
    assert rig["looks.interval"] == pytest.approx([1e-4]) and before > 1e-3 and sys.getswitchinterval() == before


def test_every_histogram_of_a_run_counts_its_events():
    def law(knee):
        return TorqueLimiter(limit=5.0)(Passes(name="a")(Gain(2.0)(Passes(name="b")(knee.torque))))

    rig = one_drive(law, virtual=False, timeout=0.0)
    rig.run(40)
    statistics = rig.statistics()
    counts = {name: statistics[name]["count"] for name in ("lateness", "period", "execution", "gil", "bus")}
    ticks = statistics["ticks"]
    assert counts == {"lateness": ticks, "period": ticks - 1, "execution": ticks, "gil": 2 * ticks, "bus": ticks}
    assert statistics["gil_taken"] == 2 * ticks
    assert (
        statistics["gil"]["total"] + statistics["bus"]["total"]
        <= statistics["execution"]["total"]
        == statistics["busy"]
    )
    late = [round(1e9 * value) for value in (statistics["lateness"]["max"], statistics["period"]["max"])]
    assert late[1] <= late[0]  # both lie between 0 and the latest


def test_a_profile_counts_every_step_of_every_block_and_shares_out_the_time():
    with Diagram("d", rate=RATE) as diagram:
        Butterworth(cutoff=20.0, name="filter")(Passes(name="python")(1.0))
        UnitDelay(name="delay")(Gain(2.0, name="slow", every=4)(1.0))
    rig = Rig(diagram, profile=True)
    rig.run(100)
    rows, plant = rig.executor.profile
    calls = {(row["name"], row["kind"]): row["count"] for row in rows}
    assert (
        calls
        == {
            ("filter", "native"): 100,
            ("python", "Python"): 100,
            ("slow", "native"): 25,
            ("delay", "native"): 100,
            ("delay", "native update"): 100,
            ("waiting for the GIL", "phase"): 100,
            ("recording", "phase"): 100,
        }
        and plant == []
    )
    spent = sum(row["total"] for row in rows)
    assert 0.5 * rig.statistics()["busy"] <= spent <= rig.statistics()["busy"] * 1.001
    assert [row["total"] for row in rows] == sorted((row["total"] for row in rows), reverse=True)


def test_profile_includes_devices_and_plant():
    rig = one_drive(lambda knee: 1.0)
    assert rig.executor.profile == ([], [])
    rig = one_drive(lambda knee: 1.0, options={"profile": True})
    rig.run(50)
    rows, plant = rig.executor.profile
    kinds = {row["name"]: row for row in rows}
    assert kinds["knee"]["kind"] == "device" and kinds["knee"]["count"] == 50
    assert {"receiving", "sending", "the plant"} <= set(kinds)
    assert {row["name"]: row["count"] for row in plant}["knee_limb"] >= 250


def test_profile_lists_each_device():
    with Diagram("robot", rate=RATE) as robot:
        for can_id, name in enumerate(("left", "middle", "right"), 1):
            CubeMars("AK10-9-V2.0", can_id=can_id, name=name)(torque_command=1.0)
    rig = Rig(robot, plant_of(robot), profile=True)
    rig.run(40)
    rows, _ = rig.executor.profile
    assert {row["name"]: row["count"] for row in rows if row["kind"] == "device"} == {
        "left": 40,
        "middle": 40,
        "right": 40,
    }


def test_a_profile_changes_no_signal():
    found = []
    for profile in (False, True):
        rig = one_drive(lambda knee: 1.0, options={"profile": profile})
        rig.run(100)
        found.append((rig["knee.position"].tolist(), [frame.data for frame in rig.frames]))
    assert found[0] == found[1]


@pytest.mark.parametrize("spin, slept, spun", [(0.0, True, False), (0.002, True, True), (1.0, False, True)])
def test_the_loop_spins_within_the_window_before_a_deadline(spin, slept, spun):
    with Diagram("d", rate=RATE) as diagram:
        Gain(2.0, name="a")(1.0)
    rig = Rig(diagram, virtual=False, spin=spin)
    rig.run(20)
    statistics = rig.statistics()
    assert (statistics["sleeps"] > 0, statistics["spins"] > 0) == (slept, spun) and statistics["lateness"][
        "count"
    ] == len(rig.tick)
    assert max(statistics["sleeps"], statistics["spins"]) <= 20
