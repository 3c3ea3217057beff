"""The diagrams that peers are timed with: every contender computes the same."""

import importlib
import math
import socket

import pytest

from cext.bus.socketcan import SocketCan
from runtime.experiments.studies.engine import Here
from tests.bench.c_program import NoCompiler
from tests.bench.can_cost import ANSWERS, ends
from tests.peers import netlists, python_can, reading, recording, study
from tests.peers.__main__ import OURS, PEERS, contenders_of
from tests.peers.agreement import Disagreement, check
from tests.peers.by_hand import PlainPython, StraightC

pytestmark = pytest.mark.soak

NETLISTS = [netlists.knee(), netlists.wide(), netlists.wide6(), netlists.chain()]


@pytest.mark.parametrize("netlist", NETLISTS, ids=lambda netlist: netlist.name)
def test_blocks_and_lines_written_by_hand_compute_the_same(netlist):
    reference = PlainPython(netlist)
    for kind in (*OURS, StraightC):
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


def test_a_benchmark_with_wrong_results_is_not_timed():
    class Half(PlainPython):
        name = "half"

        def advance(self, ticks):
            super().advance(ticks)
            self.sinks[0] *= 0.5

    with pytest.raises(Disagreement, match="half computes .* after 1 ticks, plain Python, one straight line"):
        check(Half(NETLISTS[0]), PlainPython(NETLISTS[0]))


def test_nan_fails_the_comparison_of_benchmarks():
    class Broken(PlainPython):
        def advance(self, ticks):
            super().advance(ticks)
            self.sinks[0] = math.nan

    with pytest.raises(Disagreement):
        check(Broken(NETLISTS[0]), PlainPython(NETLISTS[0]))


def test_without_a_compiler_the_c_benchmark_is_omitted(monkeypatch):
    monkeypatch.setenv("CC", "false")
    with pytest.raises(NoCompiler, match="false fails"):
        StraightC(NETLISTS[0])
    contenders, left_out = contenders_of(NETLISTS[0], with_peers=False)
    assert [contender.name for contender in contenders] == [
        *(kind.name for kind in OURS),
        "plain Python, one straight line",
    ]
    assert list(left_out) == ["C, one straight line"]


@pytest.mark.parametrize("module", PEERS)
def test_a_peer_that_is_installed_computes_the_same(module):
    pytest.importorskip("pydrake" if module == "drake" else module)
    peers = importlib.import_module(f"tests.peers.{module}")
    for kind in PEERS[module]:
        check(getattr(peers, kind)(NETLISTS[0]), PlainPython(NETLISTS[0]))


def test_python_can_sends_the_bytes_that_the_native_driver_sends():
    assert python_can.pack(0.0) == bytes.fromhex("7fff7ff0000007ff")
    times = python_can.measure(3)
    assert len(times) == 3 and min(times) > 0.0


def test_python_can_raises_an_exception_when_a_reply_is_lost(monkeypatch):
    monkeypatch.setattr(python_can, "ANSWER_TIMEOUT", 0.05)
    with ends() as (own, _), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as unconnected:
        unconnected.bind(("127.0.0.1", 0))
        unconnected.connect(("127.0.0.1", 9))
        with pytest.raises(OSError, match="an answer was lost"):
            python_can.time_of_ticks(own, SocketCan(unconnected, mute=True).end, ANSWERS, 1)


def test_the_cost_of_the_recorder_is_measured_beside_the_writers_of_csv_and_mcap():
    cost = recording.measure(200)
    measured = [name for name in cost if "published" not in name]
    assert measured == [
        "Tickwork, MCAP with zstd",
        "Tickwork, MCAP and CSV",
        "csv.writer, rows alone",
        "mcap's writer with zstd, encoded",
    ]
    assert all(0.0 < cost[name] < 1e6 for name in measured)


def test_recording_is_read_and_exported_alike(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    path = reading.record(tmp_path, 2.0)
    here, there = reading.tickwork_signal(path, tmp_path), reading.mcap_signal(path, tmp_path)
    assert len(here) == 400 and here.tolist() == there.tolist() and any(here)
    everything = reading.tickwork_all(path, tmp_path)
    assert len(everything) > 30 and {len(values) for values in everything.values()} == {400}
    assert reading.mcap_all(path, tmp_path) > 3 * 400
    mine, other = (parquet.read_table(task(path, tmp_path)) for task in reading.TASKS["to Parquet"])
    for name in (reading.SIGNAL, "tick", "right/gait_phase.walking"):
        assert mine[name].to_pylist() == other[name].to_pylist()
    seconds, processor, memory, written = reading.measured("tickwork_parquet", path, tmp_path)
    assert 0 < processor and 0 < seconds < 60 and 10 < memory < 2000 and written > 0.01


def test_a_study_and_calls_by_hand_give_the_same_objectives(monkeypatch):
    monkeypatch.setattr(study, "DURATION", study.SHORT)
    times, objectives = study.timed(lambda values: study.through(Here(study.study_of(study.SHORT)), values), [0.5, 1.0])
    assert objectives == [study.by_call(0.5), study.by_call(1.0)] and min(times) > 0.0
    assert study.bare_ticks() < study.whole_run() < 60.0
    assert study.ratio([2.0, 3.0, 8.0], [1.0, 1.0, 2.0]) == "3 (2 to 4)"
