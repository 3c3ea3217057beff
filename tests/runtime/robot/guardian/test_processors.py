"""Where the threads of a run with real-time priority may be: the loop has a processor, and whoever stops the motors
finds one.
"""

import os
import time
from pathlib import Path

import psutil
import pytest

from tests.runtime.robot.guardian.bus import Bus, guardian_of

EVERYWHERE = os.sched_getaffinity(0)
pytestmark = [
    pytest.mark.timing,
    pytest.mark.skipif(os.geteuid() != 0 or len(EVERYWHERE) < 2, reason="needs real-time priority, and two processors"),
]


def threads(pid):
    """{name of a thread: processors that it may run on}"""
    tasks = Path(f"/proc/{pid}/task").iterdir()
    return {(task / "comm").read_text().strip(): os.sched_getaffinity(int(task.name)) for task in tasks}


def test_the_guardian_and_other_threads_avoid_the_processor_of_the_loop(tmp_path):
    """A process that dies is busy with that for milliseconds, on the processors of its threads: the guardian waits for
    none of them.
    """
    with Bus(tmp_path) as bus:
        run = bus.start("--realtime", "try")
        bus.await_torque()
        guardian = guardian_of(run)
        (recorder,) = (child for child in psutil.Process(run.pid).children() if child != guardian)
        loop = os.sched_getaffinity(run.pid)
        assert len(loop) == 1
        others = EVERYWHERE - loop
        assert threads(run.pid)["tickwork-watch"] == others
        assert threads(guardian.pid) == {"tickwork-guard": EVERYWHERE, "tickwork-death": EVERYWHERE}
        assert [threads(process.pid) for process in (recorder, *recorder.children())] == [
            {"tickwork-parts": others},
            {"tickwork-record": others},
        ]
        killed = time.time()
        run.kill()
        bus.listen(0.5)
        assert bus.stopped_after(killed) < 0.05
