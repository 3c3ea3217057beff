"""The calls to Linux that Python does not have, each by itself."""

import errno
import resource
import subprocess
import sys
import threading

import pytest

from cext.clock import realtime
from tests.test_packaging import ROOT

pytestmark = pytest.mark.timing


def in_a_thread(work):
    """What `work` returns in a thread of its own."""
    found = []
    thread = threading.Thread(target=lambda: found.append(work()))
    thread.start()
    thread.join()
    return found[0]


def test_timer_slack_is_of_one_thread_and_has_a_default():
    def change():
        before = realtime.timer_slack()
        realtime.set_timer_slack(1)
        least = realtime.timer_slack()
        realtime.set_timer_slack(0)
        return before, least, realtime.timer_slack()

    here = realtime.timer_slack()
    before, least, after = in_a_thread(change)
    assert (least, after) == (1, before) and before == here == realtime.timer_slack()


def test_short_slice_applies_to_one_thread_and_is_restored():
    def change():
        before = realtime.slice_length()
        realtime.set_slice(100_000)
        short = realtime.slice_length()
        realtime.set_slice(0)
        return before, short, realtime.slice_length()

    before, short, after = in_a_thread(change)
    if before == 0:
        pytest.skip("this Linux has no slices of single threads: it came with 6.12")
    assert short == 100_000 < before == after == realtime.slice_length()


def test_touched_stack_is_mapped():
    """In a thread with its own unused stack: touching it faults it in once, and not again."""

    def faults():
        return resource.getrusage(resource.RUSAGE_THREAD).ru_minflt

    def touch():
        before = faults()
        realtime.prefault_stack(512 << 10)
        first = faults()
        realtime.prefault_stack(512 << 10)
        return first - before, faults() - first

    size = threading.stack_size(16 << 20)
    try:
        first, again = in_a_thread(touch)
    finally:
        threading.stack_size(size)
    assert first > 0 and again == 0


def test_prefault_accepts_stack_without_size():
    realtime.prefault_stack(0)
    realtime.prefault_stack(-1)


RELEASED = """
import ctypes, mmap
from cext.clock import realtime
memory = mmap.mmap(-1, 3 * mmap.PAGESIZE, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
begin = ctypes.addressof(ctypes.c_char.from_buffer(memory))
middle, end = begin + mmap.PAGESIZE, begin + 3 * mmap.PAGESIZE
assert ctypes.CDLL(None).munmap(ctypes.c_void_p(middle), ctypes.c_size_t(mmap.PAGESIZE)) == 0
for writable in (False, True):
    realtime.prefault(begin, end, writable)
import os; os._exit(0)
"""


def test_prefault_leaves_out_memory_that_was_released():
    """Between the reading of the mappings and their use, a mapping can go."""
    assert subprocess.run([sys.executable, "-c", RELEASED], cwd=ROOT).returncode == 0


def test_memory_that_is_not_locked_can_be_unlocked():
    realtime.unlock_memory()


def test_only_one_thread_is_watched_at_a_time():
    realtime.watch_for_spinning()
    try:
        with pytest.raises(OSError) as refused:
            realtime.watch_for_spinning()
        assert refused.value.errno == errno.EBUSY
    finally:
        assert realtime.stop_watching() is False
    assert realtime.stop_watching() is False
