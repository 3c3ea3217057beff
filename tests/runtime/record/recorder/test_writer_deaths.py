"""Deaths of the recorder's writer and of its parent: another writer continues the recording."""

import io
import json
import os
import signal
import time
from contextlib import suppress
from pathlib import Path

import pytest
from mcap.reader import make_reader

from blocks.recorders import CsvRecorder
from cext.memory.shared_state import RECORD_EVENT, SharedState
from graph import Block, Diagram, Output
from runtime.record.analysis.trial import Trial
from runtime.record.recorder import RecorderProcess
from runtime.record.storage.repair import Repair, RepairFailed
from tests.runtime.record.recorder.processes import all_ended, writers
from tests.runtime.record.recorder.running import CSV, columns, plan, read_csv, row, run, sink
from tests.runtime.terminals import patient
from tests.soaking import soaked

pytestmark = pytest.mark.paced

SIGNALS = columns("a.x m")


@pytest.fixture(autouse=True)
def forked_children():
    """Start the recorders as a run does: these tests are of their processes."""


class Killer(Block):
    """Sends a signal to the processes that `victims` returns, at each tick of {tick: signal}."""

    y = Output("1")

    def __init__(self, deaths, victims, **named):
        self.ticks, self.signals, self.victims, self.killed = list(deaths), list(deaths.values()), victims, []
        super().__init__(**named)

    def step(self, tick):
        if self.ticks and tick >= self.ticks[0]:  # a tick may be missed
            del self.ticks[0]
            deadline = time.monotonic() + 10.0
            while not (found := [pid for pid in self.victims() if pid not in self.killed]):
                assert time.monotonic() < deadline, "there is no writer"
                time.sleep(0.001)  # in virtual time the next writer may not be there yet
            number = self.signals.pop(0)
            for pid in found:
                os.kill(pid, number)
                self.killed.append(pid)
        return tick


def killed(folder, deaths, victims=writers, **options):
    """A run of 500 ticks whose recorders die at {tick: signal}. Returns (outcome, report, shared, killer, session)."""
    with Diagram("killing", rate=500) as diagram:
        session = []
        killer = Killer(deaths, lambda: victims(session[0]), name="killer")
        CsvRecorder()
    found = run(diagram, folder, 500, before=lambda recorder: session.append(recorder.pid), **options)
    return *found, killer, session[0]


def ticks_of(*files):
    return [int(cells[1]) for file in files for cells in read_csv(file)[1]]


@pytest.mark.parametrize("virtual", soaked([True, False], but=[1]))
def test_when_a_writer_is_killed_another_continues_and_no_record_is_lost_or_doubled(tmp_path, virtual, capfd):
    def writing(recorder):
        """The writer of the newest part, once that has a row."""
        return writers(recorder) if ticks_of(sorted(tmp_path.glob("*.csv"))[-1]) else []

    outcome, report, shared, killer, session = killed(
        tmp_path,
        {150: signal.SIGKILL, 400: signal.SIGSEGV},
        writing,
        virtual=virtual,
        shared=SharedState(1 << (12 if virtual else 20)),
    )
    statistics = shared.statistics()
    assert outcome.status == "ok" and statistics["ticks"] + statistics["missed"] == 500 and statistics["dropped"] == 0
    parts = [tmp_path / f"killing{part}.csv" for part in ("", "_part2", "_part3")]
    ticks = ticks_of(*parts)
    assert len(killer.killed) == 2 and ticks == sorted(set(ticks)) and len(ticks) == statistics["ticks"]
    assert all(ticks_of(part) for part in parts[1:])
    logs = [Trial(part.with_suffix(".mcap")) for part in parts]
    # the first stands for all
    assert logs[0].tick.tolist() == ticks and logs[0].parts == [part.with_suffix(".mcap") for part in parts]
    assert [(log.about["part"], log.complete, log.tick.tolist()) for log in logs[1:]] == [
        (2, True, ticks_of(*parts[1:])),
        (3, True, ticks_of(parts[2])),
    ]
    assert report["ticks"] == len(ticks_of(parts[2])) and report["ended"] == "ok"
    assert [len(list(messages(part.with_suffix(".mcap")).iter_messages("/tickwork/tick"))) for part in parts] == [
        len(ticks_of(part)) for part in parts
    ]
    told = [
        f"the writer of part {part} died ({cause}); part {part + 1} continues the recording; no record was lost"
        for part, cause in ((1, "SIGKILL"), (2, "SIGSEGV"))
    ]
    assert report["problems"] == told and capfd.readouterr().err.splitlines() == [
        f"tickwork recorder: {line}" for line in told
    ]
    assert json.loads((tmp_path / "killing.json").read_text())["ended"] == (
        "the recorder died (SIGKILL); part 2 continues it"
    )
    assert {Path(file["path"]).name for file in report["files"]} == {path.name for path in tmp_path.iterdir()}
    assert all_ended(session)


@pytest.mark.parametrize("unbegun", soaked([[0], [1], [0, 1]], but=[2]))
def test_a_part_killed_before_its_first_record_does_not_hide_the_parts_after_it(tmp_path, unbegun):
    deaths = {150: signal.SIGKILL, 300: signal.SIGSEGV}
    killed(tmp_path, deaths, virtual=False, shared=SharedState(1 << 20), compression="none")
    parts = [tmp_path / f"killing{part}.mcap" for part in ("", "_part2", "_part3")]
    ticks = []
    for number, part in enumerate([*parts]):
        data = part.read_bytes()
        if number > 0 and b'"signals"' not in data:  # on a busy machine the writer is killed before the head
            parts.remove(part)
            continue
        begin = data.find(b'"begin"')  # or before it has flushed that
        if number in unbegun and begin >= 0:
            part.write_bytes(data[: begin - 40])
        else:
            ticks += [int(cells[1]) for cells in read_csv(part.with_suffix(".csv"))[1]]
    joined = Trial(parts[0])
    assert joined.parts == parts and joined.tick.tolist() == ticks and len(ticks) > 0
    assert [event["event"] for event in joined.events].count("begin") == 1
    assert joined.time[0] == pytest.approx(ticks[0] / 500, abs=0.1)


@pytest.mark.parametrize("virtual", soaked([True, False], but=[0]))
def test_a_second_death_of_one_cause_ends_the_recording_and_the_run_continues(tmp_path, virtual, capfd):
    outcome, report, shared, killer, session = killed(
        tmp_path, {50: signal.SIGKILL, 100: signal.SIGKILL}, virtual=virtual, shared=SharedState(1 << 12)
    )
    statistics = shared.statistics()
    assert outcome.status == "ok" and statistics["ticks"] + statistics["missed"] == 500 and statistics["dropped"] > 0
    told = [
        "the writer of part 1 died (SIGKILL); part 2 continues the recording; no record was lost",
        "the writer of part 2 died (SIGKILL); recording stops and the run continues without it",
    ]
    assert report["problems"] == told and capfd.readouterr().err.splitlines() == [
        f"tickwork recorder: {line}" for line in told
    ]
    ticks = ticks_of(tmp_path / "killing.csv", tmp_path / "killing_part2.csv")
    assert ticks == sorted(set(ticks))  # whole rows, in order; a busy machine may miss one
    assert json.loads((tmp_path / "killing_part2.json").read_text())["ended"] == "the recorder died (SIGKILL)"
    assert {Path(file["path"]).name for file in report["files"]} == {path.name for path in tmp_path.iterdir()}
    assert len(list(tmp_path.iterdir())) == 6 and all_ended(session)


def test_a_dying_writer_is_restarted_at_most_three_times(tmp_path):
    deaths = [signal.SIGKILL, signal.SIGSEGV, signal.SIGABRT, signal.SIGBUS, signal.SIGFPE]
    outcome, report, shared, killer, session = killed(tmp_path, dict(zip((50, 100, 150, 200), deaths)), virtual=False)
    assert outcome.status == "ok" and len(set(killer.killed)) == 4 and all_ended(session)
    assert len(report["problems"]) == 4 and "SIGBUS); recording stops" in report["problems"][-1]
    assert sorted(path.name for path in tmp_path.glob("*.mcap")) == [
        f"killing{part}.mcap" for part in ("", "_part2", "_part3", "_part4")
    ]


def test_a_service_that_cannot_start_in_the_next_part_is_named_and_the_rest_is_recorded(tmp_path, monkeypatch):
    (tmp_path / "mine.py").write_text(
        "from runtime.record.recorder.service import Service\nclass Once(Service):\n    def open(self):\n"
        "        if self.plan.get('part', 1) > 1:\n            raise ValueError('it was there once')\n"
        "class Strange(Service):\n    def state(self):\n        return lambda: 'which nobody can keep'\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    shared = SharedState(1 << 20)
    recorder = RecorderProcess(shared)
    recorder.configure(
        plan(tmp_path / "out", sink("mine:Once", "once", SIGNALS), sink(CSV, "csv", SIGNALS), virtual=False)
    )
    for tick in range(100):
        shared.push(*row(tick, float(tick)))
        if tick == 50:
            patient(lambda: shared.empty)
            with pytest.raises(RepairFailed, match="bench_1.mcap is still being recorded"):
                Repair(tmp_path / "out" / "bench_1.mcap")
            os.kill(*patient(lambda: writers(os.getsid(recorder.pid))), signal.SIGKILL)
    shared.close()
    report = recorder.finish()
    assert report["problems"] == [
        "the writer of part 1 died (SIGKILL); part 2 continues the recording; no record was lost",
        "once cannot be continued: ValueError: it was there once",
    ]
    assert ticks_of(tmp_path / "out" / "bench_1.csv", tmp_path / "out" / "bench_1_part2.csv") == list(range(100))
    assert Trial(tmp_path / "out" / "bench_1.mcap").tick.tolist() == list(range(100))


@pytest.mark.soak
@pytest.mark.parametrize("attempt", range(12))
def test_a_recorder_killed_while_completing_files_is_replaced(tmp_path, attempt):
    shared = SharedState(1 << 20)
    recorder = RecorderProcess(shared)
    recorder.configure(plan(tmp_path, sink(CSV, "csv", SIGNALS), virtual=False))
    session = os.getsid(recorder.pid)
    for tick in range(9000):
        while not shared.push(*row(tick, float(tick))):
            time.sleep(0.001)
        if tick == 8000:
            [victim] = patient(lambda: writers(session))
            os.kill(victim, signal.SIGSEGV)
    [victim] = patient(lambda: set(writers(session)) - {victim})
    shared.push(
        RECORD_EVENT, json.dumps({"event": "end", "status": "ok", "culprit": None, "signal": 0, "tick": 8999}).encode()
    )
    patient(lambda: shared.empty)
    shared.close()
    time.sleep(0.005 * attempt)
    with suppress(ProcessLookupError):  # it has completed the files
        os.kill(victim, signal.SIGKILL)
    recorder.finish()
    parts = sorted(tmp_path.glob("*.mcap"))
    assert len(parts) in (2, 3) and all_ended(session)
    assert (
        sum(len(list(messages(part).iter_messages("/tickwork/tick"))) for part in parts if part.stat().st_size) == 9000
    )
    assert Trial(tmp_path / "bench_1.mcap").tick.tolist() == list(range(9000))


def test_the_writer_completes_the_files_if_its_parent_is_killed(tmp_path):
    outcome, report, shared, killer, session = killed(
        tmp_path, {50: signal.SIGKILL}, lambda session: writers(session, "tickwork-parts"), virtual=False
    )
    statistics = shared.statistics()
    assert (
        outcome.status == "ok" and len(killer.killed) == 1 and statistics["dropped"] == 0 and report["problems"] == []
    )
    assert len(ticks_of(tmp_path / "killing.csv")) == statistics["ticks"] and all_ended(session)


@pytest.mark.parametrize("virtual", soaked([True, False], but=[0]))
def test_the_run_continues_without_any_recorder_and_reports_their_death(tmp_path, virtual):
    def all_of_them(session):
        """First the process that would start another writer."""
        first, writing = writers(session, "tickwork-parts"), writers(session)
        return first + writing if first and writing else []

    outcome, report, shared, killer, session = killed(
        tmp_path, {50: signal.SIGKILL}, all_of_them, virtual=virtual, shared=SharedState(1 << 12)
    )
    statistics = shared.statistics()
    assert outcome.status == "ok" and statistics["ticks"] + statistics["missed"] == 500
    assert statistics["dropped"] > 0 or not virtual and statistics["missed"] > 250  # too few ticks to fill the ring
    assert report["problems"] == [
        "the recorder process died before the end (SIGKILL) and the files end there; "
        "complete its .mcap file with `convert FILE.mcap --to mcap`"
    ]
    assert [Path(file["path"]).name for file in report["files"]] == ["killing.csv", "killing.mcap", "killing.json"]
    ticks = ticks_of(tmp_path / "killing.csv")  # whole rows only
    assert ticks == sorted(set(ticks))  # in order; a busy machine may miss one
    assert "the recorder was killed" in json.loads((tmp_path / "killing.json").read_text())["ended"]


def messages(path):
    """The mcap package's own reader of a file with an index of its chunks."""
    reader = make_reader(io.BytesIO(path.read_bytes()), validate_crcs=True)
    assert reader.get_summary().statistics.message_count == 0 or reader.get_summary().chunk_indexes
    return reader
