"""One step of the search: command the actuators for some seconds at one rate, and count the missing replies."""

from __future__ import annotations

import dataclasses
import signal
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from msgspec.structs import replace

from blocks.recorders import CsvRecorder
from cext.bus.timed_bus import TimedBus
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import compile
from runtime.host.ending import Interrupted, raise_if_ended_by_signal
from runtime.setup.bench.rate.robot import UNLIMITED, plant, robot
from runtime.setup.bench.rate.search import Step

if TYPE_CHECKING:
    from cext.schedule.outcome import Outcome
    from runtime.robot.rig.file import RigFile
    from runtime.session.result import Result

SLOW, FAST = 50.0, 1e9  # Hz and bit/s, at which a bus carries any eight actuators, and a bit takes a whole number of ns
RESOLUTION = 2e-6  # s per actuator between polls of the emulated drives: one replies while others receive commands
ARMING = 0.1  # s of virtual time; a bus on which arming takes longer is too full
SETTLING = 2.5  # s after arming before replies are counted: enable frames may still fill the bus


class Simulated:
    """Steps on an in-memory bus with a bitrate, in virtual time.

    make, upper : as in runtime.setup.bench.rate.robot.robot; bitrate in bit/s; seconds : duration of each step, s
    """

    def __init__(
        self,
        make: Callable[[int], Any],
        ids: list[int],
        bitrate: float = 1e6,
        seconds: float = 2.0,
        upper: bool = False,
    ) -> None:
        self.make, self.ids, self.bitrate = make, ids, bitrate
        self.seconds, self.upper = seconds, upper
        self.enables = False
        self.enables = self.run(SLOW, 2, FAST)[1].status == "no answer"

    def __call__(self, rate: float) -> Step:
        ticks = max(10, round(self.seconds * rate))
        program, outcome, _ = self.run(rate, ticks, self.bitrate)
        why = "" if outcome.status == "ok" else outcome.status
        return Step(rate, ticks * len(self.ids), sum(program.reports.missed.values()), 0, ticks, why)

    def run(self, rate: float, ticks: int, bitrate: float) -> tuple[Program, Outcome, TimedBus]:
        """Run the actuators at a rate. Returns (Program of the robot, Outcome, bus)."""
        diagram = robot(self.make, self.ids, rate, self.upper)
        substeps = max(1, round(1.0 / (rate * RESOLUTION * len(self.ids))))
        schedule = compile(diagram)
        # where drives reply without enable frames, leave those out: the bus may have room for the commands alone
        if not self.enables:
            schedule.devices = [replace(device, ask=(), set_up=(), enable=()) for device in schedule.devices]
        bus = TimedBus(bitrate)
        program = Program(schedule, [bus.host])
        if self.enables:
            settling = round(SETTLING * rate)
            ticks += settling
            program.count_from(settling)
        drives = Program(compile(plant(diagram, substeps * rate)), [bus.device])
        executor = Executor(program, rate, plant=drives, substeps=substeps, virtual=True, hosted=True)
        # one round of the safe stop: no robot moves, and computing 200 ms of it would delay the end after a signal
        outcome = executor.run(ticks, fade=0.0, arming_timeout=ARMING, stopping_timeout=0.0)
        return program, raise_if_ended_by_signal(outcome), bus

    def limit(self) -> float:
        """Return the rate in Hz at which the frames of a tick fill the bus, stuff bits included."""
        few, many = 10, 20
        bits = [self.run(SLOW, ticks, FAST)[2].busy * FAST for ticks in (few, many)]
        return self.bitrate * (many - few) / (bits[1] - bits[0])


class OnRig:
    """Steps on a rig, each an ordinary run: pre-flight table, guardian, zero torque, safe stop.

    rig : RigFile with one bus
    confirmed : whether to arm without confirmation by the operator
    say : as in runtime.session.session.Session
    folder : folder of the recordings; None for no recordings

    result : Result of the newest step
    """

    def __init__(
        self,
        make: Callable[[int], Any],
        ids: list[int],
        rig: RigFile,
        seconds: float = 2.0,
        confirmed: bool = False,
        realtime: str = "try",
        say: Callable[[list[str]], object] = lambda lines: None,
        folder: Path | None = None,
    ) -> None:
        self.folder = folder
        self.result: Result | None = None
        self.make, self.ids = make, ids
        self.rig, self.seconds = rig, seconds
        self.confirmed, self.realtime, self.say = confirmed, realtime, say

    def __call__(self, rate: float) -> Step:
        from runtime.host.errors import BadInput
        from runtime.record.recorder import can_ask
        from runtime.robot.rig.buses import RigBuses
        from runtime.robot.rig.overrides import override
        from runtime.session.prepare import NO_CONFIRMATION, Prepared
        from runtime.session.request import Request
        from runtime.session.session import Session

        if not self.confirmed and not can_ask():
            raise BadInput(NO_CONFIRMATION)
        diagram = robot(self.make, self.ids, rate)
        override(dataclasses.replace(self.rig, devices={}), diagram)
        for block in diagram:
            if hasattr(block, "emulator"):
                block.bitrate = UNLIMITED
        if self.folder is not None:
            with diagram:
                CsvRecorder()
        schedule = compile(diagram)
        kept: dict[str, Any] = {"no_record": True} if self.folder is None else {"record": self.folder}
        request = Request(Path(__file__), rig=self.rig.path, yes=self.confirmed, realtime=self.realtime, **kept)
        ticks = max(10, round((self.seconds + SETTLING) * rate))
        result = self.result = Session(
            Prepared(request, diagram, schedule, None, RigBuses(self.rig, diagram, schedule.buses), ticks),
            self.say,
            count_from=round(SETTLING * rate),
        ).carry_out()
        self.confirmed = True  # the operator has confirmed the table; the drives stay the same
        outcome, statistics = result.outcome, result.statistics
        if outcome.stopped:
            raise Interrupted(signal.SIGINT)
        raise_if_ended_by_signal(outcome)
        why = (
            ""
            if outcome.status == "ok"
            else f"{outcome.status} at {outcome.culprit}"
            if outcome.culprit
            else outcome.status
        )
        return Step(
            rate,
            round(self.seconds * rate) * len(self.ids),
            sum(result.control.reports.missed.values()),
            statistics["missed"],
            statistics["ticks"],
            why,
        )
