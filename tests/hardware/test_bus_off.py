"""A stop over real SocketCAN while its bus fails: a controller that goes bus-off, a burst of errors, a full queue."""

import fcntl
import os
import pty
import re
import select
import signal
import struct
import termios
import threading
import time
import tty

import pytest

from tests.blocks.actuators import reference
from tests.hardware.drives import AK10_9, Drives, is_answer
from tests.hardware.vcan import ERROR, Node, ip, needs_own_kernel, needs_vcan
from tests.runtime.robot.guardian.bus import guardian_of
from tests.runtime.runs import DISABLE, ENABLE, NOTHING, knee, started, write

pytestmark = [needs_vcan, pytest.mark.soak]
N_SLCAN = 17
BURST = 0.05  # s


class KernelAdapter:
    """An adapter and a drive behind the kernel's slcan driver, whose controller has the kernel's states.

    name : the interface; frames : data in hex digits that the drive was sent
    reads : whether what the kernel sends is taken from it; answers : whether the drive does
    """

    def __init__(self):
        self.frames, self.reads, self.answers, self.ended = [], True, True, False
        self.master, self.port = pty.openpty()
        tty.setraw(self.port)
        before = set(os.listdir("/sys/class/net"))
        fcntl.ioctl(self.port, termios.TIOCSETD, struct.pack("i", N_SLCAN))
        [self.name] = set(os.listdir("/sys/class/net")) - before
        self.thread = threading.Thread(target=self._play)

    def __enter__(self):
        self.thread.start()
        ip("set", self.name, "type", "can", "bitrate", "1000000")
        ip("set", self.name, "txqueuelen", "10", "up")
        return self

    def __exit__(self, *exception):
        self.reads = True
        ip("set", self.name, "down")
        self.ended = True
        self.thread.join()
        os.close(self.port)
        os.close(self.master)

    def say(self, line):
        os.write(self.master, line + b"\r")

    def await_torque(self):
        deadline = time.monotonic() + 30.0
        while time.monotonic() < deadline:
            if any(data not in (ENABLE, NOTHING, DISABLE) for data in list(self.frames)):
                return
            time.sleep(0.01)
        raise AssertionError("no torque was commanded")

    def _play(self):
        heard = b""
        while not self.ended:
            if not self.reads or not select.select([self.master], [], [], 0.01)[0]:
                time.sleep(0.001)
                continue
            *lines, heard = (heard + os.read(self.master, 4096)).split(b"\r")
            for line in lines:
                if line.startswith(b"t001"):
                    data = bytes.fromhex(line[5:].decode())
                    self.frames.append(data.hex().upper())
                    if self.answers:
                        answer = bytes(reference.held_reply(AK10_9, 1, 0.3, data))
                        self.say(b"t001%d%s" % (len(answer), answer.hex().upper().encode()))


def run(folder, channel):
    rig = write(folder, f'[bus.legs]\ninterface = "socketcan"\nchannel = "{channel}"\n', "lab.toml")
    words = ["--rate", "50", "--no-record", "--realtime", "off", "--stop-for", "20", "--set", "knee.timeout=0.5"]
    return started(knee(folder, law="return 2.0"), "--rig", rig, "--yes", *words, cwd=folder)


def ended(process, codes):
    """Wait for the end of a run whose stop was confirmed. Returns its output."""
    out, err = process.communicate(timeout=30)
    assert process.returncode in codes, out + err
    last = [line for line in (out + err).splitlines() if "confirmed" in line]
    assert any(re.search(r"(?<!NOT )confirmed by knee|knee confirmed the stop", line) for line in last), out + err
    return out + err


@needs_own_kernel
@pytest.mark.parametrize("way", ["the run", "the run without its guardian", "the guardian of a run that was killed"])
def test_a_stop_goes_on_while_its_controller_is_bus_off_until_the_drive_confirms(tmp_path, way):
    with KernelAdapter() as adapter:
        process = run(tmp_path, adapter.name)
        adapter.await_torque()
        guardian = guardian_of(process)
        adapter.say(b"sb256256")  # the adapter's controller is bus-off
        if way == "the run without its guardian":
            guardian.kill()
        elif way != "the run":
            process.kill()
        time.sleep(1.0)
        ip("set", adapter.name, "down")
        adapter.frames.clear()
        ip("set", adapter.name, "up")
        text = ended(process, [-9] if "killed" in way else [3])
        assert "bus-off" in text or way != "the run"
        assert adapter.frames[-1] == DISABLE and set(adapter.frames) <= {NOTHING, DISABLE}


@needs_own_kernel
def test_a_stop_goes_on_while_nothing_leaves_the_queue_of_its_interface(tmp_path):
    with KernelAdapter() as adapter:
        process = run(tmp_path, adapter.name)
        adapter.await_torque()
        adapter.reads = False
        process.send_signal(signal.SIGTERM)
        time.sleep(1.0)
        adapter.reads = True
        ended(process, [143, 3])  # SIGTERM, or the full queue
        assert adapter.frames[-1] == DISABLE
        assert {NOTHING, DISABLE} == set(adapter.frames[adapter.frames.index(DISABLE, 10) - 1 :])


@pytest.mark.parametrize("way", ["SIGTERM", "kill -9", "kill -9 of its guardian"])
def test_a_stop_goes_on_through_a_burst_of_errors_until_the_drive_confirms(tmp_path, way):
    with Drives({1: 0.3}) as drives, Node() as node, Node() as controller:
        process = run(tmp_path, "vcan0")
        deadline, torque = time.monotonic() + 30.0, False
        while not torque and time.monotonic() < deadline:
            torque = any(
                identifier == 1 and not is_answer(1, data) and data.hex().upper() not in (ENABLE, NOTHING, DISABLE)
                for identifier, data in node.heard()
            )
            time.sleep(0.01)
        assert torque
        drives.answers = False
        if way == "SIGTERM":
            process.send_signal(signal.SIGTERM)
        else:
            (process if way == "kill -9" else guardian_of(process)).kill()
        until = time.monotonic() + BURST
        while time.monotonic() < until:
            controller.send(ERROR | 0x088, bytes([0, 0, 0x04, 0, 0, 0, 0, 0]))
        drives.answers = True
        ended(process, [{"SIGTERM": 143, "kill -9": -9}.get(way, 3)])
        heard = [data.hex().upper() for identifier, data in node.heard() if identifier == 1 and not is_answer(1, data)]
        end = heard.index(DISABLE)
        assert set(heard[end - 1 :]) == {NOTHING, DISABLE}, heard[end - 3 :]
