"""The watch of the page with the controls: what the panel shows in the shared state, and what the loop makes of it."""

import threading
import time

import pytest

from blocks.sources import Constant
from cext.memory.shared_state import SharedState
from cext.safety.thresholds import PAGE_SILENCE
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Diagram, compile
from tests.runtime.terminals import patient

with Diagram("robot", rate=1000) as ROBOT:
    Constant(0.0)()


class Panel:
    """A thread that does what a panel does: confirms for a page every 5 ms, until it is told otherwise."""

    def __init__(self, shared):
        self.shared, self.over, self.confirming = shared, threading.Event(), True
        self.offset = 0  # ns that is added to the time of confirmed values

    def __enter__(self):
        self.shared.link_page(1, time.monotonic_ns())
        self.thread = threading.Thread(target=self.run)
        self.thread.start()
        return self

    def __exit__(self, *exception):
        self.over.set()
        self.thread.join()

    def run(self):
        while not self.over.wait(0.005):
            if self.confirming:
                self.shared.beat_page(time.monotonic_ns() + self.offset)


def ended(shared, then, **how):
    """The status of a run of 0.6 s, and s from what happens in it to its end."""
    executor, began = Executor(Program(compile(ROBOT), []), 1000, shared=shared, hosted=True, **how), []

    def happen():
        patient(lambda: shared.statistics()["ticks"] > 20)
        began.append(time.monotonic())
        then()

    thread = threading.Thread(target=happen)
    thread.start()
    outcome, over = executor.run(600), time.monotonic()
    thread.join()
    return outcome.status, over - began[0]


def silence(panel):
    panel.confirming = False


def date(panel, offset):
    panel.offset = offset


def hand_over(panel):  # the next page has confirmed before the loop looks again
    panel.shared.unlink_page("taken", 1, 2)
    panel.shared.link_page(2, time.monotonic_ns())


@pytest.mark.paced
@pytest.mark.hazard("H9h")
@pytest.mark.parametrize(
    "happens, expected, longest",
    [
        (silence, (1, "silent", 0), 1e-9 * PAGE_SILENCE),
        (lambda panel: date(panel, -PAGE_SILENCE), (1, "silent", 0), 0.0),  # of a link that is slow
        (lambda panel: date(panel, 10**12), (1, "silent", 0), 0.0),  # a defective panel
        (lambda panel: panel.shared.unlink_page("cut", 1), (1, "cut", 0), 0.0),
        (hand_over, (1, "taken", 2), 0.0),
    ],
)
def test_page_that_is_lost_ends_the_run_and_the_loop_shows_why(happens, expected, longest):
    shared = SharedState(1 << 16)
    with Panel(shared) as panel:
        status, took = ended(shared, lambda: happens(panel), pages=True)
    assert (status, shared.lost_page) == ("page lost", expected)
    assert took < longest + 0.1  # of a busy machine


@pytest.mark.paced
@pytest.mark.parametrize("how", ["confirming", "not demanded", "none yet", "virtual time"])
def test_run_goes_on_with_its_page_and_without_one_where_none_is_demanded(how):
    shared = SharedState(1 << 16)
    with Panel(shared) as panel:
        if how == "none yet":  # a simulation waits for none
            shared.unlink_page("closed", 1)
        happens = (lambda: None) if how == "confirming" else lambda: silence(panel)
        assert ended(shared, happens, pages=how != "not demanded", virtual=how == "virtual time")[0] == "ok"
