"""A drive of its own at the far end of a slow connection: each command reaches it after a time and acts until the next
one does; its reply, with the state at that instant, arrives after another time, in order.
"""

import math

import numpy as np

from blocks.actuators import CubeMars, CubeMarsV3
from graph import Block, Diagram
from tests.blocks.actuators.observer import ForceControl, Mit, code, torque_of
from tests.cext.rigs import Rig

KINDS = {
    "AK10-9": (CubeMars, "AK10-9-V2.0", Mit(12.5, 50.0, 65.0)),
    "AK10-9 V3.0": (CubeMarsV3, "AK10-9-V3.0", ForceControl(12.56, 28.0, 54.0, gear=9, pole_pairs=21)),
}
TORQUE_CONSTANT = 1.3137  # N·m/A, of an AK10-9 V3.0
MIT_SPECIAL = b"\xff\xff\xff\xff\xff\xff\xff"


class Connection(Block):
    """The drive and the way to it. `end` is given before the run.

    motion(t) : position and velocity; ways(t) : s to the drive and back, of a frame sent at t; None where it is lost
    sheet : tests.blocks.actuators.observer.Sheet; can_id : of the drive
    """

    def __init__(self, sheet, motion, ways, **options):
        self.sheet, self.motion, self.ways, self.can_id = sheet, motion, ways, 7
        super().__init__(**options)

    def configure(self):
        self.end, self.law, self.rows = None, np.zeros(5), []
        self.going, self.coming = [], []
        self.there = self.back = 0.0

    def step(self, t):
        for identifier, extended, data, _ in self.end.receive():
            way = self.ways(t)
            if way is not None:
                self.there = max(self.there, t + way[0])
                self.going.append((self.there, way[1], identifier | (extended << 31), data))
        while self.going and self.going[0][0] <= t + 1e-9:
            _, back, identifier, data = self.going.pop(0)
            self.obey(identifier, data)
            if back is not None:
                self.back = max(self.back, t + back)
                self.coming.append((self.back, *self.reply(t)))
        while self.coming and self.coming[0][0] <= t + 1e-9:
            _, identifier, data = self.coming.pop(0)
            self.end.send(identifier & 0x1FFFFFFF, data, bool(identifier >> 31), round(t * 1e9))
        self.rows.append((t, torque_of(self.law, *self.motion(t))))

    def reply(self, t):
        """Identifier and data of a reply, with the torque of the present law."""
        identifier, data = self.sheet.reply(self.can_id, *self.motion(t))
        torque = torque_of(self.law, *self.motion(t))
        if isinstance(self.sheet, Mit):
            whole = code(torque, -self.sheet.torque, self.sheet.torque, 12)
            return identifier, data[:4] + bytes([data[4] & 0xF0 | whole >> 8, whole & 0xFF]) + data[6:]
        return identifier, data[:4] + int(100.0 * torque / TORQUE_CONSTANT).to_bytes(2, "big", signed=True) + data[6:]

    def obey(self, identifier, data):
        if data[:7] == MIT_SPECIAL or not data:
            self.law = np.zeros(5)
        else:
            self.law = np.array(self.sheet.command(identifier, data))


def connected(name, motion, ways, *, rate, seconds, limit, substeps=10, commands=None, **parameters):
    """(Rig after its run, Outcome). rig.torques : rows of time and the torque of the drive"""
    kind, model, sheet = KINDS[name]
    with Diagram("robot", rate=rate) as robot:
        knee = kind(model, name="knee", can_id=7, limit=limit, timeout=0.5, **parameters)
        knee(**commands)
    with Diagram("plant", rate=rate * substeps) as plant:
        drive = Connection(sheet, motion, ways)
    rig = Rig(robot, plant)
    drive.end = rig.buses["can"].device
    outcome = rig.run(round(seconds * rate), fade=0.0)
    rig.torques, [rig.watched] = np.array(drive.rows), rig.control.reports.watched
    rig.torque_code = sheet.torque_code
    return rig, outcome


def constant(total, share=0.5):
    """Ways that take `total` s there and back, of it `share` there."""
    return lambda t: (share * total, (1.0 - share) * total)


def irregular(low, high, seed=1):
    """Ways of `low` to `high` s there and back, divided at random."""
    random = np.random.default_rng(seed)

    def ways(t):
        total, share = random.uniform(low, high), random.random()
        return share * total, (1.0 - share) * total

    return ways


def bursts(timer):
    """An adapter that hands over what it has received every `timer` s."""
    return lambda t: (0.0002, timer - (t + 0.0002) % timer)


def lossy(ways, lost, seed=2):
    """Ways on which that fraction of frames is lost, in each direction."""
    random = np.random.default_rng(seed)

    def carry(t):
        there, back = ways(t)
        if random.random() < lost:
            return None
        return there, None if random.random() < lost else back

    return carry


def shaken(acceleration, frequency):
    """To and fro with that acceleration at most, rad/s², at that frequency, Hz."""
    w = 2.0 * math.pi * frequency
    a = acceleration / w**2
    return lambda t: (a * math.sin(w * t), a * w * math.cos(w * t))
