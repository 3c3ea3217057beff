"""Ctrl-C ends a stop that continues, also in a process that was started with SIGINT blocked."""

import os
import signal

import pytest

from runtime.host.ending import ENDING_SIGNALS
from runtime.session.armed import caught_signals


@pytest.mark.hazard("H8f")
@pytest.mark.parametrize("number", ENDING_SIGNALS)
def test_a_signal_that_was_blocked_ends_a_stop_that_continues(number):
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, [number])
    try:
        with caught_signals() as caught:
            os.kill(os.getpid(), number)
        assert caught == [number] and number in signal.pthread_sigmask(signal.SIG_BLOCK, [])
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
