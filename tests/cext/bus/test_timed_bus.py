"""A wire with a bitrate: every frame takes its bits, one at a time, the lowest id first."""

import pytest

from blocks.actuators import CubeMars
from cext.bus.bits import frame_bits
from cext.bus.memory_bus import MemoryBus
from cext.bus.timed_bus import SlowBus, TimedBus
from cext.memory.shared_state import SharedState
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Diagram, compile
from tests.cext.rigs import plant_of

LATER = 10**9


def microseconds(identifier, data, extended=False):
    return 1000 * frame_bits(identifier, data, extended)[0]


def test_a_frame_arrives_when_its_last_bit_has_passed_and_not_before():
    bus = TimedBus(1e6)
    data = bytes.fromhex("8000800000000800")
    assert bus.host.send(1, data, time=5000)
    bus.host.advance(5000 + 124_999)
    assert bus.device.receive() == []
    bus.host.advance(5000 + 125_000)
    assert bus.device.receive() == [(1, False, data, 130_000)] and bus.host.receive() == []
    assert (bus.carried, bus.busy) == (1, pytest.approx(125e-6))


def test_at_half_the_bitrate_it_takes_twice_as_long():
    bus = TimedBus(500e3)
    bus.host.send(1, b"")
    bus.host.advance(LATER)
    assert bus.device.receive()[0][3] == 2 * microseconds(1, b"")


def test_can_fd_sends_its_data_at_the_data_bitrate():
    """64 bytes of 0x55, without stuffed bits: 30 bits of 1 µs, and 5 + 512 + 4 + 21 + 7 bits of 0.2 µs."""
    bus = TimedBus(1e6, 5e6)
    bus.host.send(0x555, bytes([0x55]) * 64)
    bus.host.send(0x555, b"\x55")  # classic
    bus.host.advance(LATER)
    first, second = (frame[3] for frame in bus.device.receive())
    assert first == 30_000 + 200 * 549 and second - first == microseconds(0x555, b"\x55")
    with pytest.raises(ValueError, match="data bitrate"):
        TimedBus(1e6, 5e5)


def test_queued_frames_are_sent_in_order():
    bus = TimedBus(1e6)
    for number in (3, 2, 1):
        bus.host.send(number, b"\x55")
    bus.host.advance(LATER)
    ends = [sum(microseconds(number, b"\x55") for number in (3, 2, 1)[: count + 1]) for count in range(3)]
    # one node has one queue
    assert [(frame[0], frame[3]) for frame in bus.device.receive()] == list(zip((3, 2, 1), ends))


def test_lowest_id_wins_arbitration_without_preemption():
    bus = TimedBus(1e6)
    bus.device.send(7, b"", time=0)
    bus.device.send(5, b"", time=10)  # while 7 is on the wire
    bus.device.send(3, b"", time=10)
    bus.host.send(4, b"", time=10)
    bus.host.advance(LATER)
    assert [frame[0] for frame in bus.host.receive()] == [7, 3, 5]
    [(_, _, _, end)] = bus.device.receive()
    assert end == sum(microseconds(number, b"") for number in (7, 3, 4))


def test_a_standard_frame_beats_an_extended_one_of_the_same_first_bits():
    bus = TimedBus(1e6)
    bus.device.send(0x100 << 18, b"", extended=True)
    bus.device.send(0x100, b"")
    bus.device.send(0x0FF << 18 | 0x3FFFF, b"", extended=True)
    bus.host.advance(LATER)
    assert [(frame[0], frame[1]) for frame in bus.host.receive()] == [
        (0x0FF << 18 | 0x3FFFF, True),
        (0x100, False),
        (0x100 << 18, True),
    ]


def test_frames_sent_at_one_instant_take_part_in_its_arbitration():
    bus = TimedBus(1e6)
    bus.host.send(2, b"", time=1000)
    bus.host.advance(1000)
    bus.device.send(1, b"", time=1000)
    bus.host.advance(LATER)
    assert bus.host.receive()[0][3] < bus.device.receive()[0][3]


def test_a_queue_is_bounded_and_counts_rejected_frames():
    bus = TimedBus(1e6)
    assert [bus.host.send(1, b"") for _ in range(1030)] == [True] * 1024 + [False] * 6 and bus.dropped == 6
    with pytest.raises(ValueError, match="bitrate must be above 0"):
        TimedBus(0.0)


def test_a_fast_bus_is_slowed_to_its_bitrate():
    """An answer, too, goes out only when it has passed."""
    real = MemoryBus()
    slow = SlowBus(real.device, 1e6)
    real.host.send(1, b"\x01", time=0)
    assert slow.end.receive() == []
    step = microseconds(1, b"\x01")
    slow.end.advance(step)
    assert [frame[0] for frame in slow.end.receive()] == [1]
    slow.end.send(2, b"\x02", time=step)
    slow.end.receive()
    assert real.host.receive() == []
    slow.end.advance(step + microseconds(2, b"\x02"))
    slow.end.receive()
    assert [frame[:3] for frame in real.host.receive()] == [(2, False, b"\x02")]


def test_replies_arrive_after_their_transmission_time():
    with Diagram("robot", rate=200) as robot:
        CubeMars("AK10-9-V2.0", can_id=1, name="knee")(torque_command=1.0)
    bus, schedule, plant = TimedBus(1e6), compile(robot), compile(plant_of(robot))
    shared = SharedState(1 << 20)
    executor = Executor(
        Program(schedule, [bus.host]),
        schedule.rate,
        plant=Program(plant, [bus.device]),
        substeps=5,
        shared=shared,
        virtual=True,
    )
    assert executor.run(20).status == "ok" and bus.carried >= 40
    assert shared.statistics()["frames"]["received"] >= 20
