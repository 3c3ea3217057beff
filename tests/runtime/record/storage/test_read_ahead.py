"""Threads work on the next chunks while the reader takes the last one, in order and within a limit of memory."""

import threading

import pytest

from runtime.record.storage import read_ahead
from runtime.record.storage.read_ahead import ahead


@pytest.fixture(autouse=True)
def cores(monkeypatch):
    monkeypatch.setattr(read_ahead.os, "sched_getaffinity", lambda process: {0, 1, 2})


def test_results_are_in_order_and_computed_by_several_threads_at_a_time():
    meeting = threading.Barrier(3, timeout=10.0)

    def work(item):
        meeting.wait()  # each of three threads has an item
        return threading.get_ident(), item

    results = [*ahead(work, range(9), lambda item: 1)]
    assert [item for _, item in results] == [*range(9)] and len({thread for thread, _ in results}) == 3
    assert threading.get_ident() not in {thread for thread, _ in results}


def test_one_processor_works_without_threads(monkeypatch):
    monkeypatch.setattr(read_ahead.os, "sched_getaffinity", lambda process: {0})
    threads = [*ahead(lambda item: threading.get_ident(), range(3), lambda item: 1)]
    assert threads == 3 * [threading.get_ident()]


@pytest.mark.parametrize("size, waiting", [(read_ahead.BYTES_LIMIT // 2, 2), (10 * read_ahead.BYTES_LIMIT, 1)])
def test_no_more_results_wait_than_memory_allows(size, waiting):
    begun = []
    results = ahead(begun.append, range(20), lambda item: size)
    for taken in range(20):
        next(results)
        assert len(begun) <= taken + 1 + waiting
    assert sorted(begun) == [*range(20)]


def test_exception_is_raised_after_the_results_before_it_and_ends_the_work():
    def work(item):
        if item == 4:
            raise ValueError("damaged")
        return item

    results = ahead(work, range(1000), lambda item: read_ahead.BYTES_LIMIT // 8)
    assert [next(results) for _ in range(4)] == [0, 1, 2, 3]
    with pytest.raises(ValueError, match="damaged"):
        next(results)
    assert [*results] == []


def test_reader_that_stops_ends_the_threads():
    before = threading.active_count()
    results = ahead(lambda item: item, range(1000), lambda item: 1)
    assert next(results) == 0
    results.close()
    assert threading.active_count() == before
