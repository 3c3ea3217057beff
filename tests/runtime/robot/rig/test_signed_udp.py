"""Signed datagrams of an emergency-stop button: real sockets, a process that verifies, and recorded datagrams."""

import hashlib
import hmac
import os
import socket
import time
from contextlib import suppress

import pytest

from blocks.safety import EStopHeartbeat
from cext.bus.socketcan import SocketCan
from graph import Diagram
from runtime.host.errors import FAULT
from runtime.host.signed_datagrams import Receiver, Signer, open_datagram, read_key, seal_datagram
from runtime.robot.rig.bus import RigBus
from runtime.robot.rig.buses import RigBuses
from runtime.robot.rig.errors import RigError
from runtime.robot.rig.file import read
from runtime.robot.rig.udp import UdpInterface
from tests.runtime.robot.guardian.bus import Bus
from tests.runtime.robot.rig.test_udp import CAN_FRAME, MORE, PATIENT, Button, free_port
from tests.runtime.runs import DISABLE, write

KEY, OTHER = bytes(range(32)), bytes(32)
RELEASED = CAN_FRAME.pack(0x100, 2, b"\x07\x5a")


def test_a_datagram_is_the_frame_the_session_a_number_and_half_an_hmac_of_them():
    content = RELEASED + b"sessions" + (258).to_bytes(8, "little")
    assert seal_datagram(KEY, RELEASED, b"sessions", 258) == content + hmac.digest(KEY, content, hashlib.sha256)[:16]
    assert open_datagram(KEY, seal_datagram(KEY, RELEASED, b"sessions", 258)) == (RELEASED, b"sessions", 258)


def test_one_changed_bit_or_another_key_or_size_makes_a_datagram_invalid():
    datagram = seal_datagram(KEY, RELEASED, b"sessions", 258)
    for bit in range(8 * len(datagram)):
        changed = bytearray(datagram)
        changed[bit // 8] ^= 1 << bit % 8
        assert open_datagram(KEY, bytes(changed)) is None
    for other in (b"", RELEASED, datagram[:-1], datagram + b"\0"):
        assert open_datagram(KEY, other) is None
    assert open_datagram(OTHER, datagram) is None


def test_a_sender_adopts_the_session_of_its_receiver_and_nothing_is_accepted_twice():
    receiver, sender = Receiver(KEY), Signer(KEY)
    frame, reply = receiver.frame(sender.datagram(RELEASED))
    assert frame is None and len(reply) == 16
    sender.note(b"something else"), sender.note(reply)
    sent = [sender.datagram(RELEASED) for _ in range(5)]
    assert [receiver.frame(each)[0] for each in sent] == [RELEASED] * 5
    assert [receiver.frame(each) for each in sent] == [(None, None)] * 5  # repeated, in this run
    later, [newest] = Receiver(KEY), sent[-1:]
    assert later.frame(newest)[0] is None  # repeated, in another run
    assert Receiver(OTHER).frame(newest) == (None, None)  # no reply to a stranger


@pytest.fixture
def key_file(tmp_path):
    path = tmp_path / "estop.key"
    path.write_text(KEY.hex() + "\n")
    path.chmod(0o600)
    return path


def test_a_key_that_others_can_read_or_that_is_none_is_refused(tmp_path, key_file):
    assert read_key(key_file) == KEY

    def problem(change):
        change()
        with Diagram("robot", rate=100) as robot:
            EStopHeartbeat()
        words = f'[bus.estop]\ninterface = "udp"\nchannel = "127.0.0.1:{free_port()}"\nkey = "estop.key"\n'
        with pytest.raises(RigError) as raised:
            RigBuses(read(write(tmp_path, words, "lab.toml")), robot, ["estop"]).close()
        [trouble] = raised.value.problems
        assert trouble.code == "TW139" and "openssl rand -hex 32" in trouble.hint and KEY.hex() not in str(trouble)
        return trouble.message

    assert "other accounts may read it (mode 640)" in problem(lambda: key_file.chmod(0o640))
    key_file.chmod(0o600)
    assert "expected 64 hex digits" in problem(lambda: key_file.write_text("password"))
    assert "No such file" in problem(key_file.unlink)


@pytest.mark.parametrize(
    "more, why",
    [
        ('interface = "udp"\nchannel = "0.0.0.0:9"\npeer = "127.0.0.1:9"', "peer and key exclude each other"),
        ('interface = "socketcan"\nchannel = "can0"', "key: only valid for UDP"),
    ],
)
def test_a_key_belongs_to_udp_without_a_peer(tmp_path, more, why):
    with pytest.raises(RigError, match=why):
        read(write(tmp_path, f'[bus.estop]\n{more}\nkey = "estop.key"\n', "lab.toml"))


class SignedButton(Button):
    """A button that signs, and keeps what it has sent."""

    def __init__(self, port, key=KEY):
        super().__init__(port)
        self.signer, self.sent = Signer(key), []

    def send(self):
        self.counter += 1
        frame = CAN_FRAME.pack(0x100, 2, bytes([self.counter % 256, 0x00 if self.pressed else 0x5A]))
        self.sent.append(self.signer.datagram(frame))
        self.socket.sendto(self.sent[-1], self.address)
        with suppress(BlockingIOError):
            self.signer.note(self.socket.recv(100, socket.MSG_DONTWAIT))


@pytest.fixture
def bus(key_file):
    port = free_port()
    interface = UdpInterface(RigBus("estop", "udp", f"127.0.0.1:{port}", key=str(key_file)), [])
    can = SocketCan(interface.socket, shared=True, mute=True)
    yield can, port, interface
    interface.close()


def received(can, seconds=0.3):
    """Frames of a time, or of the first arrival."""
    frames, deadline = [], time.monotonic() + seconds
    while time.monotonic() < deadline:
        frames += can.end.receive(64)
        time.sleep(0.002)
    return frames


@pytest.mark.hazard("H9e")
def test_only_signed_frames_reach_the_loop(bus):
    can, port, _ = bus
    with SignedButton(port) as button:
        deadline = time.monotonic() + 5.0
        while not received(can, 0.05):
            assert time.monotonic() < deadline, "no signed frame has arrived"
    recorded = list(button.sent)
    received(can)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        for datagram in [RELEASED, *recorded, seal_datagram(OTHER, RELEASED, button.signer.session, 10**6), bytes(48)]:
            stranger.sendto(datagram, ("127.0.0.1", port))
    assert received(can) == []
    with SignedButton(port, OTHER):
        assert received(can) == []


def test_without_the_process_that_verifies_nothing_arrives(bus):
    can, port, interface = bus
    with SignedButton(port):
        deadline = time.monotonic() + 5.0
        while not received(can, 0.05):
            assert time.monotonic() < deadline
        os.kill(interface.verifier.pid, 9)
        received(can)
        assert received(can) == []


@pytest.mark.hazard("H9e")
@pytest.mark.paced
def test_a_recorded_stream_does_not_replace_a_button_that_dies(tmp_path, key_file):
    port = free_port()
    with SignedButton(port) as button, Bus(tmp_path, number=13) as bus:
        words = f'[bus.estop]\ninterface = "udp"\nchannel = "127.0.0.1:{port}"\nkey = "estop.key"\n'
        bus.rig.write_text(bus.rig.read_text() + words)
        process = bus.start("--record", "out", more=MORE)
        bus.await_torque()
        button.silence()
        at = time.time()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as thief:
            for datagram in button.sent[-60:]:
                thief.sendto(datagram, ("127.0.0.1", port))
                bus.listen(0.01)
        assert bus.listen(2.0, lambda frame: frame.data == DISABLE) or DISABLE in {frame.data for frame in bus.frames}
        bus.listen(0.3)
        _, errors = process.communicate(timeout=10)
        assert process.returncode == FAULT and "FAULT at button, tick " in errors
        assert 0.25 < bus.stopped_after(at) < 0.3 + 10 * PATIENT
    for path in (tmp_path / "out").iterdir():
        assert KEY not in path.read_bytes() and KEY.hex().encode() not in path.read_bytes()
