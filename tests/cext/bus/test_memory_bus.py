"""The in-memory bus: what one end sends the other receives, in order, and a full queue loses and counts."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from blocks.actuators import CubeMars
from cext.bus.memory_bus import MemoryBus
from cext.schedule.program import Program
from graph import Diagram, compile
from tests.cext.rigs import Rig


def test_each_bus_end_receives_only_frames_of_the_other():
    bus = MemoryBus()
    assert bus.host.send(1, b"\x01\x02", time=5) and bus.device.send(0x12345, b"", extended=True)
    assert bus.device.receive() == [(1, False, b"\x01\x02", 5)] and bus.host.receive() == [(0x12345, True, b"", 0)]
    assert bus.host.receive() == bus.device.receive() == []


def test_a_frame_carries_up_to_64_bytes():
    bus = MemoryBus()
    assert bus.host.send(7, bytes(range(64))) and bus.device.receive() == [(7, False, bytes(range(64)), 0)]
    with pytest.raises(ValueError, match="a frame carries at most 64 bytes, not 65"):
        bus.host.send(7, bytes(65))


def test_full_queue_refuses_and_counts_frames_until_read():
    bus = MemoryBus()
    assert [bus.host.send(number, b"") for number in range(1030)] == [True] * 1024 + [False] * 6 and bus.dropped == 6
    assert [frame[0] for frame in bus.device.receive(3)] == [0, 1, 2]
    assert bus.host.send(2000, b"")
    assert [frame[0] for frame in bus.device.receive(2000)] == [*range(3, 1024), 2000] and bus.dropped == 6


@given(
    st.lists(st.tuples(st.sampled_from(["host", "device"]), st.one_of(st.none(), st.binary(max_size=64))), max_size=60)
)
def test_sent_frames_arrive_once_in_order(actions):
    bus, sent, heard = MemoryBus(), {"host": [], "device": []}, {"host": [], "device": []}
    for end, data in actions:
        if data is None:
            heard[end] += [frame[2] for frame in getattr(bus, end).receive(5)]
        else:
            getattr(bus, end).send(1, data)
            sent[end].append(data)
    for end in ("host", "device"):
        heard[end] += [frame[2] for frame in getattr(bus, end).receive()]
    assert heard == {"host": sent["device"], "device": sent["host"]}


def test_bus_ends_keep_their_bus_alive():
    end = MemoryBus().host
    assert end.send(1, b"x") and end.receive() == []


def test_frames_that_a_full_queue_refused_are_not_counted_as_sent():
    with Diagram("robot", rate=200) as robot:
        CubeMars("AK10-9-V2.0", can_id=1, name="knee", timeout=0.0)(torque_command=1.0)
    rig = Rig(robot)
    rig.buses["can"].device.send(1, bytes([1, 0x80, 0, 0x80, 0x08, 0, 70, 0]))
    assert rig.run(2000).status == "ok"  # nobody reads the other end
    assert rig.statistics()["frames"]["sent"] == 1024 == len(rig.sent())
    assert rig.buses["can"].dropped == 2000 + 2 * 40 - 1024


def test_program_requires_one_end_per_bus():
    with Diagram("robot", rate=200) as robot:
        for bus in ("a", "b"):
            CubeMars("AK80-9", bus=bus, name=bus)(torque_command=0.0)
    schedule = compile(robot)
    with pytest.raises(ValueError, match="the schedule has 2 buses, but 1 bus ends were given"):
        Program(schedule, [MemoryBus().host])
    with pytest.raises(TypeError):
        Program(schedule, [MemoryBus(), MemoryBus()])
