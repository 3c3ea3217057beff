"""A robot on a real I2C bus, and what it has read."""

import struct

from cext.memory.shared_state import RECORD_ROW, SharedState
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import compile


def newest(diagram, interface, ticks):
    """{path: value} of the last of so many ticks, on a runtime.robot.rig.i2c.I2cInterface, which is closed then."""
    schedule = compile(diagram)
    shared = SharedState(1 << 20)
    interface.start(0)
    try:
        outcome = Executor(Program(schedule, [interface.end]), schedule.rate, shared=shared).run(ticks)
    finally:
        interface.close()
    assert outcome.status == "ok", (outcome, interface.counts)
    row = struct.Struct(f"={2 + len(schedule.columns)}d")
    last = [row.unpack(payload) for kind, payload in shared.drain(1 << 30) if kind == RECORD_ROW][-1]
    return {column.path: last[2 + column.index] for column in schedule.sinks[0].columns}
