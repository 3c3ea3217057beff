"""Streams: one native thread reads every descriptor; the newest data wins, and lost lines reconnect."""

import os
import select
import socket
import termios
import time
import tty

import pytest

from cext.lines.streams import Streams

pytestmark = pytest.mark.paced

BYTES, LOST, BACK = 0, 1, 2
RING, AHEAD = 1024, 128  # frames, of cext/ring/newest_ring.pxd


@pytest.fixture
def streams():
    made = Streams()
    yield made
    made.end()


def until(condition, patience=2.0):
    deadline = time.monotonic() + patience
    while not condition():
        assert time.monotonic() < deadline, "it did not come"
        time.sleep(0.001)


def heard(stream, count, patience=2.0):
    """So many bytes, or what a while has brought."""
    found, deadline = b"", time.monotonic() + patience
    while len(found) < count and time.monotonic() < deadline:
        found += b"".join(data for kind, _, data, _ in stream.end.receive() if kind == BYTES)
        time.sleep(0.0005)
    return found


def raw_pty():
    """(master, path of the slave), raw, as pyserial opens one."""
    master, slave = os.openpty()
    tty.setraw(slave)
    path = os.ttyname(slave)
    return master, slave, path


def test_bytes_arrive_in_order_with_read_time(streams):
    here, there = socket.socketpair()
    stream = streams.add(here.fileno(), "imu")
    here.close()
    streams.start()
    began = time.monotonic_ns()
    stream.begin(began)
    sent = bytes(range(256)) * 3
    there.send(sent)
    until(lambda: stream.counts["bytes"] == len(sent))
    took = time.monotonic_ns() - began
    frames = stream.end.receive()
    assert b"".join(data for _, _, data, _ in frames) == sent
    assert all(kind == BYTES and len(data) <= 64 and 0 < when <= took for kind, _, data, when in frames)


def test_bytes_read_before_run_are_discarded(streams):
    here, there = socket.socketpair()
    stream = streams.add(here.fileno())
    streams.start()
    there.send(b"before")
    until(lambda: stream.counts["bytes"] == 6)
    stream.begin(time.monotonic_ns())
    there.send(b"within")
    assert heard(stream, 6) == b"within" and stream.end.receive() == []


def test_after_a_stall_the_newest_sample_is_used_and_the_others_are_counted(streams):
    here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    stream = streams.add(here.fileno())
    streams.start()
    sent = 3 * RING
    for number in range(sent):  # the tick stands still meanwhile
        there.send(number.to_bytes(4, "little"))
    until(lambda: stream.counts["bytes"] == 4 * sent)
    numbers = [int.from_bytes(data, "little") for _, _, data, _ in stream.end.receive(sent)]
    assert numbers == list(range(sent - RING + AHEAD, sent))
    assert stream.counts["overflows"] == sent - RING + AHEAD
    there.send(b"next")
    assert heard(stream, 4) == b"next"


def test_a_frame_holds_whole_records(streams):
    here, there = socket.socketpair()
    stream = streams.add(here.fileno(), record=24)
    streams.start()
    there.send(bytes(5 * 24))
    until(lambda: stream.counts["bytes"] == 120)
    assert [len(data) for _, _, data, _ in stream.end.receive()] == [48, 48, 24]


def test_an_empty_datagram_does_not_close_the_line(streams):
    here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    stream = streams.add(here.fileno())
    streams.start()
    there.send(b"")
    there.send(b"more")
    assert heard(stream, 4) == b"more" and not stream.gone


def test_bytes_sent_in_tick_are_written_at_once(streams):
    master, slave, path = raw_pty()
    stream = streams.add(slave)
    os.close(slave)
    streams.start()
    assert stream.end.send(0, b"\x75\x65\x01\x02\x02\x01\xe0\xc6")
    assert os.read(master, 64) == b"\x75\x65\x01\x02\x02\x01\xe0\xc6"
    os.close(master)


def test_full_line_does_not_block(streams):
    here, there = socket.socketpair()
    stream = streams.add(here.fileno())
    streams.start()
    began = time.monotonic()
    for _ in range(20000):
        stream.end.send(0, bytes(64))  # nobody reads
    assert time.monotonic() - began < 1.0 and stream.counts["refused"] > 0


def test_unplug_and_reconnect_are_reported_and_settings_restored(streams, tmp_path):
    by_id = tmp_path / "usb-imu-133931"
    master, slave, path = raw_pty()
    settings = termios.tcgetattr(slave)
    settings[4] = settings[5] = termios.B921600
    termios.tcsetattr(slave, termios.TCSANOW, settings)
    by_id.symlink_to(path)
    stream = streams.add(slave, "imu", path=by_id, setup=[b"idle", b"resume"], pause=0.005)
    os.close(slave)
    streams.start()
    os.write(master, b"one")
    assert heard(stream, 3) == b"one"
    os.close(master)
    until(lambda: stream.gone)
    by_id.unlink()
    assert [kind for kind, *_ in stream.end.receive()] == [LOST]
    assert stream.end.send(0, b"nobody hears this") and stream.counts["refused"] == 1
    time.sleep(0.15)  # an attempt that fails
    master, slave, path = raw_pty()
    by_id.symlink_to(path)
    until(lambda: not stream.gone)
    assert termios.tcgetattr(slave)[4] == termios.B921600
    said = b""
    while len(said) < 10:
        said += os.read(master, 64)
    assert said == b"idleresume"
    os.write(master, b"two")
    found = []
    until(lambda: found.extend(stream.end.receive()) or (found and found[-1][2] == b"two"))
    assert [kind for kind, *_ in found] == [BACK, BYTES]
    assert stream.counts["losses"] == stream.counts["returns"] == 1
    os.close(master)
    os.close(slave)


def test_a_line_that_does_not_return_does_not_affect_the_others(streams):
    (one, far), (two, near) = socket.socketpair(), socket.socketpair()
    lost, kept = streams.add(one.fileno(), "a"), streams.add(two.fileno(), "b")
    one.close()
    streams.start()
    far.close()
    until(lambda: lost.gone)
    near.send(b"still here")
    assert heard(kept, 10) == b"still here"


def test_an_idle_reader_thread_uses_little_processor_time(streams):
    master, slave, path = raw_pty()
    streams.add(slave, path=path)
    streams.start()
    before = time.process_time()
    time.sleep(0.2)
    assert time.process_time() - before < 0.02
    os.close(master)


def test_closed_line_is_released_and_keeps_its_last_bytes(streams):
    here, there = socket.socketpair()
    stream = streams.add(here.fileno())
    here.close()
    streams.start()
    there.send(b"last")
    until(lambda: stream.counts["bytes"] == 4)
    streams.end()
    stream.close()
    assert there.recv(1) == b"" and stream.end.receive()[0][2] == b"last"
    assert stream.end.send(0, b"to nobody") and stream.counts["refused"] == 1


def test_streams_end_and_can_be_started_again(streams):
    here, there = socket.socketpair()
    stream = streams.add(here.fileno())
    for word in (b"first", b"again"):
        streams.start()
        there.send(word)
        assert heard(stream, 5) == word
        streams.end()
    streams.end()


@pytest.fixture
def bridge():
    """A program that waits for a connection, and may be begun again at the same address."""

    class Bridge:
        def __init__(self):
            self.open = None
            self.begin(0)

        def begin(self, port):
            self.open = socket.socket()
            self.open.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self.open.bind(("127.0.0.1", port))
            self.open.listen(0)
            self.open.settimeout(5.0)
            self.port = self.open.getsockname()[1]

        def end(self):
            self.open.close()

    made = Bridge()
    yield made
    made.end()


def test_lost_connection_is_reopened_and_set_up_again(streams, bridge):
    here = socket.create_connection(("127.0.0.1", bridge.port))
    stream = streams.add(here.fileno(), "insole", reconnects=True, setup=(b"go\n",), pause=0.001)
    here.close()
    there, _ = bridge.open.accept()
    streams.start()
    stream.begin(time.monotonic_ns())
    there.send(b"before")
    assert heard(stream, 6) == b"before"
    there.close()
    bridge.end()
    until(lambda: stream.gone)
    time.sleep(0.15)  # an attempt is refused meanwhile
    assert stream.gone and stream.counts["losses"] == 1 and stream.counts["returns"] == 0
    bridge.begin(bridge.port)
    there, _ = bridge.open.accept()
    there.settimeout(2.0)
    assert there.recv(16) == b"go\n"
    there.send(b"after")
    until(lambda: stream.counts["bytes"] == 11)
    frames = [(kind, data) for kind, _, data, _ in stream.end.receive()]
    assert frames == [(LOST, b""), (BACK, b""), (BYTES, b"after")] and stream.counts["returns"] == 1
    there.close()


def test_unanswered_connection_delays_no_other_line(streams, bridge):
    """A queue that is full: whoever connects is neither taken nor refused."""
    here = socket.create_connection(("127.0.0.1", bridge.port))
    lost = streams.add(here.fileno(), "insole", reconnects=True)
    here.close()
    there, _ = bridge.open.accept()
    near, far = socket.socketpair()
    imu = streams.add(near.fileno(), "imu")
    near.close()
    waiting = []
    for _ in range(3):
        waiting.append(socket.socket())
        waiting[-1].setblocking(False)
        waiting[-1].connect_ex(("127.0.0.1", bridge.port))
    streams.start()
    imu.begin(time.monotonic_ns())
    there.close()
    until(lambda: lost.gone)
    worst = 0.0
    for number in range(60):  # the attempt begins meanwhile
        began = time.monotonic_ns()
        far.send(bytes((number,)))
        assert heard(imu, 1) == bytes((number,))
        worst = max(worst, 1e-9 * (time.monotonic_ns() - began))
        time.sleep(0.003)
    assert lost.gone and lost.counts["returns"] == 0 and worst < 0.5
    began = time.monotonic()
    streams.end()
    assert time.monotonic() - began < 0.5  # nor does it keep the thread from ending
    for one in (far, *waiting):
        one.close()


def test_connection_attempts_become_less_frequent(streams, bridge):
    """0.1, 0.2, 0.4 and 0.8 s after it was lost: who waits again after 0.5 s is not found before."""
    here = socket.create_connection(("127.0.0.1", bridge.port))
    stream = streams.add(here.fileno(), "insole", reconnects=True)
    here.close()
    bridge.open.accept()[0].close()
    bridge.end()
    streams.start()
    until(lambda: stream.gone)
    lost = time.monotonic()
    time.sleep(0.5)
    bridge.begin(bridge.port)
    until(lambda: not stream.gone)
    assert 0.7 < time.monotonic() - lost < 1.5 and stream.counts["returns"] == 1


def test_reconnected_device_is_accepted_after_identification(streams, tmp_path):
    """Asked in the middle of what it streams, and answered in two parts; a device with another reply is rejected."""
    link = tmp_path / "tty"
    master, slave, path = raw_pty()
    link.symlink_to(path)
    stream = streams.add(slave, "imu", path=str(link), setup=(b"go",), pause=0.001, proof=(b"who?", b"I am the first"))
    os.close(slave)
    streams.start()
    stream.begin(time.monotonic_ns())

    def plugged_in(*answers):
        nonlocal master
        os.close(master)
        until(lambda: stream.gone)
        link.unlink()
        master, slave, path = raw_pty()
        os.close(slave)
        link.symlink_to(path)
        os.set_blocking(master, False)
        asked = b""
        deadline = time.monotonic() + 2.0
        while b"who?" not in asked:
            assert time.monotonic() < deadline
            try:
                asked += os.read(master, 64)
            except OSError:  # nobody has it open yet
                time.sleep(0.001)
        for answer in answers:
            os.write(master, answer)
            time.sleep(0.02)

    plugged_in(b"x" * 700, b"I am the second")
    until(lambda: stream.counts["strangers"] == 1)
    assert stream.gone and stream.counts["bytes"] == 0
    plugged_in(b"x" * 700 + b"I am t", b"he first, ")
    until(lambda: not stream.gone and stream.counts["returns"] == 1)
    os.write(master, b"yyy")
    os.set_blocking(master, True)
    assert os.read(master, 64) == b"go" and heard(stream, 3) == b"yyy"
    os.close(master)


def test_a_terminal_that_was_not_read_has_the_newest_data(streams):
    """A port that no process has open keeps no data: a program that opens it receives replies."""
    master, slave, path = raw_pty()
    stream = streams.add(master)
    os.close(master)
    streams.start()
    for number in range(5000):
        assert stream.end.send(0, number.to_bytes(2, "little") * 30)
    assert stream.end.send(0, b"reply") and stream.counts["refused"] == 0
    received = b""
    while not received.endswith(b"reply") and select.select([slave], [], [], 2.0)[0]:
        received += os.read(slave, 65536)
    assert received.endswith(b"reply") and len(received) < 100_000
    os.close(slave)
