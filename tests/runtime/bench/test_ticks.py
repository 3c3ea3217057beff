"""The diagrams of `bench`: every contender computes the same, and is timed beside the others."""

import math

import pytest

from runtime.bench import goals, netlists
from runtime.bench.by_hand import NoCompiler, PlainPython, StraightC
from runtime.bench.measure import Disagreement, Times, check, interleave
from runtime.bench.ours import NativeBlocks, PythonBlocks
from runtime.cli.bench.command import PEERS, contenders_of

NETLISTS = [netlists.knee(), netlists.wide(), netlists.wide6(), netlists.chain()]


@pytest.mark.parametrize("netlist", NETLISTS, ids=lambda netlist: netlist.name)
def test_blocks_and_lines_written_by_hand_compute_the_same(netlist):
    reference = PlainPython(netlist)
    for kind in (NativeBlocks, PythonBlocks, StraightC):
        contender = kind(netlist)
        check(contender, reference)
        contender.restart(), reference.restart()
        contender.advance(1000), reference.advance(1000)
        assert list(contender.sinks) == pytest.approx(list(reference.sinks), abs=1e-9) and any(contender.sinks)


def test_the_diagrams_have_the_sizes_that_the_peers_were_measured_with():
    assert [(netlist.name, netlist.blocks, netlist.width) for netlist in NETLISTS] == [
        ("knee", 20, 1),
        ("wide", 200, 1),
        ("wide6", 200, 6),
        ("chain", 102, 1),
    ]


def test_what_computes_something_else_is_not_timed():
    class Half(PlainPython):
        name = "half"

        def advance(self, ticks):
            super().advance(ticks)
            self.sinks[0] *= 0.5

    with pytest.raises(Disagreement, match="half gives .* after 1 ticks, and plain Python, one straight line"):
        check(Half(NETLISTS[0]), PlainPython(NETLISTS[0]))


def test_nan_is_a_disagreement():
    class Broken(PlainPython):
        def advance(self, ticks):
            super().advance(ticks)
            self.sinks[0] = math.nan

    with pytest.raises(Disagreement):
        check(Broken(NETLISTS[0]), PlainPython(NETLISTS[0]))


def test_rounds_are_compared_with_their_neighbours_in_time():
    """A machine that becomes twice as slow halfway leaves the ratio as it is."""
    slow, fast = Times([4.0, 4.0, 8.0]), Times([2.0, 2.0, 4.0])
    assert slow.over(fast) == 2.0 and (slow.least, slow.median, slow.most) == (4.0, 4.0, 8.0)


def test_contenders_run_in_turn_for_about_the_time_asked():
    class Clocked:
        """Takes 10 µs a tick, and says when it ran."""

        def __init__(self, name, log):
            self.name, self.log = name, log

        def restart(self):
            pass

        def advance(self, ticks):
            self.log.append((self.name, ticks))
            return ticks * 1e-5

    log = []
    times = interleave([Clocked("a", log), Clocked("b", log)], 0.01, 3)
    assert [name for name, _ in log[-6:]] == ["a", "b"] * 3 and {ticks for _, ticks in log[-6:]} == {1000}
    assert times["a"].rounds == pytest.approx([10.0] * 3)


def test_without_a_compiler_straight_c_is_left_out_in_words(monkeypatch):
    monkeypatch.setenv("CC", "false")
    with pytest.raises(NoCompiler, match="false fails"):
        StraightC(NETLISTS[0])
    found, left_out = contenders_of(NETLISTS[0], with_peers=False)
    assert [contender.name for contender in found] == [
        "Tickwork, native blocks",
        "Tickwork, Python blocks",
        "plain Python, one straight line",
    ]
    assert list(left_out) == ["C, one straight line"]


@pytest.mark.parametrize("module", PEERS)
def test_a_peer_that_is_installed_computes_the_same(module):
    pytest.importorskip(PEERS[module][1])
    peers = pytest.importorskip(f"runtime.bench.{module}")
    for kind in PEERS[module][0]:
        check(getattr(peers, kind)(NETLISTS[0]), PlainPython(NETLISTS[0]))


def test_a_goal_is_reached_or_not():
    assert goals.Goal("a", 1.0, 1.0, "ns").reached and not goals.Goal("a", 1.1, 1.0, "ns").reached
    assert goals.Goal("a", 90.0, 90.0, "times", True).reached and not goals.Goal("a", 89.0, 90.0, "times", True).reached
