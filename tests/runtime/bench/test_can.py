"""`python -m runtime bench can`: that it measures what it says. How fast this machine is, is not tested."""

import json
import shutil
import socket
import sysconfig

import pytest

from cext.bus.memory_bus import MemoryBus
from cext.bus.socketcan import SocketCan
from cext.schedule.bus_cost import time_of_control
from cext.schedule.program import Program
from graph import compile
from runtime.base.errors import OK
from runtime.bench import can_cost, python_can
from runtime.bench.by_hand import build

pytestmark = pytest.mark.timing

needs_compiler = pytest.mark.skipif(
    shutil.which(sysconfig.get_config_var("CC").split()[0]) is None, reason="needs a C compiler"
)


@needs_compiler
def test_it_tells_what_drives_cost_and_what_motors_lose(command_line):
    code, out, err = command_line("bench", "can", "--rounds", "100", "--seconds", "0.1", "--repeats", "1", "--json")
    told = json.loads(out)
    assert (code, err) == (OK, "")
    found = told["can"]
    for name in ("native_us", "socket_us", "calls_us", "python_can_us"):
        assert 0.0 < found[name]["p50"] <= found[name]["p99"] <= found[name]["max"], name
    for who in ("tickwork", "c"):
        assert found["motors"][who]["commands"] == 8 * 80 and 0 <= found["motors"][who]["unanswered"] <= 8 * 80
    assert [goal["unit"] for goal in told["goals"]] == ["µs a tick", "times", ""]


@needs_compiler
def test_a_loop_in_c_counts_every_answer_that_nobody_gives():
    loop = build(can_cost.C_LOOP)
    with can_cost.ends() as first, can_cost.ends() as second:
        far = [SocketCan(pair[1]) for pair in (first, second)]
        missed, lost = can_cost.c_chunk(loop, [first[0], second[0]], 4, 60)
        heard = [len(can.end.receive()) for can in far]
    assert 8 * (40 - lost) <= missed <= 8 * 40 and heard == [4 * (60 - lost)] * 2


def test_the_native_tick_sends_a_command_for_every_drive_and_python_can_the_same_bytes():
    """Zero torque at tick 0, and from then on what the sine says."""
    bus = MemoryBus()
    assert len(time_of_control(Program(compile(can_cost.robot()), [bus.host]), bus.device, can_cost.ANSWERS, 5)) == 5
    assert python_can.pack(0.0) == bytes.fromhex("7fff7ff0000007ff")
    with can_cost.ends() as (own, other):
        took = python_can.time_of_ticks(own, SocketCan(other).end, can_cost.ANSWERS, 3)
    assert len(took) == 3 and min(took) > 0.0


def test_a_tick_that_loses_a_frame_is_no_measurement():
    program = Program(compile(can_cost.robot()), [MemoryBus().host])
    with pytest.raises(ValueError, match="1 to 64 frames, not 0"):
        time_of_control(program, MemoryBus().device, [], 1)
    with pytest.raises(OSError, match="0 of 8 frames came"):
        time_of_control(program, MemoryBus().device, can_cost.ANSWERS, 1)  # the far end of another bus


def test_python_can_waits_for_answers_in_vain(monkeypatch):
    monkeypatch.setattr(python_can, "PATIENCE", 0.05)
    with can_cost.ends() as (own, _), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as nobody:
        nobody.bind(("127.0.0.1", 0))
        nobody.connect(("127.0.0.1", 9))
        with pytest.raises(OSError, match="an answer was lost"):
            python_can.time_of_ticks(own, SocketCan(nobody, mute=True).end, can_cost.ANSWERS, 1)
