"""Overruns: what is done about a tick that comes too late, who is blamed for it, and the safe stop when it is too
much.
"""

import ctypes
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from blocks.actuators import CubeMars
from blocks.mathematics import Gain
from cext.clock.overrun import Overrun
from graph import Block, Diagram, Input, Kernel, Output
from tests.cext.rigs import Rig, ends_in_the_safe_stop, plant_of

pytestmark = pytest.mark.timing

RATE = 50
PERIOD = 1.0 / RATE


class Holds(Block):
    """Holds the loop for so many seconds at every tick of a set."""

    u = Input("any", default=0.0)
    y = Output("N·m", range=(-1.0, 1.0))

    def __init__(self, seconds, ticks, **options):
        self.seconds, self.ticks = seconds, frozenset(ticks)
        super().__init__(**options)

    def step(self, u, tick):
        if tick in self.ticks:
            end = time.monotonic() + self.seconds
            while time.monotonic() < end:
                pass
        return 0.5


class Passes(Block):
    """A Python neighbour that does next to nothing."""

    u = Input("any")
    y = Output("any")

    def step(self, u):
        return u


def robot(seconds, ticks, **options):
    with Diagram("robot", rate=RATE) as diagram:
        knee = CubeMars("AK10-9-V2.0", can_id=1, name="knee", timeout=0.0)
        slow = Holds(seconds, ticks, name="slow")(Passes(name="before")(knee.position))
        Passes(name="after")(slow)
        knee(torque_command=slow)
    # a drive that answers every 5 ms, as often as a stop asks
    return Rig(diagram, plant_of(diagram, substeps=4), virtual=False, **options)


def test_overrun_while_encoding_names_the_device():
    pointer, asked = ctypes.c_void_p, []

    @ctypes.CFUNCTYPE(ctypes.c_int, pointer, pointer, pointer, pointer)
    def encode(arena, slots, sizes, frames):
        asked.append(0)
        if len(asked) == 10:
            time.sleep(0.11)
        return 0

    class Slow(CubeMars):
        pass

    Slow.encode = Kernel(encode, "")
    with Diagram("robot", rate=RATE) as diagram:
        Slow("AK10-9-V2.0", can_id=1, name="knee", timeout=0.0)(torque_command=0.5)
    rig = Rig(diagram, plant_of(diagram, substeps=1), virtual=False, overrun="fault:3")
    outcome = rig.run(100)
    assert (outcome.status, outcome.culprit) == ("overrun", "encoding")


@pytest.mark.hazard("H13b")
def test_an_overrun_fault_names_the_block_and_stop_frames_follow_within_two_ticks():
    rig = robot(0.11, {10}, overrun="fault:3")  # five periods and a half
    outcome = rig.run(100)
    statistics = rig.statistics()
    assert (outcome.status, outcome.culprit, outcome.tick) == ("overrun", "slow", rig.tick[-1]) and outcome.faulted
    assert 3 <= statistics["missed"] and statistics["ticks"] == len(rig.tick) == len(rig.commands())
    assert ends_in_the_safe_stop(rig) and outcome.unconfirmed == () and outcome.late == ()
    # where the others were found missed
    due = rig.shared.first_tick + (outcome.tick + 1 + statistics["missed"]) * PERIOD * 1e9
    sent = [frame.time for frame in rig.frames if frame.sent and frame.id == 1]
    assert due <= min(time for time in sent if time >= due) <= due + 2 * PERIOD * 1e9
    assert not [time for time in sent if due - PERIOD * 1e9 < time < due], "no command after the stall"


def test_fewer_missed_ticks_than_the_fault_limit_are_skipped():
    rig = robot(0.05, {10}, overrun="fault:9")
    outcome = rig.run(30)
    assert outcome.status == "ok" and 1 <= rig.statistics()["missed"] < 9 + 9


def test_frequent_short_overruns_are_a_fault():
    # two periods and a half: one grid point of four is missed
    rig = robot(0.05, range(4, 100, 4), overrun="fault:4/20")
    outcome = rig.run(100)
    assert outcome.status == "overrun" and outcome.culprit == "slow" and ends_in_the_safe_stop(rig)
    assert outcome.tick < 40 and rig.statistics()["missed"] >= 4


def test_late_ticks_catch_up_with_their_own_time_and_rest_is_skipped():
    rig = robot(0.25, {10}, overrun="catch-up:4")  # twelve periods and a half
    outcome = rig.run(60)
    statistics = rig.statistics()
    ticks = rig.tick.tolist()
    assert outcome.status == "ok" and statistics["caught_up"] >= 4 and statistics["ticks"] + statistics["missed"] == 60
    place = ticks.index(10)
    assert ticks[place : place + 5] == [10, 11, 12, 13, 14] and ticks[place + 5] >= 20
    assert rig.time.tolist() == [tick / RATE for tick in ticks]


def test_a_sufficient_catch_up_misses_no_tick():
    rig = robot(0.05, {10}, overrun="catch-up:1000")
    rig.run(30)
    statistics = rig.statistics()
    assert rig.tick.tolist() == list(range(30)) and statistics["missed"] == 0 and statistics["caught_up"] >= 1
    assert statistics["lateness"]["max"] >= 0.029  # told as late as it was


def test_slowest_block_is_identified_without_profile():
    rig = robot(0.07, {10, 20}, overrun="skip")
    rig.run(40)
    blamed = {row["name"]: row for row in rig.executor.overruns}
    assert blamed["slow"]["times"] == 2 and blamed["slow"]["missed"] >= 4 and blamed["slow"]["longest"] >= 0.07
    assert blamed["slow"]["at_tick"] in (10, 20) and not {"before", "after", "knee"} & set(blamed)


def test_consecutive_native_blocks_are_reported_by_their_ends_and_by_one_with_a_profile():
    with Diagram("d", rate=RATE) as diagram:
        Gain(2.0, name="last")(Gain(2.0, name="first")(1.0))
    for profile, name in ((False, "first to last"), (True, "first")):
        watch = Rig(diagram, profile=profile, record=False).executor.watch
        assert watch.name(7) == name


WORDS = {
    "": "unknown overrun policy ''",
    "skipp": "unknown overrun policy 'skipp'",
    "catch-up": "with numbers from 1 to 1000000",
    "catch-up:0": "skip, catch-up:N, fault:N or fault:N/WINDOW",
    "catch-up:3/5": "unknown",
    "fault:-1": "unknown",
    "fault:1000001": "unknown",
    "fault:5/4": "can never apply",
    "skip,fault:3": "cannot be combined",
    "fault:3,fault:4": "given twice",
    "catch-up:3,catch-up:3": "given twice",
}


@pytest.mark.parametrize("words", WORDS)
def test_invalid_overrun_policy_is_refused(words):
    with pytest.raises(ValueError, match=WORDS[words]):
        Overrun(words)


def test_overrun_policies_combine():
    policy = Overrun("catch-up:2, fault:9, fault:12/100")
    assert (policy.catch_up, policy.in_a_row, policy.in_window, policy.window) == (2, 9, 12, 100)


@given(
    st.lists(st.integers(0, 7), max_size=200),
    st.integers(0, 4),
    st.integers(0, 5),
    st.integers(1, 6),
    st.integers(0, 20),
)
def test_every_policy_agrees_with_a_list_of_all_that_was_missed(delays, catch_up, in_a_row, in_window, more):
    window = in_window + more
    words = (
        [f"catch-up:{catch_up}"] * (catch_up > 0)
        + [f"fault:{in_a_row}"] * (in_a_row > 0)
        + [f"fault:{in_window}/{window}"]
    )
    policy = Overrun(",".join(words))
    now = tick = late = 0
    missed = []
    for delay in delays:
        now = max(now, tick) + delay
        wanted = tick if now == tick or late < catch_up else now
        late = 0 if now == tick or wanted == now else late + 1
        missed += range(tick, wanted)
        assert policy.decide(tick, now) == wanted
        lately = [point for point in missed if point >= wanted - window]
        fault = wanted > tick and (0 < in_a_row <= wanted - tick or len(lately) >= in_window)
        assert policy.fault == fault
        if fault:
            return
        tick = wanted + 1
