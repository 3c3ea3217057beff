"""Faults that a loop which lost ticks may have caused itself name the machine, or the block that took the time."""

import re
import time
from dataclasses import replace
from types import SimpleNamespace

import pytest

from cext.clock.stopwatch import MACHINE
from runtime.host.system import processor_wait
from runtime.record.report import fault
from runtime.record.report.lost_ticks import REMEDY, before_fault
from runtime.session.prepare import prepare
from runtime.session.request import Request
from runtime.session.session import Session
from tests.runtime.runs import write

STEADY = [(float(tick), 0.0001) for tick in range(95, 101)]
SLEEPS = """
import time

from blocks.recorders import CsvRecorder
from graph import Block, Diagram, Output


class Law(Block):
    y = Output("1")

    def reset(self):
        self.slept = False

    def step(self, tick):
        if tick >= 20 and not self.slept:  # a late loop may skip tick 20; after the sleep it skips the rest
            self.slept = True
            time.sleep(0.5)
        return 1.0


with Diagram("late", rate=200) as diagram:
    Law(name="law")
    CsvRecorder()
"""


def ended(status, tick=121, rows=STEADY, overruns=(), culprit="knee", fast=False, waited=0.0):
    """A Result as far as it is read."""
    return SimpleNamespace(
        request=SimpleNamespace(fast=fast),
        waited=waited,
        outcome=SimpleNamespace(status=status, tick=tick, culprit=culprit),
        newest=rows,
        overruns=list(overruns),
        failed_in_plant=False,
        schedule=SimpleNamespace(rate=200.0),
        diagram=SimpleNamespace(blocks={"knee": SimpleNamespace(timeout=0.1)}),
    )


def test_ticks_lost_before_the_newest_rows_are_seen_within_the_timeout_of_the_device():
    said = "; the loop had lost 21 ticks before that: machine too busy, see --realtime"
    assert before_fault(ended("silent", 101, overruns=[blamed(MACHINE, 80)])) == said
    assert before_fault(ended("silent", 101, overruns=[blamed("law", 80)])).endswith(": law took 104.0 ms (tick 80)")
    assert before_fault(ended("silent", 101, overruns=[blamed(MACHINE, 70)])) == ""  # 25 ticks before the oldest row


def test_in_virtual_time_no_fault_is_blamed_on_a_busy_machine():
    assert "had waited 182.1 ms for a processor" in before_fault(ended("no answer", -1, waited=0.1821))
    assert before_fault(ended("no answer", -1, waited=0.1821, fast=True)) == ""


def test_a_missing_reply_on_a_busy_machine_names_the_machine():
    result = ended("no answer", -1, [])
    result.waited = 0.3
    assert before_fault(result) == "; the loop had waited 300.0 ms for a processor: machine too busy, see --realtime"
    result.waited = 0.05
    assert before_fault(result) == ""


def test_the_wait_for_a_processor_is_counted():
    begun, before = time.monotonic(), processor_wait()
    while time.monotonic() < begun + 0.2:
        pass
    assert 0.0 <= processor_wait() - before <= time.monotonic() - begun


def blamed(name, at_tick=100):
    return {"name": name, "times": 1, "missed": 20, "longest": 0.104, "at_tick": at_tick}


@pytest.mark.parametrize("status", ["silent", "no answer", "not following"])
def test_a_fault_after_a_late_wake_up_names_the_machine(status):
    said = "; the loop had lost 20 ticks before that: machine too busy, see --realtime"
    assert before_fault(ended(status, overruns=[blamed(MACHINE)])) == said == before_fault(ended(status))


def test_ticks_lost_between_the_newest_rows_count_too():
    rows = [(float(tick), 0.001) for tick in (90, 94, 95, 99, 100, 101)]
    assert before_fault(ended("silent", 102, rows)).startswith("; the loop had lost 6 ticks before that")


def test_an_overrun_names_the_slow_block_instead_of_the_machine():
    said = before_fault(ended("silent", overruns=[blamed(MACHINE, 3), blamed("left/law")]))
    assert said == "; the loop had lost 20 ticks before that: left/law took 104.0 ms (tick 100)"


def test_late_ticks_count_like_missed_ones():
    rows = [*STEADY[:-1], (100.0, 0.1)]
    assert before_fault(ended("silent", 101, rows)) == f"; the loop was up to 100.0 ms late before that: {REMEDY}"


@pytest.mark.parametrize(
    "result",
    [
        ended("silent", 101),
        ended("silent", 102),
        ended("silent", 100),
        ended("not finite"),
        ended("silent", -1, []),
        ended("overrun", culprit="law"),
    ],
    ids=["none lost", "one lost", "in the newest row", "another fault", "while arming", "an overrun of a block"],
)
def test_fault_unrelated_to_lost_ticks_is_reported_unchanged(result):
    assert before_fault(result) == ""


def test_an_overrun_of_the_machine_names_the_remedy():
    assert before_fault(ended("overrun", culprit=MACHINE)) == f"; {REMEDY}"


def test_the_rows_of_a_real_run_show_the_ticks_that_a_block_has_cost(tmp_path):
    result = Session(prepare(Request(write(tmp_path, SLEEPS), duration=0.5, no_record=True))).carry_out()
    said = before_fault(
        SimpleNamespace(
            outcome=SimpleNamespace(status="silent", tick=round(result.newest[-1][0]) + 30, culprit=None),
            newest=result.newest,
            overruns=result.overruns,
            failed_in_plant=False,
            schedule=result.schedule,
            diagram=result.diagram,
        )
    )
    assert re.fullmatch(r"; the loop had lost \d+ ticks before that: law took [\d.]+ m?s \(tick [2-9]\d\)", said), said


def test_the_first_line_of_a_report_contains_the_fault(tmp_path):
    result = Session(prepare(Request(write(tmp_path, SLEEPS), duration=1.0, fast=True, no_record=True))).carry_out()
    result.outcome = replace(result.outcome, status="silent", tick=230)
    first = fault.explain(result)[0]
    assert first == (
        "FAULT at late, tick 230 (1.15 s): no reply for longer than its timeout; the loop had lost 30 "
        f"ticks before that: {REMEDY}"
    )
