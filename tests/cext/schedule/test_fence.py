"""A loop that is suspended between its check of the fence and its send: it shows this, and sends no second batch."""

import os
import threading
from contextlib import suppress

import pytest

from blocks.actuators import CubeMars
from blocks.actuators.mit_frames import DISABLE, ENABLE, NOTHING
from cext.memory.shared_state import SharedState
from cext.ring.rings import Line, Lines
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Diagram, compile
from tests.runtime.terminals import patient

pytestmark = pytest.mark.timing


def full_pipe():
    """(reading end, writing end) whose next write waits."""
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    with suppress(BlockingIOError):
        while True:
            os.write(writer, b"x" * 4096)
    with suppress(BlockingIOError):
        while True:
            os.write(writer, b"x")
    os.set_blocking(writer, True)
    return reader, writer


@pytest.mark.hazard("H8e")
def test_a_loop_that_is_held_in_a_send_shows_it_and_sends_only_its_stop_afterwards():
    with Diagram("robot", rate=200) as robot:
        CubeMars("AK10-9-V2.0", can_id=1, name="knee")(torque_command=1.0)
    schedule, shared, lines = compile(robot), SharedState(1 << 20), Lines(1)
    reader, bell = full_pipe()  # a send ends by ringing it
    line = Line(lines, 0, bell)
    executor = Executor(Program(schedule, [line.end]), 200, shared=shared, hosted=True)
    outcomes = []
    thread = threading.Thread(daemon=True, target=lambda: outcomes.append(executor.run(100, stopping_timeout=0.05)))
    thread.start()
    patient(lambda: shared.sending)
    shared.raise_fence()
    assert [data for _, data, _ in lines.take(0)] == [ENABLE] and shared.sending
    os.set_blocking(bell, False)  # for the sends after this one
    os.read(reader, 1 << 16)
    thread.join(20)
    after = [data for _, data, _ in lines.take(0)]
    assert outcomes[0].status == "fenced" and not shared.sending
    assert set(after) == {NOTHING, DISABLE} and after[-2:] == [NOTHING, DISABLE]
    os.close(reader)
    os.close(bell)
