"""Time from the death or the halt of the guardian that carries a run's frames to the stop of the motors.

Measured on udp_multicast and on slcan over a pseudo-terminal.
"""

from __future__ import annotations

import os
import pty
import select
import signal
import subprocess
import tempfile
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from runtime.setup.bench import bus
from runtime.setup.bench.drives import reply
from runtime.setup.bench.processes import START_TIMEOUT, run_on_rig

GUARDIAN = "tickwork-guard"  # name of its process
STOP_TIMEOUT = 1.0  # s
RIGS = {
    "udp_multicast": '[bus.legs]\ninterface = "udp_multicast"\nchannel = "{}"\n',
    "slcan": '[bus.legs]\ninterface = "slcan"\nchannel = "{}"\noptions = {{ sleep_after_open = 0.05 }}\n',
}


def deaths(interface: str, count: int, number: int = signal.SIGKILL) -> list[float]:
    """Return s from a signal to the guardian to the last first stop frame, of `count` runs; inf where one did not come.

    interface : "udp_multicast" or "slcan"
    number : of the signal: SIGKILL, or SIGSTOP, after which the run must end it
    """
    node = multicast if interface == "udp_multicast" else adapter
    with node() as (channel, commands), tempfile.TemporaryDirectory() as folder:
        robot, rig = Path(folder, "robot.py"), Path(folder, "rig.toml")
        robot.write_text(bus.ROBOT)
        rig.write_text(RIGS[interface].format(channel))
        return [one_death(commands, robot, rig, number) for _ in range(count)]


def one_death(commands: Callable[..., Any], robot: Path, rig: Path, number: int = signal.SIGKILL) -> float:
    """Send a signal to the guardian of a run. Returns s to the first stop frame of the later drive; inf without one.

    commands : function of a duration in s that returns (s of the wall clock, id, data) of the frames sent to the
        drives since the last call
    """
    with run_on_rig(robot, rig) as process:
        deadline = time.monotonic() + START_TIMEOUT
        while not any(data[:7] != b"\xff" * 7 and data != bus.COMMAND for _, _, data in commands(0.02)):
            if time.monotonic() > deadline or process.poll() is not None:
                raise OSError("the run under test did not start")
        time.sleep(0.05)
        if any(data == bus.DISABLE for _, _, data in commands(0.0)):
            raise OSError("the run under test has ended by itself")
        killed = time.time()
        os.kill(guardian_of(process.pid), number)
        first = {}
        while len(first) < 2 and time.time() < killed + STOP_TIMEOUT:
            for at, identifier, data in commands(0.01):
                if data == bus.DISABLE:
                    first.setdefault(identifier, at - killed)
        with suppress(subprocess.TimeoutExpired):  # it ends by itself, with a fault
            process.wait(5.0)
        return max(first.values()) if len(first) == 2 else float("inf")


def guardian_of(pid: int) -> int:
    """Return the process number of a run's guardian."""
    for entry in filter(str.isdigit, os.listdir("/proc")):
        with suppress(OSError):
            name, _, rest = Path("/proc", entry, "stat").read_text().partition("(")[2].rpartition(")")
            if name == GUARDIAN and int(rest.split()[1]) == pid:
                return int(entry)
    raise OSError("the run has no guardian")


@contextmanager
def multicast() -> Iterator[tuple[str, Callable[..., Any]]]:
    """Context manager of two emulated drives on udp_multicast.

    Returns (channel, function of a duration in s that returns the received commands).
    """
    group = bus.channel()
    with bus.drives(group, 1, 2):
        node = bus.node(group)

        def commands(seconds):
            frames, deadline = [], time.monotonic() + seconds
            while (message := node.recv(max(0.0, deadline - time.monotonic()))) is not None:
                data = bytes(message.data)
                if data[0] != message.arbitration_id:
                    frames.append((message.timestamp, message.arbitration_id, data))
            return frames

        try:
            yield group, commands
        finally:
            node.shutdown()


@contextmanager
def adapter() -> Iterator[tuple[str, Callable[..., Any]]]:
    """Context manager of an slcan adapter on a pseudo-terminal, with two emulated drives behind it.

    Returns (port, function of a duration in s that returns the received commands).
    """
    master, port = pty.openpty()
    tty.setraw(port)
    name = os.ttyname(port)
    os.close(port)  # a run refuses a port that another process has open
    received, over = [], threading.Event()

    def play():
        line = b""
        while not over.is_set():
            if not select.select([master], [], [], 0.02)[0]:
                continue
            try:
                line += os.read(master, 4096)
            except OSError:  # no process has the port open
                time.sleep(0.001)
                continue
            at = time.time()
            *words, line = line.split(b"\r")
            for word in words:
                if not word.startswith(b"t"):
                    os.write(master, b"\r")
                    continue
                identifier, data = int(word[1:4], 16), bytes.fromhex(word[5:].decode())
                received.append((at, identifier, data))
                os.write(master, b"z\rt%03X8%s\r" % (identifier, reply(identifier, data).hex().upper().encode()))

    def commands(seconds):
        time.sleep(seconds)
        frames = received[:]
        del received[: len(frames)]
        return frames

    thread = threading.Thread(target=play, daemon=True)
    thread.start()
    try:
        yield name, commands
    finally:
        over.set()
        thread.join()
        os.close(master)
