"""The rig on a bench: polls its drives without torque, and asks the operator."""

from __future__ import annotations

import math
import sys
import time
from collections import Counter
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from blocks.families import family_of
from blocks.gpio import EStopSwitch
from blocks.safety import EStopHeartbeat
from blocks.sensors.insole import Insole
from graph import Actuator, Device
from runtime.host.console.confirm import discard_typed, enter_pressed
from runtime.host.console.terminal import print_lines
from runtime.host.errors import BadInput
from runtime.robot.rig.records import AGREES, DIFFERS, OPEN
from runtime.robot.rig.tool_bus import ToolBus
from runtime.setup.commissioning import scan
from runtime.setup.commissioning.bus import open_bus

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from graph import Diagram
    from runtime.robot.loading.overrides import Settings
    from runtime.robot.rig.file import RigFile

BUTTONS = (EStopHeartbeat, EStopSwitch)
POLL_PERIOD = 0.01  # s between two queries of one drive
LISTEN_TIME = 0.5  # s of an idle bus
NOISE = 0.02  # rad, motion of a joint at rest
STILL_TIME, ATTEMPTS = 0.4, 2  # s, and readings of a drive that does not respond


@dataclass
class Result:
    """What a step has found.

    says : lines for the operator; measured : {name: number}
    findings : (name of a fault, text); cures : {hardware parameter: value} that the rig should have
    done : False for a step that measured nothing
    """

    says: list[str] = field(default_factory=list)
    measured: dict[str, float] = field(default_factory=dict)
    findings: list[tuple[str, str]] = field(default_factory=list)
    cures: dict[str, Any] = field(default_factory=dict)
    done: bool = True

    @property
    def verdict(self) -> str:
        """One of AGREES, DIFFERS and OPEN."""
        return DIFFERS if self.findings else AGREES if self.done else OPEN

    def find(self, name: str, text: str, **cures: Any) -> None:
        """Add a finding."""
        self.findings.append((name, text))
        self.cures |= cures


@dataclass
class Given:
    """What the operator has given for a device.

    angle : rad, between the two marks; pose : rad, of the joint in the pose in which it is held
    home : runtime.setup.commissioning.guided.home.Home, or None; steps : {name: StepRecord} of the device so far
    before : StepRecord of the present step, which it replaces, or None
    travel : rad, largest motion; picture : its file, beside the record
    lever : runtime.setup.commissioning.guided.driven.Lever, False for none, None before it was asked
    """

    angle: float
    pose: float = 0.0
    travel: float = math.pi / 2.0
    home: Any = None
    picture: Path | None = None
    steps: dict[str, Any] = field(default_factory=dict)
    before: Any = None
    lever: Any = None


class Unmeasured(Exception):
    """A run that the computer has ended, so that nothing was measured. Its argument is what was observed, as text."""


class Lost(Exception):
    """A drive that no longer responds, although it did. Its argument is what was observed, as text."""


@dataclass(frozen=True)
class Sample:
    """One reply of a drive. time in s; position and velocity at the joint, before sign and offset; the Answer"""

    time: float
    position: float
    velocity: float
    answer: Any


class Bench:
    """Drives of a diagram on the buses of its rig. Use it in a `with` block: at its end the buses are closed.

    drives, sensors, insoles, buttons : the actuators, inertial sensors, insoles and emergency stops
    file, rig, diagram : path of the diagram, RigFile, and Diagram with the parameters of the rig
    settings : those with which the diagram was built, as texts NAME=VALUE
    """

    def __init__(self, file: Path, rig: RigFile, diagram: Diagram, settings: Settings = ()) -> None:
        self.file, self.rig, self.diagram, self.settings = file, rig, diagram, settings
        self.queries = {}
        for block in diagram:
            family = family_of(block) if isinstance(block, Actuator) else None
            if family is not None:
                self.queries[block.path] = family.stop_query(block)
        self.drives: list[Any] = [diagram[path] for path in self.queries]
        self.sensors = [
            block for block in diagram if isinstance(block, Device) and {"accel", "gyro"} <= set(block.outputs)
        ]
        self.insoles = [block for block in diagram if isinstance(block, Insole)]
        self.buttons = [block for block in diagram if isinstance(block, BUTTONS)]
        self.period = 1.0 / diagram.rate
        self.buses: dict[str, ToolBus] = {}
        self.reports: dict[str, scan.Report] = {}
        self.errors_in_runs: Counter[str] = Counter()
        self.queried: Counter[str] = Counter()  # queries of each drive during the newest `watch`
        self._errors_before: Counter[str] = Counter()
        self._stack = ExitStack()

    def __enter__(self) -> Bench:
        return self

    def __exit__(self, *exception: object) -> None:
        self.release()

    def take(self) -> None:
        """Open the buses of the drives, unless they are open. Raises BadInput if another controller uses one."""
        for name in dict.fromkeys(block.bus for block in self.drives):
            if name not in self.buses:
                self.buses[name] = self._stack.enter_context(open_bus(self.rig.buses[name]))
                scan.refuse_company(self.buses[name])

    def release(self) -> None:
        """Disable every drive once more and close the buses, for a run that opens them itself."""
        try:
            for block in self.drives:
                if block.bus in self.buses and (frame := self.queries[block.path].frame):
                    self.buses[block.bus].send(frame, "disable")
        finally:
            self._errors_before.update({name: tool.errors for name, tool in self.buses.items()})
            self.buses.clear()
            self._stack.close()

    def errors(self, bus: str) -> int:
        """Return the number of error frames of a bus so far, those of runs included."""
        open_now = self.buses[bus].errors if bus in self.buses else 0
        return self._errors_before[bus] + self.errors_in_runs[bus] + open_now

    def report(self, bus: str) -> scan.Report:
        """Return the scan.Report of a bus, made once."""
        self.take()
        if bus not in self.reports:
            ids = sorted({*range(1, 128), *(block.can_id for block in self.drives if block.bus == bus)})
            self.reports[bus] = scan.scan(self.buses[bus], ids, LISTEN_TIME)
        return self.reports[bus]

    def watch(self, until: Callable[[], bool], drives: list[Any] | None = None) -> dict[str, list[Sample]]:
        """Return {path: Samples} of drives that are polled until `until()`. drives : all by default"""
        self.take()
        drives = self.drives if drives is None else drives
        seen: dict[str, list[Sample]] = {block.path: [] for block in drives}
        self.queried.clear()
        on_bus = {name: [block for block in drives if block.bus == name] for name in self.buses}
        for bus in self.buses.values():
            bus.take()  # old reports
        while not until():
            due = time.monotonic() + POLL_PERIOD
            for block in drives:
                if (frame := self.queries[block.path].frame) is not None:
                    self.buses[block.bus].send(frame, "disable")
                    self.queried[block.path] += 1
            while True:
                for name, bus in self.buses.items():
                    for frame, when in bus.arrivals():
                        self._note(seen, on_bus[name], frame, when)
                if (left := due - time.monotonic()) <= 0.0:
                    break
                time.sleep(min(left, 0.001))
        return seen

    def _note(self, seen: dict[str, list[Sample]], drives: list[Any], frame: Any, when: float) -> None:
        """Add the sample in a frame, if it is a reply of one of the drives."""
        for block in drives:
            answer = self.queries[block.path].read(*frame)
            if answer is not None:
                ratio = block.gear_ratio
                velocity = 0.0 if answer.velocity is None else answer.velocity / ratio
                seen[block.path].append(Sample(when, answer.position / ratio, velocity, answer))

    def for_seconds(self, seconds: float, drives: list[Any] | None = None) -> dict[str, list[Sample]]:
        """Return `watch` over a duration in s."""
        end = time.monotonic() + seconds
        return self.watch(lambda: time.monotonic() >= end, drives)

    def until_entered(self, instruction: str) -> dict[str, list[Sample]]:
        """Show an instruction, and return `watch` of every drive until the operator presses Enter."""
        self.take()
        print_lines([f"  > {instruction}, then press Enter"])
        discard_typed()
        return self.watch(enter_pressed)

    def at_rest(self, block: Any) -> list[Sample]:
        """Return the Samples of a drive at rest. Raises Lost if it does not respond."""
        for _ in range(ATTEMPTS):  # a busy computer may have queried late
            if samples := self.for_seconds(STILL_TIME, [block])[block.path]:
                return samples
        raise Lost(f"the drive did not respond for {ATTEMPTS * STILL_TIME:g} s")


def ask(question: str) -> str:
    """Return the operator's answer to a question. Raises BadInput at the end of standard input."""
    print_lines([f"  > {question}"])
    discard_typed()
    line = sys.stdin.readline()
    if not line:
        raise BadInput(f"standard input ended at the question: {question}")
    return line.strip()


def number(question: str, default: float | None = None) -> float | None:
    """Return the operator's number, or the default for an empty line; asks again until it is one above zero."""
    while True:
        text = ask(question)
        if not text:
            return default
        try:
            if 0.0 < (value := float(text)) < float("inf"):
                return value
        except ValueError:
            pass
        print_lines([f"    {text}: expected a number above 0"])


def confirmed(question: str) -> bool:
    """Return whether the operator answers y or yes."""
    return ask(f"{question}? yes or no").lower() in ("y", "yes")
