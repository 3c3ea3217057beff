"""A tick allocates nothing: however long it runs, a native loop leaves no block of memory and a Python one none that
stays.
"""

import gc
import os
import sys
import tracemalloc
from pathlib import Path

import pytest

from blocks.controllers import Impedance
from blocks.discrete import UnitDelay
from blocks.filters import Butterworth
from blocks.limiters import SlewRate, TorqueLimiter
from blocks.mathematics import Gain, Sum
from blocks.sources import Sine
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Block, Diagram, Input, Output, compile
from tests.cext.rigs import one_drive


class Python(Block):
    """Numbers, a vector and a whole number, in and out."""

    u = Input("any")
    y = Output("any")
    pair = Output("any", shape=(2,))
    count = Output("1", dtype=int)

    def step(self, u, tick):
        return 0.5 * u, (u, u), tick


class Reads(Block):
    """Reads them."""

    pair = Input("any", shape=(2,))
    count = Input("1", dtype=int)

    def step(self, pair, count):
        return None


def chain(python):
    with Diagram("d", rate=1000) as diagram:
        delay = UnitDelay()
        signal = SlewRate(3.0)(Butterworth(cutoff=30.0)(Sum("++")(Sine(frequency=2.0).y, delay.y)))
        if python:
            block = Python()
            block(signal)
            Reads()(block.pair, block.count)
            signal = block.y
        delay(Gain(0.5)(signal))
    return diagram


def growth(action):
    """Blocks of memory that one call leaves behind, once it has been called before."""
    action()
    action()
    gc.collect()
    before = sys.getallocatedblocks()
    action()
    gc.collect()
    return sys.getallocatedblocks() - before


@pytest.mark.parametrize("python", [False, True])
def test_a_hundred_thousand_ticks_leak_no_memory(python):
    program = Program(compile(chain(python)))
    executor = Executor(program, 1000.0, virtual=True)
    ticks = 20_000 if python else 100_000
    assert growth(lambda: executor.spin(ticks)) < 20


def test_native_ticks_trace_no_allocation_at_all():
    executor = Executor(Program(compile(chain(False))), 1000.0, virtual=True)
    executor.spin(10)
    tracemalloc.start()
    try:
        executor.spin(10)
        few = tracemalloc.get_traced_memory()[1]
        tracemalloc.reset_peak()
        executor.spin(100_000)
        many = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert many <= few + 1024


def test_the_memory_of_the_process_does_not_grow():
    """Rows and frames into the ring included, until it is full."""

    def resident():
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")

    rig = one_drive(lambda knee: TorqueLimiter(limit=5.0, slew=50.0)(Impedance()(knee.position, knee.velocity, 0.2)))
    rig.executor.run(10_000)
    before = resident()
    rig.executor.run(200_000)
    assert abs(resident() - before) <= 2**20


def test_a_robot_with_its_plant_leaks_no_memory():
    rig = one_drive(lambda knee: TorqueLimiter(limit=5.0, slew=50.0)(Impedance()(knee.position, knee.velocity, 0.2)))
    assert growth(lambda: rig.executor.run(2000)) < 50
