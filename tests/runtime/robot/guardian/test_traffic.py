"""What else is on the wires of a run: its own frames handed back, and nodes that babble."""

import re
import signal
import subprocess
import sys
import time
from contextlib import suppress

import psutil
import pytest

from runtime.robot.emulation.priority import priority_of_loop
from tests.runtime.robot.guardian.bus import Bus, guardian_of
from tests.runtime.robot.rig.test_udp import Button, free_port
from tests.runtime.runs import ROOT

pytestmark = pytest.mark.timing

TRIES = 3  # until a run is fast: another process may have the processor for a moment in one that ends early

# Sends a frame that is for nobody, or datagrams that are no frames, as fast as it can.
BABBLING = {
    "udp_multicast": """
import can, sys
from runtime.robot.guardian.wires import keep_apart
bus = can.Bus(sys.argv[1], interface="udp_multicast")
keep_apart(bus.fileno())
message = can.Message(arbitration_id=0x555, is_extended_id=False, data=b"babble")
print(flush=True)
while True:
    bus.send(message)
""",
    "udp": """
import socket, struct, sys
to = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
frames = struct.pack("<IB3x8s", 0x555, 6, b"babble"), b"what is this"
print(flush=True)
while True:
    for frame in frames:
        to.sendto(frame, ("127.0.0.1", int(sys.argv[1])))
""",
}
BUTTON = "from blocks.safety import EStopHeartbeat; EStopHeartbeat(name='button', timeout=1.0)"
LOAD = re.compile(r"  load +[\d.]+ % of the time inside ticks, ([\d.]+) (µs|ms) per tick at p99")


class Babbler:
    """A process that sends as fast as it can."""

    def __init__(self, kind, where):
        words = [sys.executable, "-c", BABBLING[kind], str(where)]
        self.process = subprocess.Popen(words, cwd=ROOT, stdout=subprocess.PIPE)

    def __enter__(self):
        self.process.stdout.readline()  # it has begun
        return self

    def __exit__(self, *exception):
        self.process.kill()
        self.process.communicate()


def in_a_tick(out):
    """s that a tick took, at the 99th percentile, from the summary."""
    number, unit = LOAD.search(out).groups()
    return float(number) * {"µs": 1e-6, "ms": 1e-3}[unit]


TOLERANCE = 0.002  # s between the clock of the test and the times in the CAN log


def test_recorded_frames_have_the_time_of_the_wire_though_the_loop_and_the_guardian_are_late(bus, tmp_path):
    """The loop is 10 ms late in every fifth tick, and the guardian pauses for 8 ms after each frame."""
    for folder in ("first", "second", "third"):  # without the priority the pause can be long enough to end the run
        process = bus.start("--record", folder, "--can-log", law="time.sleep(0.005 if tick % 5 == 0 else 0.0)")
        bus.await_torque()
        with priority_of_loop():
            sent = stamped(bus, guardian_of(process))
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=20)
        bus.listen(0.1)
        if process.returncode == 130:
            break
    assert process.returncode == 130, err[-2000:]
    recorded = received_in(*(tmp_path / folder).glob("*.can.log"))
    for number, (before, after) in enumerate(sent):
        at = recorded[0x500 + number, b"stamp".hex().upper()][0]
        assert before - TOLERANCE < at < after + TOLERANCE, (number, at - before, after - before)
    answers = [(frame.time, frame.identifier) for frame in bus.frames if frame.identifier < 3 and not frame.is_command]
    for motor in (1, 2):
        on_the_wire = [at for at, identifier in answers if identifier == motor]
        times = sorted(at for (identifier, _), found in recorded.items() if identifier == motor for at in found)
        apart = [min(abs(at - other) for other in on_the_wire) for at in times]
        assert len(times) > 30 and max(apart) < TOLERANCE, max(apart)


def stamped(bus, guardian):
    """Send ten frames, each while the guardian stands still. Returns s of the wall clock before and after each."""
    times = []
    for number in range(10):
        with suppress(psutil.NoSuchProcess):
            guardian.send_signal(signal.SIGSTOP)
            before = time.time()
            bus.send(0x500 + number, b"stamp")
            times.append((before, time.time()))
            time.sleep(0.008)
            guardian.send_signal(signal.SIGCONT)
        bus.listen(0.06)
    return times


def received_in(log):
    """{(id, data in hex digits): s of the wall clock} of the frames that a CAN log has as received."""
    found = {}
    for line in log.read_text().splitlines():
        at, _, frame, direction = line.split()
        if direction == "R":
            identifier, data = frame.split("#")
            found.setdefault((int(identifier, 16), data), []).append(float(at.strip("()")))
    return found


@pytest.fixture
def bus(tmp_path):
    with Bus(tmp_path, number=6) as bus:
        yield bus


def counted(out, what):
    found = re.search(rf"(\d+) {what}", out)
    return int(found[1]) if found else 0


def test_echoed_commands_are_counted_and_ignored(tmp_path):
    """Commands without a position begin with 7F. On this interface each is echoed, and looks like a reply of drive
    127.
    """
    with Bus(tmp_path, number=3, motors=(126, 127)) as bus:
        process = bus.start(
            "--no-record", "--duration", "0.5", "--set", "left/knee.can_id=127", "--set", "right/knee.can_id=126"
        )
        out, err = process.communicate(timeout=20)
        sent = counted(out, "frames sent")
        assert process.returncode == 0, err
        # On a loaded machine the echoes of the last 50 ms, 20 frames, can arrive after the run has stopped reading.
        assert sent > 200 and sent - 20 <= counted(out, "echoed") <= sent
        assert "confirmed by left/knee, right/knee" in out and counted(out, "malformed") == 0


def test_a_node_that_floods_a_bus_of_the_guardian_does_not_delay_a_tick(tmp_path):
    times = []
    while not times or times[-1] >= 0.005 and len(times) < TRIES:
        with Bus(tmp_path, number=4) as bus:
            process = bus.start("--no-record", "--duration", "2")
            bus.await_torque()
            with Babbler("udp_multicast", bus.channel):
                out, err = process.communicate(timeout=20)
        assert counted(out, "foreign") > 100
        # The drives of this test, and the guardian, may be kept from their answers: then the run has ended in its stop,
        # and in words.
        assert process.returncode == 0 or "no reply for longer than its timeout" in err or "guardian" in err
        times.append(in_a_tick(out))
    assert times[-1] < 0.005, times


def test_a_udp_flood_neither_delays_a_tick_nor_hides_a_press(tmp_path):
    port = free_port()
    with Button(port) as button, Bus(tmp_path, number=5) as bus:
        bus.rig.write_text(bus.rig.read_text() + f'[bus.estop]\ninterface = "udp"\nchannel = "127.0.0.1:{port}"\n')
        process = bus.start("--no-record", more=BUTTON)
        bus.await_torque()
        with Babbler("udp", port):
            bus.listen(0.5)
            button.press()
            at = time.time()
            while process.poll() is None and time.time() < at + 20.0:
                bus.listen(0.05)  # or what waits to be read here leaves no room for the end of it
            out, err = process.communicate(timeout=20)
            bus.listen(0.2)
        assert (
            process.returncode == 3
            and counted(out, "foreign") > 100
            and counted(out, "corrupt") > 100
            and in_a_tick(out) < 0.005
        )
        assert "FAULT at " in err and bus.stopped_after(at) < 1.5
