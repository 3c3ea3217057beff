"""A robot with two knees on a rig whose buses are udp_multicast: its drives, the observer on the bus, and the
process that is killed.
"""

import itertools
import os
import select
import subprocess
import time
from contextlib import suppress
from dataclasses import dataclass

import can
import psutil

from tests.runtime.robot.guardian.drives import open_bus
from tests.runtime.runs import DISABLE, ENABLE, NOTHING, module, started, write
from tests.runtime.stuck import family

MOTORS = (1, 2)

ROBOT = '''
import ctypes
import time

from blocks.actuators import CubeMars
from blocks.limiters import TorqueLimiter
from blocks.recorders import CsvRecorder
from graph import Block, Diagram, Input, Output, subsystem


class Law(Block):
    """A steady torque, until it hangs."""

    position = Input("rad")
    torque = Output("N·m")
    late = Output("1", dtype=bool)

    def step(self, position, tick):
        {law}
        return {torque}, tick > 40


{blocks}


def build():
    with Diagram("knees", rate=200) as diagram:
        for side, can_id in (("left", 1), ("right", 2)):
            with subsystem(side):
                knee = CubeMars(
                    "AK10-9-V2.0", bus="legs", can_id=can_id, name="knee", range=(-12.5, 12.5), wake_shift=0.0{drive})
                law = Law(name="law")(knee.position)
                knee(torque_command=TorqueLimiter(limit=5.0)(law.torque))
        {more}
        CsvRecorder()
    return diagram
'''

PATIENT = ", timeout=1.0"  # of a drive whose emulator a busy machine may hold up, in a test that is not about silence


@dataclass(frozen=True)
class Heard:
    """time : s of the wall clock; data in hex digits"""

    time: float
    identifier: int
    data: str

    @property
    def is_command(self):
        return self.data[:2] != f"{self.identifier:02X}"


class Bus:
    """A bus of this test alone: its drives, and a node that listens."""

    def __init__(self, folder, number=0, motors=MOTORS, answering=True, moving=False):
        self.folder = folder
        self.channel = f"239.{10 + os.getpid() % 200}.{os.getpid() // 200 % 250}.{10 + number}"
        self.rig = write(folder, f'[bus.legs]\ninterface = "udp_multicast"\nchannel = "{self.channel}"\n', "lab.toml")
        self.node = open_bus(self.channel)
        self.frames, self.runs = [], []
        self.motors, self.answering, self.moving = motors, answering, moving

    def __enter__(self):
        if not self.answering:
            return self
        words = [self.channel, *self.motors, *["moving"] * self.moving]
        self.drives = module("tests.runtime.robot.guardian.drives", *words, stdout=subprocess.PIPE, text=True)
        assert self.drives.stdout.readline() == "ready\n"
        return self

    def __exit__(self, *exception):
        for run in self.runs:
            if run.poll() is None:  # a test has failed; a suspended guardian would keep the pipes
                with suppress(psutil.NoSuchProcess):
                    for process in family(run):
                        process.kill()
                run.communicate()
        if self.answering:
            self.drives.kill()
            self.drives.wait()
            self.drives.stdout.close()
        self.node.shutdown()

    def send(self, identifier, data):
        self.node.send(can.Message(arbitration_id=identifier, is_extended_id=False, data=data))

    def listen(self, seconds=0.0, until=lambda frame: False):
        """Take what comes, for some time or until a frame is there that is awaited. Returns that frame, or None."""
        deadline = time.monotonic() + seconds
        while (left := deadline - time.monotonic()) > 0 or select.select([self.node], [], [], 0)[0]:
            message = self.node.recv(max(0.0, left))
            if message is not None:
                self.frames.append(Heard(message.timestamp, message.arbitration_id, bytes(message.data).hex().upper()))
                if until(self.frames[-1]):
                    return self.frames[-1]
        return None

    def start(self, *words, law="pass", torque=2.0, blocks="", more="", drive=PATIENT, **how):
        """A run of the robot, that has been started, with real-time priority if it may: no load delays it."""
        robot = write(self.folder, ROBOT.format(law=law, torque=torque, blocks=blocks, more=more, drive=drive))
        self.runs.append(
            started(robot, "--rig", self.rig, "--yes", "--stop-for", "0.2", *words, cwd=self.folder, **how)
        )
        return self.runs[-1]

    def await_torque(self):
        """Until both knees are under torque."""
        for motor in self.motors:
            if not self.listen(30.0, lambda frame: frame.identifier == motor and is_torque(frame)):
                run = self.runs[-1]
                raise AssertionError(f"no torque to {motor}: {run.poll() is not None and run.communicate()}")

    def commands(self, motor, since=0.0, asking=False):
        """Frames to a motor. asking : whether also those with which arming asks it before it is enabled"""
        said = [frame for frame in self.frames if frame.identifier == motor and frame.is_command]
        if not asking:
            said = list(itertools.dropwhile(lambda frame: frame.data == DISABLE, said))
        return [frame for frame in said if frame.time >= since]

    def stopped_after(self, instant):
        """s from an instant (of the wall clock) until every motor had its first zero torque and disable. No torque may
        follow that.
        """
        return max(self._stop_of(motor, instant) for motor in self.motors)

    def _stop_of(self, motor, instant):
        said = self.commands(motor)
        end = next((place for place, frame in enumerate(said) if frame.data == DISABLE), None)
        assert end is not None, f"motor {motor} was never disabled"
        assert said[end - 1].data == NOTHING, f"motor {motor}: {said[max(0, end - 4) : end + 3]}"
        after = {frame.data for frame in said[end - 1 :]}
        assert after == {NOTHING, DISABLE}, f"motor {motor} was commanded after its safe stop: {said[end - 2 :]}"
        return said[end].time - instant


def is_torque(frame):
    return frame.is_command and frame.data not in (ENABLE, DISABLE, NOTHING)


def guardian_of(process):
    """The guardian of a run."""
    [guardian] = [child for child in psutil.Process(process.pid).children() if child.name() == "tickwork-guard"]
    return guardian


def assert_nothing_is_left(processes, channel):
    """Neither a process nor a lock. The memory of a run has no name, and goes with its processes."""
    _, alive = psutil.wait_procs(processes, timeout=5)
    assert not [process for process in alive if process.status() != psutil.STATUS_ZOMBIE]
    with open("/proc/net/unix") as sockets:
        assert f"@tickwork/bus/udp_multicast/{channel}" not in sockets.read()
