"""How long each device takes to answer a command, on a rig: a histogram of its own, in constant memory."""

import time

import pytest

from cext.memory.shared_state import SharedState
from tests.cext.rigs import one_drive

pytestmark = pytest.mark.timing


def test_only_a_rig_in_real_time_times_answers():
    rig = one_drive(lambda knee: 0.0)
    rig.run(20)
    assert rig.control.reports.latencies == {}


def test_a_reply_is_timed_once_from_the_preceding_command():
    shared = SharedState(1 << 20)
    shared.look_after(time.monotonic_ns())
    rig = one_drive(lambda knee: 0.0, virtual=False, options={"shared": shared, "guard": 5.0})
    outcome = rig.run(100)
    found = rig.control.reports.latencies["knee"]
    assert outcome.status == "ok"
    # The emulated drive answers at the end of the tick that commands it, with the time of the grid. The last answer is
    # heard by the safe stop.
    assert found["count"] == 100 - shared.statistics()["missed"]
    again = rig.run(50)
    assert again.status == "ok" and rig.control.reports.latencies["knee"]["count"] == 50 - shared.statistics()["missed"]
