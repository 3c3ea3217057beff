"""Time from the tick of a run to a subscriber of ROS 2, beside that of a bare publisher of Zenoh.

The router, the subscriber and the bare publisher are processes of their own, and the run is the command in real time.
Chunks of both take turns. The publisher sends messages of the same number and size, at the same rate.
"""

from __future__ import annotations

import io
import json
import os
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

import runtime
from runtime.host.console.progress import rounds
from runtime.host.errors import BadInput
from runtime.host.system import end_with_parent

RATE = 200  # Hz
DOMAIN = 9  # ROS_DOMAIN_ID
BRIDGE, BARE = "a run", "Zenoh alone"
SETTLED = 0.5  # s after the first message, until the connections exist and the code of all processes is in memory

ROBOT = """
from blocks.families import benchmark
from blocks.sinks import Ros2
from blocks.sources import Sine
from graph import Diagram

with Diagram("exo", rate={rate}) as diagram:
    for number in range(1, {joints} + 1):
        typical = benchmark("can")
        typical.block(**typical.parameters, bus="legs", can_id=number, name=f"joint{{number}}")(
            torque_command=Sine(amplitude=1.0)()
        )
    for number in range({sensors}):
        benchmark("stream").block(str(number), channels=("accel", "gyro", "quaternion"), name=f"imu{{number}}")
    Ros2(router="{place}", domain={domain})
"""


@dataclass
class Times:
    """Times in s, one number for each message."""

    before: list[float] = field(default_factory=list)  # from the grid time of its tick to the call of `put`
    after: list[float] = field(default_factory=list)  # from the call to the subscriber
    loads: list[float] = field(default_factory=list)  # load average, of each chunk
    late: list[float] = field(default_factory=list)  # of `before`, until the loop had woken for that tick; of the run
    added: list[float] = field(default_factory=list)  # the rest of it: the work of the tick, and the bridge


@contextmanager
def helper(role: str, *words: str) -> Iterator[subprocess.Popen[bytes]]:
    """Start a process of tests.bench.ros2_process that is ready, and end it."""
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.bench.ros2_process", role, *words],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        preexec_fn=end_with_parent,
        cwd=Path(__file__).parents[2],
    )
    assert process.stdout is not None
    try:
        if process.stdout.readline() != b"ready\n":
            raise BadInput(f"the {role} did not start; is eclipse-zenoh installed?")
        yield process
    finally:
        process.kill()
        process.communicate()


def measure(seconds: float, repeats: int, joints: int, sensors: int) -> tuple[dict[str, Times], list[int]]:
    """Measure both in turn. Returns ({BRIDGE, BARE: Times}, size of each message of a tick in bytes).

    seconds, repeats : duration of a chunk, and number of chunks of each
    joints, sensors : actuators and inertial sensors of the run
    """
    results, sizes = {BRIDGE: Times(), BARE: Times()}, []
    with socket.socket() as free:
        free.bind(("localhost", 0))
        place = f"tcp/localhost:{free.getsockname()[1]}"
    with helper("router", place), tempfile.TemporaryDirectory() as folder:
        robot = Path(folder) / "robot.py"
        robot.write_text(ROBOT.format(rate=RATE, joints=joints, sensors=sensors, place=place, domain=DOMAIN))
        for number in rounds("measuring", repeats):
            for name in (BRIDGE, BARE) if number % 2 == 0 else (BARE, BRIDGE):
                if name == BARE and not sizes:
                    sizes = chunk(results[BRIDGE], place, seconds, robot, Path(folder))
                    continue
                found = chunk(results[name], place, seconds, robot if name == BRIDGE else None, Path(folder), sizes)
                sizes = sizes or found
    return results, sizes


def chunk(
    times: Times, place: str, seconds: float, robot: Path | None, folder: Path, sizes: list[int] | None = None
) -> list[int]:
    """Add the messages of one chunk. Returns the size of each message of a tick. robot : None for Zenoh alone"""
    trial = None
    with helper("subscriber", place, str(DOMAIN)) as subscriber:
        if robot is None:
            words = [place, str(DOMAIN), str(RATE), str(round(seconds * RATE)), json.dumps(sizes)]
            with helper("publisher", *words) as publisher:
                publisher.wait()
        else:
            with redirect_stdout(io.StringIO()):
                trial = runtime.run(robot, seconds, fast=False, record=str(folder / "recordings"))
        times.loads.append(os.getloadavg()[0])
        listed = json.loads(subscriber.communicate(b"\n")[0])  # [grid time, time of `put`, arrival, bytes], ns
    measured = np.array([row[:3] for row in listed], dtype=np.int64)
    if not len(measured):
        raise BadInput("no message arrived")
    grid, put, arrival = measured[measured[:, 0] >= measured[0, 0] + round(SETTLED * 1e9)].T
    times.before += ((put - grid) * 1e-9).tolist()
    times.after += ((arrival - put) * 1e-9).tolist()
    if trial is not None:  # the last message is of the last tick
        ticks = trial.tick[-1] - np.rint((grid[-1] - grid) * 1e-9 * RATE).astype(int)
        late = trial.lateness[np.searchsorted(trial.tick, ticks)]
        times.late += late.tolist()
        times.added += ((put - grid) * 1e-9 - late).tolist()
    return [row[3] for row in listed if row[0] == listed[-1][0]]
