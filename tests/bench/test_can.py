"""`python -m tests.bench can`. The speed of this machine is not tested."""

import json
import shutil
import signal
import sysconfig
import time

import numpy as np
import pytest

from cext.bus.memory_bus import MemoryBus
from cext.bus.socketcan import SocketCan
from cext.schedule.bus_cost import time_of_control
from cext.schedule.program import Program
from graph import Block, Diagram, Output, compile
from runtime.host.errors import OK
from tests.bench import can_cost
from tests.bench.c_program import build
from tests.blocks.running import player, run

pytestmark = pytest.mark.soak

needs_compiler = pytest.mark.skipif(
    shutil.which(sysconfig.get_config_var("CC").split()[0]) is None, reason="needs a C compiler"
)


@needs_compiler
def test_bench_can_reports_drive_cost_and_lost_replies(bench):
    code, out, err = bench("can", "--rounds", "100", "--seconds", "0.1", "--repeats", "1", "--json")
    report = json.loads(out)
    assert (code, err) == (OK, "")
    found = report["can"]
    for name in ("native_us", "socket_us", "calls_us"):
        assert 0.0 < found[name]["p50"] <= found[name]["p99"] <= found[name]["max"], name
    for contender in ("tickwork", "c"):
        assert (
            found["motors"][contender]["commands"] == 8 * 80 and 0 <= found["motors"][contender]["unanswered"] <= 8 * 80
        )
    assert [goal["unit"] for goal in report["goals"]] == ["µs per tick", ""]


@needs_compiler
def test_the_c_loop_counts_every_missing_reply():
    loop = build(can_cost.C_LOOP)
    with can_cost.ends() as first, can_cost.ends() as second:
        far = [SocketCan(pair[1]) for pair in (first, second)]
        missed, lost = can_cost.c_chunk(loop, [first[0], second[0]], 4, 60)
        heard = [len(can.end.receive()) for can in far]
    assert 8 * (40 - lost) <= missed <= 8 * 40 and heard == [4 * (60 - lost)] * 2


def test_the_native_tick_sends_a_command_to_every_drive():
    bus = MemoryBus()
    assert len(time_of_control(Program(compile(can_cost.robot()), [bus.host]), bus.device, can_cost.ANSWERS, 5)) == 5


class Slow(Block):
    """A busy machine: each tick takes 1 ms more."""

    y = Output("1")

    def step(self):
        time.sleep(0.001)
        return 1.0


def test_slow_ticks_are_measured_although_no_drive_follows():
    bus, diagram = MemoryBus(), can_cost.robot()
    with diagram:
        Slow()
    program = Program(compile(diagram), [bus.host])
    assert min(time_of_control(program, bus.device, can_cost.ANSWERS, 300)) > 1_000_000


def test_motors_that_pause_for_a_second_miss_replies_and_end_no_measurement():
    diagram, pause = can_cost.robot(1, 1), np.zeros(1500, bool)
    pause[200:1200] = True
    with Diagram("motors", rate=can_cost.RATE) as motors:
        drive = diagram["drive01"].emulator()
        drive(position=0.0, velocity=0.0, silent=player(pause, "1", bool))
    assert run(diagram, 1500, plant=motors).outcome.status == "ok"


def test_a_signal_ends_a_measurement_in_the_middle():
    bus, began = MemoryBus(), time.monotonic()
    program = Program(compile(can_cost.robot()), [bus.host])
    before = signal.signal(signal.SIGALRM, lambda number, frame: 1 / 0)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.05)
        with pytest.raises(ZeroDivisionError):
            time_of_control(program, bus.device, can_cost.ANSWERS, 300_000_000)
    finally:
        signal.signal(signal.SIGALRM, before)
    assert time.monotonic() - began < 30.0


def test_a_fault_of_a_drive_names_it():
    bus, late = MemoryBus(), [(can_id, bytes([can_id]) + bytes(6) + b"\x08") for can_id in range(1, 9)]
    with pytest.raises(OSError, match="ended in tick 0: device fault at drive01"):
        time_of_control(Program(compile(can_cost.robot()), [bus.host]), bus.device, late, 1)


def test_a_tick_with_a_lost_frame_is_not_counted():
    program = Program(compile(can_cost.robot()), [MemoryBus().host])
    with pytest.raises(ValueError, match="1 to 64 frames, not 0"):
        time_of_control(program, MemoryBus().device, [], 1)
    with pytest.raises(OSError, match="ended in tick 0: 0 of 8 commands arrived"):
        time_of_control(program, MemoryBus().device, can_cost.ANSWERS, 1)  # the far end of another bus
