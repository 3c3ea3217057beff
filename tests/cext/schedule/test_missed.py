"""Answers that do not come in time are counted: a command is missed where the next goes out before it was answered."""

from blocks.actuators import CubeMars
from cext.bus.memory_bus import MemoryBus
from cext.memory.shared_state import SharedState
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Diagram, compile

REPLY = bytes([1, 0x80, 0, 0x80, 0x08, 0, 70, 0])


def silent_robot():
    """A robot whose drive answers once, while it is armed, and never again."""
    with Diagram("robot", rate=200) as robot:
        CubeMars("AK10-9-V2.0", can_id=1, name="knee", timeout=0.0)(torque_command=0.0)
    bus = MemoryBus()
    bus.device.send(1, REPLY)
    return Program(compile(robot), [bus.host])


def test_every_command_but_the_last_counts_as_missed_for_a_silent_drive():
    program, shared = silent_robot(), SharedState(1 << 16)
    for _ in range(2):  # the second run counts from 0
        assert Executor(program, 200.0, virtual=True, shared=shared).run(100).status == "ok"
        assert program.reports.missed == {"knee": 99} and shared.lost_replies([0, 1]) == [99, 0]
        program = silent_robot()


def test_replies_missed_before_the_first_counted_tick_are_not_counted():
    program = silent_robot()
    program.count_from(60)
    Executor(program, 200.0, virtual=True).run(100)
    assert program.reports.missed == {"knee": 40}


def test_timely_replies_are_not_missed():
    with Diagram("robot", rate=200) as robot:
        CubeMars("AK10-9-V2.0", can_id=1, name="knee")(torque_command=0.0)
    with Diagram("plant", rate=1000) as plant:
        robot["knee"].emulator()(position=0.0, velocity=0.0)
    bus = MemoryBus()
    program = Program(compile(robot), [bus.host])
    drive = Program(compile(plant), [bus.device])
    Executor(program, 200.0, plant=drive, substeps=5, virtual=True).run(100)
    assert program.reports.missed == {"knee": 0}
