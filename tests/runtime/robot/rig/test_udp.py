"""UDP as a bus: channels, what keeps one from being opened, and an emergency-stop button over it that ends a run on
another bus.
"""

import os
import socket
import statistics
import struct
import subprocess
import sys
import threading
import time

import pytest

from blocks.actuators import CubeMars
from blocks.safety import EStopHeartbeat
from cext.bus.socketcan import SocketCan
from graph import Diagram
from runtime.host.errors import FAULT, OK
from runtime.robot.emulation.priority import take_priority
from runtime.robot.rig.buses import RigBuses
from runtime.robot.rig.errors import RigError
from runtime.robot.rig.file import RigBus, read
from runtime.robot.rig.udp import Endpoint, UdpInterface, addresses, failure_in_words, owner_of
from tests.runtime.robot.guardian.bus import Bus
from tests.runtime.runs import DISABLE, NOTHING, ROOT, finished, write

pytestmark = pytest.mark.paced

CAN_FRAME = struct.Struct("<IB3x8s")


def free_port(family=socket.AF_INET):
    with socket.socket(family, socket.SOCK_DGRAM) as probe:
        probe.bind(("::1" if family == socket.AF_INET6 else "127.0.0.1", 0))
        return probe.getsockname()[1]


class Button:
    """A button that sends its heartbeat every 10 ms, as the sender in docs/reference/emergency_stop.md does."""

    def __init__(self, port, host="127.0.0.1"):
        self.address, self.counter, self.pressed, self.over = (host, port), 0, False, threading.Event()
        self.socket = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_DGRAM)
        self.thread = threading.Thread(target=self.beat, daemon=True)

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *exception):
        self.silence()
        self.socket.close()

    def silence(self):
        self.over.set()
        self.thread.join()

    def beat(self):
        take_priority()
        while not self.over.wait(0.01):
            self.send()

    def send(self):
        self.counter += 1
        self.socket.sendto(
            CAN_FRAME.pack(0x100, 2, bytes([self.counter % 256, 0x00 if self.pressed else 0x5A])), self.address
        )

    def press(self):
        """Returns the time of the wall clock at which it is pressed."""
        self.pressed = True
        now = time.time()
        self.send()
        return now


# Channels


@pytest.mark.parametrize(
    "text, found",
    [
        ("0.0.0.0:9871", ("0.0.0.0", 9871)),
        ("127.0.0.1:1", ("127.0.0.1", 1)),
        ("[::]:65535", ("::", 65535)),
        ("[::1]:9871", ("::1", 9871)),
    ],
)
def test_a_channel_is_an_address_and_a_port(text, found):
    assert Endpoint(text) == found


@pytest.mark.parametrize(
    "text, why",
    [
        ("9871", "expected ADDRESS:PORT"),
        ("::1:9871", "expected ADDRESS:PORT"),
        ("localhost:9871", "is not an IP address"),
        ("0.0.0.0:", "is not a port"),
        ("0.0.0.0:0", "is not a port"),
        ("0.0.0.0:65536", "is not a port"),
        ("0.0.0.0:٣", "is not a port"),
        ("[0.0.0.0]:9871", "IPv6"),
        ("", "expected"),
    ],
)
def test_invalid_address_is_reported(text, why, tmp_path):
    with pytest.raises(ValueError, match=why):
        Endpoint(text)
    rig = write(tmp_path, f'[bus.estop]\ninterface = "udp"\nchannel = "{text}"\n', "lab.toml")
    with pytest.raises(RigError, match="TW102"):
        read(rig)


def test_unsupported_keys_are_reported(tmp_path):
    rig = write(
        tmp_path,
        '[bus.estop]\ninterface = "udp"\nchannel = "0.0.0.0:9871"\nfd = true\npeer = "button"\n'
        '[bus.legs]\ninterface = "socketcan"\nchannel = "can0"\npeer = "127.0.0.1:9"\n',
        "lab.toml",
    )
    with pytest.raises(RigError) as raised:
        read(rig)
    assert [trouble.message for trouble in raised.value.problems] == [
        "[bus.estop] peer = 'button': expected ADDRESS:PORT",
        "[bus.estop] fd = true: UDP carries classic CAN frames only",
        "[bus.legs] peer: only valid for UDP",
    ]


# Opening


def refusal(tmp_path, channel, build=EStopHeartbeat):
    with Diagram("robot", rate=100) as robot:
        build()
    rig = read(write(tmp_path, f'[bus.estop]\ninterface = "udp"\nchannel = "{channel}"\n', "lab.toml"))
    with pytest.raises(RigError) as raised:
        RigBuses(rig, robot, ["estop"]).close()
    [trouble] = raised.value.problems
    return trouble


@pytest.mark.parametrize("family, host", [(socket.AF_INET, "127.0.0.1"), (socket.AF_INET6, "::1")])
def test_port_in_use_is_reported_with_its_process(tmp_path, family, host):
    with socket.socket(family, socket.SOCK_DGRAM) as other:
        other.bind((host, 0))
        port = other.getsockname()[1]
        trouble = refusal(tmp_path, f"[{host}]:{port}" if ":" in host else f"{host}:{port}")
    assert (
        trouble.code == "TW121"
        and f"UDP port {port} is in use by " in trouble.message
        and f"(process {os.getpid()})" in trouble.message
    )
    assert owner_of(port) == ""


def test_address_of_another_machine_is_reported_with_local_addresses(tmp_path):
    trouble = refusal(tmp_path, "198.51.100.7:9871")
    assert (
        trouble.code == "TW122"
        and "198.51.100.7 is not an address of this machine; it has " in trouble.message
        and "127.0.0.1" in trouble.message
    )
    assert trouble.hint == 'write channel = "0.0.0.0:9871" for any of its addresses' and "127.0.0.1" in addresses()


def test_privileged_port_is_reported(tmp_path):
    """As an ordinary user, in a process of its own that gives its rights away."""
    start = int(open("/proc/sys/net/ipv4/ip_unprivileged_port_start").read())
    if start <= 80:
        pytest.skip("every port is for everybody here")
    script = f"""
import os, sys
sys.path.insert(0, {str(ROOT)!r})
from runtime.robot.rig.file import RigBus
from runtime.robot.rig.errors import Refused
from runtime.robot.rig.udp import UdpInterface
if os.getuid() == 0:
    os.setgroups([]); os.setgid(65534); os.setuid(65534)
try:
    UdpInterface(RigBus("estop", "udp", "127.0.0.1:80"), [])
except Refused as refused:
    print(refused.problem)
"""
    said = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=ROOT).stdout
    assert said.startswith("error TW123 privileged port: [bus.estop] port 80 is privileged") and "9871" in said


def test_an_actuator_is_refused_there(tmp_path):
    trouble = refusal(
        tmp_path, "127.0.0.1:9871", lambda: CubeMars("AK80-9", bus="estop", name="knee")(torque_command=0.0)
    )
    assert trouble.code == "TW105" and "cannot carry knee: the guardian could not stop it" in trouble.message


# Frames


@pytest.fixture
def bus():
    port = free_port()
    interface = UdpInterface(RigBus("estop", "udp", f"127.0.0.1:{port}"), [])
    can = SocketCan(interface.socket, shared=True, mute=True)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.connect(("127.0.0.1", port))
        yield can, sender
    interface.close()


def test_invalid_datagrams_are_counted(bus):
    can, sender = bus
    can.begin(time.monotonic_ns())
    for data in (
        b"",
        b"\0",
        bytes(15),
        bytes(17),
        bytes(72),
        CAN_FRAME.pack(0x100, 9, bytes(8)),
        b"hello, is this the button?",
    ):
        sender.send(data)
    sender.send(CAN_FRAME.pack(0x100, 2, b"\x07\x5a"))
    sender.send(CAN_FRAME.pack(0x80000000 | 0x12345, 8, bytes(range(8))))
    frames = [frame for _ in range(20) for frame in can.end.receive(1)]
    assert [frame[:3] for frame in frames] == [(0x100, False, b"\x07\x5a"), (0x12345, True, bytes(range(8)))]
    assert can.counts["corrupt"] == 7 and all(0 <= frame[3] < 1e9 for frame in frames)


def test_datagram_before_run_is_not_a_reply(bus):
    can, sender = bus
    for _ in range(100):
        sender.send(CAN_FRAME.pack(0x100, 2, b"\x07\x5a"))
    can.begin(time.monotonic_ns())
    assert can.end.receive() == []


def test_nothing_is_sent_without_a_peer(bus):
    can, _ = bus
    assert not can.end.send(0x200, b"hello") and can.trouble is None and can.counts["refused"] == 0


def test_peer_is_the_only_destination_and_source():
    port = free_port()
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger,
    ):
        peer.bind(("127.0.0.1", 0))
        peer.settimeout(1.0)
        named = RigBus("estop", "udp", f"127.0.0.1:{port}", peer=f"127.0.0.1:{peer.getsockname()[1]}")
        interface = UdpInterface(named, [])
        can = SocketCan(interface.socket, shared=True)
        assert can.end.send(0x200, b"hello") and peer.recv(100) == CAN_FRAME.pack(0x200, 5, b"hello")
        stranger.sendto(CAN_FRAME.pack(0x100, 2, b"\x01\x5a"), ("127.0.0.1", port))
        peer.sendto(CAN_FRAME.pack(0x100, 2, b"\x02\x5a"), ("127.0.0.1", port))
        assert [frame[2] for frame in can.end.receive(2) + can.end.receive(2)] == [b"\x02\x5a"]
        peer.close()
        can.end.send(0x200, b"")  # the system hears here that nobody listens
        can.end.receive()
        assert failure_in_words(can.trouble, named)[0] == f"no program receives at {named.peer}"
        interface.close()


# Runs

MORE = "from blocks.safety import EStopHeartbeat; EStopHeartbeat(name='button', timeout=0.3)"
PATIENT = 0.03  # s: a generous bound for six ticks of 5 ms, on a machine that others use


def robot_and_button(folder, port, host="127.0.0.1"):
    bus = Bus(folder)
    channel = f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
    bus.rig.write_text(bus.rig.read_text() + f'[bus.estop]\ninterface = "udp"\nchannel = "{channel}"\n')
    return bus


def pressed(folder, port, *words):
    """A run that is ended by a press: (s from the press to the last drive's disable as a third party sees it, return
    code, standard error).
    """
    with Button(port) as button, robot_and_button(folder, port) as bus:
        process = bus.start(*words, more=MORE)
        bus.await_torque()
        bus.listen(0.2)
        at = button.press()
        bus.listen(2.0, lambda frame: frame.data == DISABLE)
        bus.listen(0.3)
        _, errors = process.communicate(timeout=10)
        return bus.stopped_after(at), process.returncode, errors


def test_a_press_stops_the_drives_of_another_bus_at_once_and_its_recording_runs_again(tmp_path):
    took, code, errors = pressed(tmp_path, free_port())
    print(f"from the press to the last disable: {took * 1e3:.1f} ms")
    assert code == FAULT and "FAULT at button, tick " in errors and "the emergency stop was pressed" in errors
    assert took < 10 * PATIENT
    [recording] = (tmp_path / "recordings").glob("*.mcap")
    replayed = finished("replay", recording, cwd=tmp_path)
    assert replayed.returncode == OK and "are the same, bit for bit" in replayed.stdout, replayed.stderr


@pytest.mark.soak
def test_a_silent_button_stops_the_drives_after_its_timeout(tmp_path):
    port = free_port(socket.AF_INET6)
    with Button(port, "::1") as button, robot_and_button(tmp_path, port, "::1") as bus:
        process = bus.start("--no-record", more=MORE)
        bus.await_torque()
        bus.listen(0.2)
        button.silence()
        at = time.time()
        bus.listen(2.0, lambda frame: frame.data == DISABLE)
        bus.listen(0.3)
        _, errors = process.communicate(timeout=10)
        assert (
            process.returncode == FAULT
            and "FAULT at button, tick " in errors
            and ("no reply for longer than its timeout (0.3 s)") in errors
        )
        assert 0.25 < bus.stopped_after(at) < 0.3 + 10 * PATIENT


def test_nothing_is_armed_without_the_button(tmp_path):
    with robot_and_button(tmp_path, free_port()) as bus:
        process = bus.start("--no-record", more=MORE)
        _, errors = process.communicate(timeout=20)
        bus.listen(0.1)
        assert process.returncode == FAULT
        # of a machine that stood still
        assert "no reply from button (id 256 on bus estop)" in errors or "fenced by the guardian" in errors
        assert all(not frame.is_command or frame.data in (DISABLE, NOTHING) for frame in bus.frames)


@pytest.mark.soak
def test_the_latency_of_fifty_button_presses_is_printed(tmp_path):
    """Prints the distribution; asserts what any machine keeps."""
    took = []
    for number in range(50):
        folder = tmp_path / str(number)
        folder.mkdir()
        seconds, code, _ = pressed(folder, free_port(), "--no-record")
        assert code == FAULT
        took.append(seconds * 1e3)
    print(
        f"from the press to the last disable, 50 presses: min {min(took):.1f}, median "
        f"{statistics.median(took):.1f}, max {max(took):.1f} ms"
    )
    assert statistics.median(took) < 1e3 * PATIENT and max(took) < 10e3 * PATIENT
