"""Adapters that python-can speaks to over a serial line, whose `recv` ignores its timeout: python-can at both
ends of two ptys.
"""

import os
import pty
import re
import select
import threading
import time
import tty
from contextlib import suppress
from itertools import groupby

import can
import pytest

from runtime.host.errors import FAULT
from tests.blocks.actuators import reference
from tests.runtime.runs import AK10_9, DISABLE, ENABLE, NOTHING, after_asking, knee, started, write


class Line:
    """Two ports, each of which gets what is written to the other; and a drive, id 1, at the second."""

    def __init__(self, interface):
        self.masters, self.ports = [], []
        for _ in range(2):
            master, port = pty.openpty()
            tty.setraw(port)
            self.masters.append(master)
            self.ports.append(os.ttyname(port))
            os.close(port)
        self.interface, self.frames, self.over = interface, [], threading.Event()

    def __enter__(self):
        self.threads = [threading.Thread(target=work) for work in (self.carry, self.drive)]
        for thread in self.threads:
            thread.start()
        return self

    def __exit__(self, *exception):
        self.over.set()
        for thread in self.threads:
            thread.join()
        self.unplug()

    def unplug(self):
        while self.masters:
            os.close(self.masters.pop(0))

    def carry(self):
        while not self.over.is_set():
            masters = list(self.masters)
            if len(masters) < 2:
                return
            with suppress(OSError, ValueError):  # nobody has that port open, or it is unplugged
                for ready in select.select(masters, [], [], 0.02)[0]:
                    data = os.read(ready, 4096)
                    os.write(masters[ready == masters[0]], data)
                continue
            time.sleep(0.005)

    def drive(self):
        with can.Bus(interface=self.interface, channel=self.ports[1]) as bus:
            while not self.over.is_set():
                with suppress(TypeError, can.CanError):  # half a frame
                    message = bus.recv(0.02)
                    if message is not None:
                        self.frames.append(message.data.hex().upper())
                        data = reference.held_reply(AK10_9, 1, 0.1, bytes(message.data))
                        bus.send(can.Message(arbitration_id=0, is_extended_id=False, data=bytes(data)))


def run(folder, line, *words):
    rig = write(folder, f'[bus.legs]\ninterface = "{line.interface}"\nchannel = "{line.ports[0]}"\n', "lab.toml")
    return started(knee(folder, "return 2.0"), "--rig", rig, "--yes", "--no-record", *words, cwd=folder)


@pytest.mark.paced
@pytest.mark.parametrize(
    "interface",
    ["serial", pytest.param("seeedstudio", marks=pytest.mark.soak), pytest.param("robotell", marks=pytest.mark.soak)],
)
def test_an_interface_that_blocks_does_not_delay_the_guardian(tmp_path, interface):
    with Line(interface) as line:
        out, errors = run(tmp_path, line, "--duration", "0.5").communicate(timeout=20)
        assert "confirmed by knee" in out and "NOT" not in out, errors
    stop = [frame for frame, _ in groupby(line.frames)][-2:]  # repeated until the drive has confirmed it
    assert after_asking(line.frames)[0] == ENABLE and stop == [NOTHING, DISABLE]
    assert len(line.frames) > 0.9 * int(re.search(r"(\d+) of 100 done", out)[1]), out


@pytest.mark.soak
def test_unplugged_third_party_adapter_ends_run_with_message(tmp_path):
    with Line("serial") as line:
        process = run(tmp_path, line, "--stop-for", "0.2")
        deadline = time.monotonic() + 10.0
        while len(line.frames) < 100 and time.monotonic() < deadline:
            time.sleep(0.01)
        line.unplug()
        _, errors = process.communicate(timeout=10)
    assert process.returncode == FAULT and "Traceback" not in errors and "FAULT at legs, tick " in errors, errors
    assert f"serial {line.ports[0]}" in errors and "the bus can neither send nor receive" in errors
