"""Parsing in several threads at once."""

import gc
import threading
import time

import pytest

from graph.syntax import parse

DEEP = "+".join(["(" * 20 + "1" + ")" * 20] * 3) + "\n" + "-" * 60 + "x\n"


class Cycle:
    """Garbage whose finalizer lets another thread run."""

    def __init__(self):
        self.own = self

    def __del__(self):
        time.sleep(0)


@pytest.fixture
def busy_collector():
    """The collector runs often enough to switch threads in the middle of a tree."""
    before = gc.get_threshold()
    gc.set_threshold(3)
    yield
    gc.set_threshold(*before)


def test_threads_that_parse_at_once_do_not_disturb_each_other(busy_collector):
    failures = []

    def parse_often():
        for _ in range(150):
            Cycle()
            try:
                parse(DEEP)
            except SystemError as error:
                failures.append(error)

    threads = [threading.Thread(target=parse_often) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not failures
