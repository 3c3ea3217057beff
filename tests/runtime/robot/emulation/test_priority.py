"""Real-time priority of an emulator."""

import os
import threading

import pytest

from runtime.host.machine.realtime import PRIORITY as PRIORITY_OF_RUN
from runtime.robot.emulation.priority import PRIORITY, priority_of_loop, take_priority


def permitted():
    """Whether this process may take the priority, tried on a thread that ends."""
    policies = []
    thread = threading.Thread(target=lambda: policies.append((take_priority(), os.sched_getscheduler(0))[1]))
    thread.start()
    thread.join()
    return policies[0] & os.SCHED_FIFO


def test_loop_has_a_priority_below_a_run_and_returns_it():
    if not permitted():
        pytest.skip("needs the privilege of a real-time priority")
    before = os.sched_getscheduler(0), os.sched_getparam(0).sched_priority
    with priority_of_loop():
        assert os.sched_getscheduler(0) == os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
        assert os.sched_getparam(0).sched_priority == PRIORITY < PRIORITY_OF_RUN
    assert (os.sched_getscheduler(0), os.sched_getparam(0).sched_priority) == before


def test_without_the_privilege_the_thread_stays_ordinary(monkeypatch):
    def refuse(*arguments):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    before = os.sched_getscheduler(0)
    take_priority()
    assert os.sched_getscheduler(0) == before
