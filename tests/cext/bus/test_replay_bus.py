"""A recorded run that the executor runs again: whatever its ticks are, it ends."""

import time

import numpy as np
import pytest

from blocks.discrete import Integrator
from blocks.limiters import SlewRate
from cext.bus.replay_bus import ReplayClock
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Diagram, compile

pytestmark = pytest.mark.paced


def test_a_jump_in_the_ticks_of_a_recording_costs_no_time():
    with Diagram("jump", rate=200) as diagram:
        signal = Integrator()(1.0)
        SlewRate(rate=1.0)(signal)
    ticks = np.array([0, 1, 2, 10**12, 10**12 + 1])
    clock = ReplayClock(lambda: False, False)
    clock.give(ticks, np.zeros(5, dtype=np.int64))
    began = time.monotonic()
    outcome = Executor(Program(compile(diagram), []), 200.0, virtual=True, replay=clock).run()
    assert outcome.status == "ok" and outcome.tick == 10**12 + 1 and time.monotonic() - began < 1.0
