"""Drives of the tests' own making, in plain Python: what a drive does that is not healthy, for every family.

They speak the bytes of their manuals, independently of the library's emulators, and can miss a stop, hold a torque,
report without being asked, answer late, and share an id.
"""

import math
from typing import NamedTuple

from blocks.actuators import CubeMars, CubeMarsServo, CubeMarsV3, RobStride, RobStrideMIT
from graph import Block, Diagram, Output
from tests.blocks.actuators import reference

HOST = 0xFD
POSITION = 0.25  # rad, of every joint


class Frame(NamedTuple):
    identifier: int
    extended: bool
    data: bytes


class Family:
    """One protocol: `model` and options of its block, and the bytes of its drives."""

    block = CubeMars
    model = "AK80-9"
    options: dict = {}
    names = ("torque_command",)

    def kind(self, identifier, extended, data, can_id):
        """'enable', 'disable', 'command', 'query' of a frame to the drive; None for another frame."""
        if extended or identifier != can_id or len(data) != 8:
            return None
        if data[:7] == b"\xff" * 7:
            return {0xFC: "enable", 0xFD: "disable"}.get(data[7], "query")
        return "command"

    def state(self, can_id, torque, enabled, position=POSITION, echo=False):
        """The frame with which a drive reports its state."""
        limits = reference.ranges(velocity=50.0, torque=18.0)
        return Frame(can_id, False, reference.reply(limits, can_id, position, 0.0, torque, 25, 0))

    def report(self, *arguments, **options):
        """The frame that it sends without being asked."""
        return self.state(*arguments, **options)

    def answers(self, kind):
        """Whether a drive replies to a frame of this kind."""
        return True

    def other(self, identifier, extended, data, can_id, written):
        """Frames in answer to a frame that is not answered with the state. written : {index: value} of the drive"""
        return []


class V3(Family):
    block, model = CubeMarsV3, "AK80-9-V3.0"
    constant, gear = 0.5701, 9

    def kind(self, identifier, extended, data, can_id):
        if not extended or identifier & 0xFF != can_id:
            return None
        return {8: "command", 15: "disable"}.get(identifier >> 8)

    def state(self, can_id, torque, enabled, position=POSITION, echo=False):
        current = round(torque / self.constant / 0.01)
        angle = round(math.degrees(position) * self.gear * 10.0)
        data = angle.to_bytes(2, "big", signed=True) + bytes(2) + current.to_bytes(2, "big", signed=True)
        return Frame(0x29 << 8 | can_id, True, data + bytes([25, 0x77 * echo]))


class V3Reports(V3):
    """With reports of its own in place of replies, but to the disable."""

    options = {"report_rate": 200.0}

    def answers(self, kind):
        return kind == "disable"


class Servo(V3):
    block, model, names, options = CubeMarsServo, "AK80-9", ("current_command",), {"report_rate": 200.0}
    constant = 0.945

    def kind(self, identifier, extended, data, can_id):
        if not extended or identifier & 0xFF != can_id or identifier >> 8 != 1:
            return None
        return "command"

    def state(self, can_id, torque, enabled, position=POSITION, echo=False):
        return super().state(can_id, torque, enabled, position)

    def answers(self, kind):
        return False


class Private(Family):
    block, model, options = RobStride, "RS02", {"can_timeout": 0.0}

    def kind(self, identifier, extended, data, can_id):
        if not extended or identifier & 0xFF != can_id:
            return None
        return {1: "command", 3: "enable", 4: "disable", 18: "query"}.get(identifier >> 24)

    def state(self, can_id, torque, enabled, position=POSITION, echo=False, kind=2):
        code = int((torque + 17.0) / 34.0 * 65535)
        data = bytes.fromhex("82807fff") + code.to_bytes(2, "big") + (250).to_bytes(2, "big")
        return Frame(kind << 24 | 2 * enabled << 22 | can_id << 8 | HOST, True, data)

    def other(self, identifier, extended, data, can_id, written):
        if not extended or identifier & 0xFF != can_id:
            return []
        if identifier >> 24 == 18:
            written[data[:2]] = data[4:]
        if identifier >> 24 == 0 and "unique" in written:
            return [Frame(can_id << 8 | 0xFE, True, written["unique"])]
        if identifier >> 24 == 17:
            return [Frame(17 << 24 | can_id << 8 | HOST, True, data[:4] + written.get(data[:2], bytes(4)))]
        return []


class PrivateReports(Private):
    """With reports of type 24, which are told from replies."""

    options = {"can_timeout": 0.0, "active_reporting": True}

    def report(self, *arguments, **options):
        return self.state(*arguments, **options, kind=24)


class MitProtocol(Family):
    block, model, options = RobStrideMIT, "RS02", {"can_timeout": 0.0}

    def kind(self, identifier, extended, data, can_id):
        found = super().kind(identifier, extended, data, can_id)
        return "query" if found == "command" and data[:6] == b"\xff" * 6 else found

    def state(self, can_id, torque, enabled, position=POSITION, echo=False):
        limits = reference.ranges(velocity=44.0, torque=17.0)
        data = reference.reply(limits, can_id, position, 0.0, torque, 25, 0)
        return Frame(HOST, False, data[:6] + (250).to_bytes(2, "big"))


FAMILIES = {
    "mit": Family(),
    "v3": V3(),
    "v3 reports": V3Reports(),
    "servo": Servo(),
    "robstride": Private(),
    "robstride reports": PrivateReports(),
    "robstride mit": MitProtocol(),
}


class OwnDrive:
    """A drive.

    family : of FAMILIES
    hold : N·m that it makes whatever is commanded; None for a drive that obeys and makes 1 N·m while commanded
    misses_stop : whether it receives nothing from the first disable or zero current on
    reports : Hz of its reports; of a drive that misses the stop and whose protocol has none, from the stop on
    reported : N·m that it reports in place of its torque, or None
    before : whether it packs its reply before it unpacks the command
    position : rad
    unique : number that identifies it, 8 bytes; None for a drive that does not answer this question

    zeros : (identifier, data) of the commands of zero torque; torque : N·m that it makes
    """

    def __init__(
        self,
        family,
        can_id=1,
        *,
        hold=None,
        misses_stop=False,
        reports=0.0,
        reported=None,
        before=False,
        silent=False,
        position=POSITION,
        unique=None,
    ):
        self.family, self.can_id, self.hold, self.misses_stop = family, can_id, hold, misses_stop
        self.reports, self.reported, self.before, self.silent = reports, reported, before, silent
        self.position, self.written = position, {} if unique is None else {"unique": unique}
        self.enabled = self.deaf = False
        with Diagram("alone", rate=200):
            block = family.block(family.model, can_id=can_id, **family.options)
        self.zeros = {(identifier, data) for identifier, _, data in block.zero_frames()}
        self.torque, self.due, self.heard = 0.0, 0, []

    def state(self, echo=False):
        return self.family.state(self.can_id, self.told(), self.enabled, position=self.position, echo=echo)

    def told(self):
        return self.torque if self.reported is None else self.reported

    def hear(self, identifier, extended, data, now):
        """Frames in answer to a frame. now : ns"""
        if not self.deaf and (answers := self.family.other(identifier, extended, data, self.can_id, self.written)):
            return answers
        kind = self.family.kind(identifier, extended, data, self.can_id)
        if kind is None:
            return []
        if kind == "command" and (identifier, data) in self.zeros:
            kind = "zero"
        self.deaf |= self.misses_stop and kind in ("disable", "zero") and self.torque != 0.0
        if self.deaf:
            return []
        self.heard.append((now, kind))
        earlier = self.state(kind == "disable")
        self.obey(kind)
        if self.silent or not self.family.answers(kind):
            return []
        return [earlier if self.before else self.state(kind == "disable")]

    def obey(self, kind):
        if kind == "enable" or kind == "command" and self.family.block in (CubeMarsV3, CubeMarsServo):
            self.enabled = True
        if self.hold is not None and (self.torque or kind == "command"):
            self.torque, self.enabled = self.hold, True
        elif kind == "command":
            self.torque = 1.0 * self.enabled
        elif kind in ("zero", "disable"):
            self.torque, self.enabled = 0.0, self.enabled and kind == "zero"

    def advance(self, now):
        """Reports that are due. now : ns"""
        frames = []
        if self.misses_stop and not self.deaf and self.family.answers("command"):
            self.due = now + 1  # before the stop, replies that nothing asks for would end the run
        while self.reports and self.due <= now:
            self.due += round(1e9 / self.reports)
            frames.append(self.family.report(self.can_id, self.told(), self.enabled, position=self.position))
        return frames


class Wired(Block):
    """In the plant: drives on the device end of a memory bus.

    drives : OwnDrive; rate : Hz of the plant
    transit : function that returns the ns that the next reply is under way; there : the same of a frame to them
    in_order : whether no frame overtakes another on the same way, as on a bus
    lost : function that returns whether the next frame is lost
    merges : whether equal frames that two drives send at once are one on the wire, as their bits are
    burst : ns from one delivery of the adapter to the next; 0: each frame at once. The first is at `burst_from` ns
    """

    torque = Output("N·m")

    def __init__(
        self,
        drives,
        rate,
        transit=lambda: 0,
        lost=lambda: False,
        merges=False,
        burst=0,
        burst_from=0,
        there=lambda frame: 0,
        in_order=False,
        **options,
    ):
        self.merges, self.burst, self.burst_from = merges, burst, burst_from
        self.drives, self.period, self.transit, self.lost = drives, round(1e9 / rate), transit, lost
        self.there, self.in_order = there, in_order
        self.queue, self.going, self.end = [], [], None
        super().__init__(**options)

    def step(self, tick):
        now = tick * self.period
        self.going += [(self.after(self.going, now + self.there(frame)), frame) for frame in self.end.receive()]
        for _, (identifier, extended, data, _) in self.arrived(self.going, now):
            answers = [answer for drive in self.drives for answer in drive.hear(identifier, extended, data, now)]
            answers = dict.fromkeys(answers) if self.merges else answers
            self.queue += [(self.delivered(now), frame) for frame in answers]
        for drive in self.drives:
            self.queue += [(self.delivered(now), frame) for frame in drive.advance(now)]
        for _, frame in self.arrived(self.queue, now):
            if not self.lost():
                self.end.send(frame.identifier, frame.data, frame.extended, now)
        return sum(drive.torque for drive in self.drives)

    def delivered(self, now):
        """When a frame that a drive sends now arrives, ns."""
        due = self.after(self.queue, now + self.transit())
        return due + (self.burst_from - due) % self.burst if self.burst else due

    def after(self, queue, due):
        """When a frame arrives that would arrive at `due` on a way of its own."""
        return max([due, *(earlier for earlier, _ in queue)]) if self.in_order else due

    def arrived(self, queue, now):
        """Take from a queue what has arrived."""
        arrived = [entry for entry in queue if entry[0] <= now]
        queue[:] = [entry for entry in queue if entry[0] > now]
        return arrived
