"""The thread of an I2C bus: what is asked when, over which channels, and what becomes of devices that fail. On chips in
memory, in real time.
"""

import errno
import time

import pytest

from cext.lines.i2c import I2cBus
from cext.lines.i2c_memory import MemoryI2c

pytestmark = pytest.mark.timing

IMU, BURST = 0x68, 0x3B
TROUBLE = 15
SET_UP = ((IMU, 0x6B, b"\x80", 0.005), (IMU, 0x6B, b"\x01", 0.005), (IMU, 0x19, b"\x04\x03", 0.0))
CHECK = (0x19, b"\x04\x03")


def reading(period=0.005, number=0, steps=((BURST, 14),), tail=b"", settle=0.0, address=IMU):
    return (period, settle, ((number, address, steps, tail),))


def place(mux, channel):
    return 1 + 8 * (mux - 0x70) + channel


def wait(condition, seconds=60.0):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "it did not happen"
        time.sleep(0.001)


def ready(wires, number):
    """As a chip is that has been set up."""
    wires.write(number, 0x6B, b"\x01")
    wires.write(number, 0x19, CHECK[1])
    wires.write(number, BURST, bytes(range(14)))


@pytest.fixture
def imu():
    """(wires, number of its chip, bus): one that is set up, and is asked at 200 Hz."""
    wires = MemoryI2c()
    number = wires.add(IMU)
    ready(wires, number)
    bus = I2cBus(wires)
    bus.add(0, IMU, SET_UP, CHECK, (reading(tail=b"\xaa"),))
    yield wires, number, bus
    bus.stop()


def answers(frames, transfer=0):
    return [frame for frame in frames if frame[0] >> 16 & 15 == transfer]


def received(bus, count, transfer=0):
    """Frames of a bus, once there are so many answers of a transfer."""
    frames = []
    wait(lambda: frames.extend(bus.end.receive()) or len(answers(frames, transfer)) >= count)
    return frames


def periods(frames):
    """Times in s from each frame to the next."""
    return [1e-9 * (later[3] - earlier[3]) for earlier, later in zip(frames, frames[1:])]


def test_each_reply_becomes_a_frame_with_its_suffix(imu):
    wires, number, bus = imu
    began = time.monotonic_ns()
    bus.begin(began)
    bus.start()
    frames = received(bus, 20)
    bus.stop()
    took = 1e-9 * (time.monotonic_ns() - began)
    assert len(frames) <= took / 0.005 + 2 and min(periods(frames)) < 0.0075
    assert all(frame[:3] == (IMU, True, bytes(range(14)) + b"\xaa") for frame in frames)
    times = [frame[3] for frame in frames]
    assert times == sorted(times) and 0 <= times[0] and times[-1] <= time.monotonic_ns() - began
    assert wires.of_chip(number)[1] == 0  # it is set up: nothing is written


def test_each_read_sequence_has_its_own_period():
    wires = MemoryI2c()
    wires.add(IMU)
    wires.add(0x0C)
    bus = I2cBus(wires)
    bus.add(0, IMU, rounds=(reading(0.005), reading(0.020, 1, ((0x02, 8),), address=0x0C)))
    began = time.monotonic()
    bus.start()
    frames = received(bus, 10, transfer=1)
    bus.stop()
    took = time.monotonic() - began
    told = bus.counts["devices"][0]
    frames += bus.end.receive()
    fast, slow = answers(frames), answers(frames, 1)
    assert len(fast) <= took / 0.005 + 2 and len(slow) <= took / 0.020 + 2 and len(fast) > 2 * len(slow)
    assert min(periods(fast)) < 0.0075 and min(periods(slow)) < 0.03
    assert told["answers"] == len(fast + slow) and told["rate"] == pytest.approx(len(fast) / took, rel=0.2)


@pytest.mark.parametrize(
    "muxes, channels, least",
    [
        ((0x70,), [(0x70, 1), (0x70, 4), (0x70, 6)], 2),
        ((0x70,), [(0x70, 3)], 0),
        ((0x70, 0x71), [(0x70, 1), (0x70, 4), (0x71, 0), (0x71, 2)], 4),  # and the other one is closed
    ],
)
def test_a_round_uses_the_fewest_channel_switches(muxes, channels, least):
    """Where n channels of one are in use, n - 1 in a round: each begins with the one that is open. Two devices a
    channel, and one before.
    """
    wires = MemoryI2c(muxes)
    bus = I2cBus(wires)
    for mux, channel in channels:
        for address in (0x68, 0x48):
            number = wires.add(address, place(mux, channel))
            wires.write(number, BURST, bytes((mux, channel, address)))
            bus.add(place(mux, channel), address, rounds=(reading(0.01, steps=((BURST, 3),), address=address),))
    number = wires.add(0x2A)
    bus.add(0, 0x2A, rounds=(reading(0.01, steps=((0, 1),), address=0x2A),))
    bus.start()
    wait(lambda: bus.counts["rounds"] >= 10)
    bus.stop()
    counts = bus.counts
    assert counts["switches"] == wires.switches
    # all others closed, every channel, and from one to the next
    first = len(muxes) - 1 + len(channels) + (len(muxes) - 1)
    assert counts["switches"] <= first + least * (counts["rounds"] - 1)
    frames = bus.end.receive()
    for identifier, _, data, _ in frames:
        if identifier & 0xFF != 0x2A:
            mux, channel, address = data
            assert identifier & 0xFFFF == place(mux, channel) << 8 | address  # never the answer of another channel's
    assert len({frame[0] for frame in frames}) == 2 * len(channels) + 1


def test_a_device_behind_a_closed_channel_is_not_read_through_another():
    """A multiplexer that does not answer: its devices fail, the one on the bus itself goes on."""
    wires = MemoryI2c()
    wires.add(0x2A)
    bus = I2cBus(wires)
    bus.add(place(0x70, 2), IMU, rounds=(reading(),))
    bus.add(0, 0x2A, rounds=(reading(0.005, steps=((0, 1),), address=0x2A),))
    bus.start()
    wait(lambda: bus.counts["devices"][0]["state"] == "lost" and bus.counts["devices"][1]["answers"] >= 3)
    assert bus.counts["devices"][0]["answers"] == 0 and bus.counts["devices"][0]["error"] == errno.EREMOTEIO
    bus.stop()


def test_silent_device_is_lost_and_set_up_again_on_return(imu):
    wires, number, bus = imu
    bus.begin(time.monotonic_ns())
    bus.start()
    wait(lambda: bus.counts["devices"][0]["answers"] > 3)
    wires.behave(number, absent=True)
    told = answers(received(bus, 3, TROUBLE), TROUBLE)
    wait(lambda: bus.counts["devices"][0]["state"] == "lost")
    assert [frame[2][0] for frame in told][:3] == [0, 0, 1] and told[2][2][1:] == b"\x03\x00\x00\x00"
    wires.clear(number)  # it has been without power
    wires.write(number, BURST, bytes(range(14)))
    wires.behave(number, absent=False)
    wait(lambda: bus.counts["devices"][0]["state"] == "fine" and answers(bus.end.receive()))
    assert wires.read(number, 0x6B) == b"\x01" and wires.read(number, 0x19, 2) == CHECK[1]
    counts = bus.counts["devices"][0]
    assert (counts["losses"], counts["returns"], counts["error"]) == (1, 1, errno.EREMOTEIO)
    bus.stop()


def test_after_one_failure_a_device_is_checked_but_not_configured_again(imu):
    wires, number, bus = imu
    bus.start()
    wait(lambda: bus.counts["devices"][0]["answers"] > 3)
    wires.behave(number, absent=True)
    wait(lambda: bus.counts["devices"][0]["failures"] == 1)
    wires.behave(number, absent=False)
    before = bus.counts["devices"][0]["answers"]
    wait(lambda: bus.counts["devices"][0]["answers"] > before + 3)
    assert wires.of_chip(number)[1] == 0 and bus.counts["devices"][0]["losses"] == 0
    bus.stop()


def test_device_that_lost_settings_is_detected(imu):
    """It was without power for a moment, and answers with the ranges that it has then."""
    wires, number, bus = imu
    bus.start()
    wait(lambda: bus.counts["devices"][0]["answers"] > 3)
    wires.write(number, 0x19, b"\x00\x00")
    before = bus.counts["devices"][0]["answers"]
    wait(lambda: wires.read(number, 0x19, 2) == CHECK[1])
    assert bus.counts["devices"][0]["answers"] - before < 60  # 0.3 s: a look every 100 ms, and 10 ms of set-up
    assert bus.counts["devices"][0]["error"] == -1
    bus.stop()


def test_hanging_device_delays_only_its_own_bus():
    """Each exchange with it takes 50 ms: the devices of the other bus are read as before."""
    buses = []
    for slow in (0.05, 0.0):
        wires = MemoryI2c()
        first, second = wires.add(IMU), wires.add(0x2A)
        wires.behave(first, slow=slow, stuck=slow > 0.0)
        bus = I2cBus(wires)
        bus.add(0, IMU, rounds=(reading(),))
        bus.add(0, 0x2A, rounds=(reading(0.005, steps=((0, 1),), address=0x2A),))
        buses.append((bus, second))
    for bus, _ in buses:
        bus.start()
    held, free = (lambda bus=bus: bus.counts["devices"] for bus, _ in buses)
    wait(lambda: held()[0]["state"] == "lost" and held()[1]["answers"] >= 8)  # it is asked between the attempts
    early = free()[0]["answers"], held()[1]["answers"]
    wait(lambda: free()[0]["answers"] >= 60)
    for bus, _ in buses:
        bus.stop()
    assert held()[0]["answers"] == 0 and held()[0]["error"] == errno.ETIMEDOUT
    assert early[0] > early[1] and free()[0]["failures"] == 0  # three attempts of 50 ms, and each 5 ms


def test_other_devices_are_read_while_one_starts_up():
    wires = MemoryI2c()
    slow = wires.add(0x69)
    wires.add(IMU)
    wires.behave(slow, absent=True)
    bus = I2cBus(wires)
    bus.add(0, 0x69, ((0x69, 0x6B, b"\x80", 30.0), (0x69, 0x6B, b"\x01", 0.0)), rounds=(reading(address=0x69),))
    bus.add(0, IMU, rounds=(reading(),))
    bus.start()
    wait(lambda: bus.counts["devices"][0]["state"] == "lost")
    wires.behave(slow, absent=False)
    wait(lambda: bus.counts["devices"][0]["state"] == "setting up")
    before = bus.counts["devices"][1]["answers"]
    wait(lambda: bus.counts["devices"][1]["answers"] - before >= 12)
    assert bus.counts["devices"][0]["state"] == "setting up"
    bus.stop()


def test_conversions_are_sequential_and_have_their_own_times():
    """Registers of two bytes: what was converted is read with what it was converted with, then the next begins."""
    wires = MemoryI2c()
    number = wires.add(0x48, wide=True)
    wires.write(number, 0, b"\x12\x34\xc3\xe3")
    bus = I2cBus(wires)
    names = (0xD3E3, 0xC3E3)
    bus.add(
        0,
        0x48,
        rounds=(
            (
                0.005,
                0.005,
                tuple((at, 0x48, ((0, 2), (1, 2), (1, word.to_bytes(2, "big"))), b"") for at, word in enumerate(names)),
            ),
        ),
    )
    bus.start()
    wait(lambda: bus.counts["devices"][0]["answers"] >= 6)
    bus.stop()
    frames = bus.end.receive()
    assert [frame[2].hex() for frame in frames[:4]] == ["1234c3e3", "1234d3e3", "1234c3e3", "1234d3e3"]
    gaps = [(b[3] - a[3]) * 1e-9 for a, b in zip(frames, frames[1:])]
    assert min(gaps) >= 0.005


def test_failures_are_counted_from_the_beginning_of_the_run(imu):
    wires, number, bus = imu
    wires.behave(number, absent=True)
    bus.start()
    wait(lambda: bus.counts["devices"][0]["failures"] >= 4)
    bus.begin(time.monotonic_ns())
    wait(lambda: len(bus.end.receive()) > 0 or bus.counts["devices"][0]["failures"] >= 6)
    before = bus.counts["devices"][0]["failures"]
    wait(lambda: bus.counts["devices"][0]["failures"] > before)
    told = answers(bus.end.receive(), TROUBLE)
    assert told and int.from_bytes(told[-1][2][1:], "little") < before
    bus.stop()


def test_a_delayed_tick_reads_the_newest_sample():
    wires = MemoryI2c()
    number = wires.add(IMU)
    bus = I2cBus(wires)
    bus.add(0, IMU, rounds=(reading(0.0002, steps=((0, 1),)),))
    bus.start()
    wait(lambda: bus.counts["devices"][0]["answers"] > 1200)  # more than a ring holds
    wires.write(number, 0, b"\x77")
    before = bus.counts["devices"][0]["answers"]
    wait(lambda: bus.counts["devices"][0]["answers"] > before + 5)
    bus.stop()
    frames = bus.end.receive()
    while more := bus.end.receive():
        frames += more
    assert frames[-1][2] == b"\x77" and len(frames) <= 1024 and bus.counts["overflows"] > 0


@pytest.mark.parametrize(
    "place, address, rounds",
    [
        (99, IMU, ()),
        (0, 0x80, ()),
        (0, IMU, (reading(0.0),)),
        (0, IMU, (reading(number=15),)),
        (0, IMU, (reading(steps=((0, 33),)),)),
        (0, IMU, (reading(steps=((0, 32), (0, 32)), tail=b"1"),)),
        (0, IMU, (reading(steps=()),)),
    ],
)
def test_invalid_address_or_reads_are_refused(place, address, rounds):
    with pytest.raises(ValueError):
        I2cBus(MemoryI2c()).add(place, address, rounds=rounds)


def test_chips_in_memory_are_reached_as_on_a_wire():
    wires = MemoryI2c((0x70,))
    for k, channel in enumerate((1, 2)):
        wires.write(wires.add(IMU, place(0x70, channel)), 0x75, bytes((0x71 + 2 * k,)))
    with pytest.raises(OSError) as refused:
        wires.exchange_bytes(IMU, 0x75, count=1)
    assert refused.value.errno == errno.EREMOTEIO
    # two open at once pull the line low together
    for mask, wanted in ((b"\x02", 0x71), (b"\x04\x04", 0x73), (b"\x06", 0x71 & 0x73)):
        wires.exchange_bytes(0x70, -1, mask)
        assert wires.exchange_bytes(IMU, 0x75, count=1)[0] == wanted


def test_another_kind_of_chip_after_a_loss_is_rejected():
    wires = MemoryI2c()
    number = wires.add(IMU)
    ready(wires, number)
    wires.write(number, 0x75, b"\x71")
    bus = I2cBus(wires)
    bus.add(0, IMU, SET_UP, CHECK, (reading(),), ((0x75, 0x71, 0xFF),))
    bus.start()
    told = lambda: bus.counts["devices"][0]  # noqa: E731
    wait(lambda: told()["answers"] > 2)
    wires.behave(number, absent=True)
    wait(lambda: told()["state"] == "lost")
    wires.write(number, 0x75, b"\x68")  # it takes the same settings, and keeps them
    wires.behave(number, absent=False)
    wait(lambda: told()["error"] == -2)
    answers = told()["answers"]
    time.sleep(0.15)
    assert told()["answers"] == answers and told()["returns"] == 0
    wires.write(number, 0x75, b"\x71")
    wait(lambda: told()["returns"] == 1 and told()["answers"] > answers)
    bus.stop()
