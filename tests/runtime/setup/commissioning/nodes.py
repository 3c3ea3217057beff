"""Nodes of a bus on udp_multicast or SocketCAN, a thread and a socket each: drives and IMUs that speak as the manuals
say.

The answers are made by the references of tests/blocks/actuators, not by what is tested.
"""

import os
import struct
import threading
import time
from collections import Counter

import can

from blocks.actuators.robstride import models
from runtime.robot.emulation.priority import take_priority
from tests.blocks.actuators import reference, robstride_reference
from tests.runtime.robot.guardian.drives import open_bus

AK10_9 = reference.ranges(velocity=50.0, torque=65.0)
RS02 = robstride_reference.ranges(models.find("RS02"))
ENABLE, DISABLE, ZERO = (b"\xff" * 7 + bytes([last]) for last in (0xFC, 0xFD, 0xFE))


def channel(number):
    """A group of this process alone."""
    return f"239.{10 + os.getpid() % 200}.{os.getpid() // 200 % 250}.{100 + number}"


class Node:
    """A node of its own: `hear` gives its answers to a frame, `speak` what it says by itself every `period` s, as (id,
    extended, data).
    """

    period = None

    def __init__(self):
        self.heard, self.alive, self.deaf = [], True, Counter()

    def start(self, channel):
        self.echoed = not channel.startswith("vcan")  # whether it hears its own frames
        self.bus = open_bus(channel) if self.echoed else can.Bus(channel, interface="socketcan")
        self.thread = threading.Thread(target=self.live, daemon=True)
        self.thread.start()

    def end(self):
        self.alive = False
        self.thread.join(5)
        self.bus.shutdown()

    def live(self):
        take_priority()
        due = time.monotonic()
        while self.alive:
            message = self.bus.recv(0.005)
            if self.period and time.monotonic() >= due:
                due += self.period
                self.say(self.speak())
            if message is None or message.is_error_frame:
                continue
            frame = message.arbitration_id, message.is_extended_id, bytes(message.data)
            if self.deaf[frame]:  # its own
                self.deaf[frame] -= 1
                continue
            self.heard.append(frame)
            self.say(self.hear(*frame))

    def say(self, frames):
        for identifier, extended, data in frames or ():
            self.deaf[identifier, extended, bytes(data)] += self.echoed
            self.bus.send(can.Message(arbitration_id=identifier, is_extended_id=extended, data=data))

    def hear(self, identifier, extended, data):
        return []


class Mit(Node):
    """A CubeMars in MIT mode, or with a host's id a RobStride in its MIT protocol. Its torque is that of the last
    command.
    """

    def __init__(self, can_id, position=0.1, temperature=31.0, error=0, host=None, velocity=0.0, drift=0.0):
        super().__init__()
        self.silent, self.drift = 0.0, drift
        self.velocity = velocity
        self.can_id, self.position, self.temperature, self.error, self.host = can_id, position, temperature, error, host
        self.enabled = False

    def hear(self, identifier, extended, data):
        if extended or identifier != self.can_id or len(data) != 8 or data[0] == self.can_id:  # another's answer
            return []
        if data in (ENABLE, DISABLE):
            self.enabled = data == ENABLE
        if data == ZERO:  # then it is silent for a while
            self.position, self.silent = 0.0, time.monotonic() + 0.6
        self.position += self.drift
        if time.monotonic() < self.silent:
            return []
        if self.host is None:
            state = self.position, self.velocity, 0.0, self.temperature, self.error
            return [(self.can_id, False, reference.reply(AK10_9, self.can_id, *state))]
        body = reference.reply(AK10_9 | {"position": (-12.57, 12.57)}, self.can_id, self.position, 0.0, 0.0, 0.0, 0)
        return [(self.host, False, body[:6] + struct.pack(">h", round(self.temperature * 10)))]


class Private(Node):
    """A RobStride drive, or a CyberGear, in the private protocol: it can be read, written, given an id, zeroed and
    saved.
    """

    def __init__(
        self, can_id, unique=0x1122334455667788, cybergear=False, position=0.25, velocity=0.0, current=0.0, faults=0
    ):
        super().__init__()
        self.can_id, self.unique, self.cybergear, self.faults = can_id, unique, cybergear, faults
        self.values = {
            0x7019: position,
            0x701A: current,
            0x701B: velocity,
            0x701C: 47.5,
            0x700B: 17.0,
            0x7018: 23.0,
            0x7005: 0,
            0x7028: 0,
            0x7026: 1,
        }
        self.layouts = {0x7005: "<Bxxx", 0x7028: "<I", 0x7026: "<Hxx"}
        self.mode, self.saved, self.protocol = 0, 0, None

    def state(self, host):
        flagged, data = robstride_reference.reply(
            RS02,
            self.can_id,
            position=self.values[0x7019],
            velocity=self.values[0x701B],
            temperature=36.5,
            faults=self.faults,
            mode=self.mode,
            host=host,
        )
        return flagged & 0x1FFFFFFF, True, data

    def hear(self, identifier, extended, data):
        kind, field, host, target = (
            identifier >> 24,
            identifier >> 8 & 0xFFFF,
            identifier >> 8 & 0xFF,
            identifier & 0xFF,
        )
        if not extended or target != self.can_id:
            return []
        if kind == 0:
            return [self.itself()]
        if kind in (1, 3):
            self.mode = 2 if kind == 3 else self.mode
            return [self.state(host if kind == 3 else 0xFD)]
        if kind == 4:
            self.mode = 0
            if data[1] == 0xC4 and not self.cybergear:
                return [(self.state(host)[0], True, bytes([0x00, 0xC4, 0x56, 0, 3, 1, 7, 0]))]
            return [self.state(host)]
        if kind == 6:
            self.values[0x7019] = 0.0
            return [self.state(host)]
        if kind == 7:
            self.can_id = field >> 8
            return [self.itself()]
        if kind in (17, 18):
            index = struct.unpack_from("<H", data)[0]
            known = index in self.values and not (self.cybergear and index in (0x7026, 0x7028))
            layout = self.layouts.get(index, "<f")
            if kind == 18:
                if known:
                    self.values[index] = struct.unpack_from(layout, data, 4)[0]
                return [self.state(host)]
            value = struct.pack(layout, self.values[index]) if known else bytes(4)
            return [
                (17 << 24 | (not known) << 16 | self.can_id << 8 | host, True, struct.pack("<HH", index, 0) + value)
            ]
        if kind == 22:
            self.saved += 1
            return [self.state(host)]
        if kind == 25:
            self.protocol = data[6]
            return [self.state(host)]
        return []

    def itself(self):
        return self.can_id << 8 | 0xFE, True, struct.pack(">Q", self.unique)


class Servo(Node):
    """A CubeMars in servo mode: 50 reports a second, and no answer in MIT mode. current : of 0.01 A"""

    period = 0.02

    def __init__(self, can_id, current=12, error=4):
        super().__init__()
        self.can_id, self.position, self.current, self.error, self.kept = can_id, 900, current, error, None

    def speak(self):
        return [(0x29 << 8 | self.can_id, True, struct.pack(">hhhbB", self.position, 0, self.current, 33, self.error))]

    def hear(self, identifier, extended, data):
        if extended and identifier == 5 << 8 | self.can_id and len(data) == 1:
            self.position, self.kept = 0, bool(data[0])
        return []


class V3(Node):
    """A CubeMars with a V3.0 board that reports when it is asked."""

    def __init__(self, can_id):
        super().__init__()
        self.can_id = can_id

    def hear(self, identifier, extended, data):
        disable = extended and identifier == 15 << 8 | self.can_id and not data
        return [(0x29 << 8 | self.can_id, True, struct.pack(">hhhbB", 900, 0, 0, 33, 0x77))] if disable else []


class OpenImu(Node):
    """An OpenIMU300RI: rate and acceleration at 100 Hz, its NAME and version when it is asked."""

    period = 0.01

    def __init__(self, address=128, serial=4711):
        super().__init__()
        self.address, self.serial = address, serial

    def speak(self):
        return [
            (3 << 26 | 61482 << 8 | self.address, True, bytes.fromhex("007d007d007dff00")),
            (2 << 26 | 61485 << 8 | self.address, True, bytes.fromhex("007d007d007dffff")),
        ]

    def hear(self, identifier, extended, data):
        if not extended or identifier >> 16 & 0xFF != 0xEA or identifier >> 8 & 0xFF not in (self.address, 0xFF):
            return []
        wanted = int.from_bytes(data, "little")
        if wanted == 0xEE00:
            name = 823 << 21 | 131 << 40 | self.serial
            return [(6 << 26 | 0xEEFF << 8 | self.address, True, name.to_bytes(8, "little"))]
        if wanted == 65242:
            return [(6 << 26 | 65242 << 8 | self.address, True, bytes([1, 1, 2, 0, 0]))]
        return []


class Commander(Node):
    """Somebody else's program, which holds a drive with a torque."""

    period = 0.01

    def __init__(self, identifier, extended=False):
        super().__init__()
        self.identifier, self.extended = identifier, extended

    def speak(self):
        return [(self.identifier, self.extended, bytes.fromhex("7fff7ff000000900"))]


class Nodes:
    """Nodes on a channel of this test: its number, or the name of an interface."""

    def __init__(self, number, *nodes):
        self.channel, self.nodes = number if isinstance(number, str) else channel(number), nodes

    def __enter__(self):
        for node in self.nodes:
            node.start(self.channel)
        return self

    def __exit__(self, *exception):
        for node in self.nodes:
            node.end()

    @property
    def words(self):
        return "--interface", "udp_multicast", "--channel", self.channel
