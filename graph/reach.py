"""Check for setpoints in rad, rad/s or N·m that the joint or its drive cannot reach.

A constant, a parameter or a trajectory can affect a joint in two ways. A block compares it with a measurement of the
joint, as the equilibrium of an impedance is with the position; or connections of one unit lead from it to a command.
The check compares the value at that input, at the command, or at a limiter before the command, with the gains between
applied.

A value is compared with the `range` of the joint if its declaration has a unit or its block computes a torque.
Thresholds, offsets and sums with the unit "any" may be outside that range; they are compared with the limits of the
drive only.
"""

from __future__ import annotations

import copy
import math
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from graph import units
from graph.block import Sink, are_ranges, range_of
from graph.declarations import LiveBounds
from graph.device import Actuator, Device
from graph.hints import for_degrees
from graph.interval import EVERYTHING, Interval
from graph.narrowing import is_table
from graph.ranges import find_ranges, interval_of, interval_of_numbers
from graph.signal import Signal
from graph.upstream import followers_of

if TYPE_CHECKING:
    import numpy as np

    from graph.block import Block
    from graph.compilation import Compilation

POSITION, VELOCITY, TORQUE = "rad", "rad/s", "N·m"
TURN = 2.0 * math.pi
SLACK = 1e-6  # tolerance relative to the width of a limit: intervals are rounded outward
ZERO = Interval.point(0.0)


class Reach(NamedTuple):
    """Limits of one measurement of an actuator.

    drive : Interval of the drive; words : its source, for messages
    joint : Interval of the joint, None if its range is not declared
    """

    drive: Interval
    words: str
    joint: Interval | None = None


class Value(NamedTuple):
    """A value to check.

    words : start of the message; certain : the signal takes the value without further inputs; chosen : only a live
    change can set it
    """

    words: str
    interval: Interval
    certain: bool = True
    chosen: bool = False


def check_reach(compilation: Compilation) -> None:
    """Report the setpoints that a joint or its drive cannot reach.

    compilation : Compilation after the range proof
    """
    reaches = {
        block: reach
        for block in compilation.blocks
        if isinstance(block, Actuator) and (reach := compilation.attempt(block, block.reach))
    }
    if reaches:
        SetpointCheck(compilation, reaches).run()


class SetpointCheck:
    """Comparison of all setpoints of a diagram with the limits of its joints.

    compilation : Compilation after the range proof; receives the problems
    reaches : {actuator: {output or command: Reach}}
    """

    def __init__(self, compilation: Compilation, reaches: dict[Actuator, dict[str, Reach]]) -> None:
        self.blocks, self.sources, self.wires = compilation.blocks, compilation.sources, compilation.wires
        self.units, self.shared_units, self.ranges = compilation.units, compilation.shared_units, compilation.ranges
        self.attempt = compilation.attempt
        self.unproved = {(proof.path, proof.port) for proof in compilation.proofs if not proof.holds}
        self.report = compilation.report
        self.reaches = reaches
        self.followers = followers_of(self.sources)
        self.in_drive = self.while_measuring(compilation.order, lambda reach: reach.drive)
        self.in_joint = self.while_measuring(compilation.order, lambda reach: reach.joint or reach.drive)
        self.fed = self.find_fed()
        self.leads = self.find_leads()
        self.reported: set[tuple[Block, str, str]] = set()

    def run(self) -> None:
        """Report every setpoint outside its limits."""
        for block in self.blocks:
            if not isinstance(block, (Device, Sink)):
                self.look_beside_measurements(block)
        for block, name, value, start in self.seeds():
            self.follow(block, name, value, start)

    def while_measuring(self, order: Sequence[Block], limits: Callable[[Reach], Interval]) -> dict[Signal, Interval]:
        """Return the intervals of all signals while each position and velocity is inside limits(Reach)."""
        narrow: dict[Block, dict[str, Interval]] = {
            block: {
                name: limits(measurement)
                for name, measurement in reach.items()
                if self.units.get((block, name)) in (POSITION, VELOCITY)
            }
            for block, reach in self.reaches.items()
        }
        if all(
            self.ranges[Signal(block, name)] in limits
            for block, limited in narrow.items()
            for name, limits in limited.items()
        ):
            return self.ranges

        def attempt(block: Block, hook: Callable[..., Any], **intervals: Interval) -> Any:
            stated = self.attempt(block, hook, **intervals)
            return (stated if is_table(stated) else {}) | narrow[block] if narrow.get(block) else stated

        return find_ranges(self.blocks, order, self.sources, attempt)

    def unit_of(self, block: Block, name: str) -> str:
        """Return the unit of an input, even of a constant at an input with the unit "any"."""
        unit = self.units[block, name]
        return self.shared_units.get(block, unit) if unit == units.ANY and name not in block.free_units else unit

    # Connections between values and joints

    def find_fed(self) -> dict[tuple[Block, str], dict[tuple[Actuator, str], None]]:
        """Return {(block, input): {(actuator, output)}} for the inputs that a measurement reaches in one unit."""
        fed: dict[tuple[Block, str], dict[tuple[Actuator, str], None]] = {}
        for actuator, reach in self.reaches.items():
            for output in reach.keys() & actuator.outputs.keys():
                waiting = deque([Signal(actuator, output)])
                seen: set[Signal] = set()
                while waiting:
                    signal = waiting.popleft()
                    for block, name in self.followers.get(signal, ()):
                        if isinstance(block, (Device, Sink)):
                            continue
                        fed.setdefault((block, name), {})[actuator, output] = None
                        for onward in self.outputs_in(block, self.units[signal.block, signal.port]):
                            if onward not in seen:
                                seen.add(onward)
                                waiting.append(onward)
        return fed

    def find_leads(self) -> dict[Signal, dict[tuple[Actuator, str], None]]:
        """Return {Signal: {(actuator, input)}} for the signals that reach a command in one unit."""
        leads: dict[Signal, dict[tuple[Actuator, str], None]] = {}
        for actuator in self.reaches:
            for name in actuator.inputs:
                unit = self.units[actuator, name]
                waiting: deque[tuple[Block, str]] = deque([(actuator, name)])
                seen: set[Signal] = set()
                while waiting and self.reach_of(actuator, unit) is not None:
                    source = self.sources[waiting.popleft()]
                    if not isinstance(source, Signal) or isinstance(source.block, Device) or source in seen:
                        continue
                    seen.add(source)
                    leads.setdefault(source, {})[actuator, name] = None
                    waiting.extend(
                        (source.block, before)
                        for before in source.block.inputs
                        if self.unit_of(source.block, before) == unit
                    )
        return leads

    def outputs_in(self, block: Block, unit: str) -> list[Signal]:
        """Return the outputs of a block with a unit."""
        return [Signal(block, name) for name in block.outputs if self.units[block, name] == unit]

    def reach_of(self, actuator: Any, unit: str) -> Any:
        """Return the reach of an actuator's measurement or command in a unit; None if it has none."""
        return next(
            (reach for name, reach in self.reaches[actuator].items() if self.units.get((actuator, name)) == unit), None
        )

    # Values compared with a measurement

    def look_beside_measurements(self, block: Block) -> None:
        """Check the setpoints of a block that compares them with the position or velocity of an actuator."""
        for unit in (POSITION, VELOCITY):
            measured = {
                (actuator, name): source
                for name in block.inputs
                if self.unit_of(block, name) == unit
                if isinstance(source := self.sources[block, name], Signal)
                for actuator, _ in self.fed.get((block, name), ())
            }
            if not measured:
                continue
            to_torque = any(self.units[block, name] == TORQUE for name in block.outputs)
            for name, port in block.inputs.items():
                if self.unit_of(block, name) == unit and (block, name) in self.wires and (block, name) not in self.fed:
                    source = self.sources[block, name]
                    for actuator, other in measured:
                        strict = port.unit != units.ANY or to_torque
                        self.judge(actuator, unit, self.values(source), block, name, measured[actuator, other], strict)
            for name, param in block.parameters.items():
                if param.unit == unit and param.numeric and math.isfinite(getattr(block, name)):
                    for actuator, other in measured:
                        self.judge(
                            actuator, unit, self.values_of(block, name), block, name, measured[actuator, other], True
                        )

    def values(self, source: np.ndarray | Signal) -> list[Value]:
        """Return the Values of the source of an input."""
        if not isinstance(source, Signal):
            return [Value("", interval_of_numbers(source))]
        interval = interval_of(source, self.ranges)
        if source.block.inputs or isinstance(source.block, Device):
            return [Value(f"{source.path} can reach ", interval, certain=False)]
        built = self.as_built(source)
        values = [Value("" if is_point(built) else f"{source.path} covers ", built)]
        return (
            values
            if interval == built
            else [*values, Value(f"the live bounds of {source.block.path} allow ", interval, chosen=True)]
        )

    def as_built(self, source: Signal) -> Interval:
        """Return the interval of a block without inputs, at the initial values of its live parameters."""
        block = copy.copy(source.block)
        block.live = dict[str, LiveBounds]().get  # no parameter is live
        return range_of(block, source.port, promised(block))

    def values_of(self, block: Block, name: str) -> list[Value]:
        """Return the values that a parameter can have: as built, and within its live bounds. name : its name"""
        built, span = Interval.point(float(getattr(block, name))), block.span(name)
        values = [Value("", built, certain=False)]
        return values if span == built else [*values, Value(f"the live bounds of {name} allow ", span, chosen=True)]

    def judge(
        self,
        actuator: Actuator,
        unit: str,
        values: Sequence[Value],
        block: Block,
        name: str,
        measured: Signal,
        strict: bool,
    ) -> None:
        """Compare Values with the limits of a measurement at another input of the same block.

        strict : compare with the range of the joint as well
        """
        reach = self.reach_of(actuator, unit)
        drive, joint = interval_of(measured, self.in_drive), interval_of(measured, self.in_joint)
        if not drive.bounded:
            return
        if not strict:
            drive, joint = (drive | Interval(-TURN, TURN) if unit == POSITION else drive), None
        self.compare(actuator, unit, reach, values, block, name, drive, joint if reach.joint is not None else None)

    def compare(
        self,
        actuator: Actuator,
        unit: str,
        reach: Reach,
        values: Sequence[Value],
        block: Block,
        name: str,
        drive: Interval,
        joint: Interval | None,
    ) -> None:
        """Report the first of the Values outside its limits. drive, joint : limits at that input, or None"""
        for value in values:
            severity = self.severity(value, drive, joint, unit)
            if severity is None:
                continue
            limits, words = (reach.joint, "its range") if joint and reach.joint else (reach.drive, reach.words)
            self.report_value(actuator, unit, value, block, name, limits, words, severity)
            return

    def severity(self, value: Value, drive: Interval, joint: Interval | None, unit: str) -> str | None:
        """Return "error" or "warning" for a Value outside its limits, None for another."""
        interval = value.interval
        alone = is_point(interval)
        for bound in filter(None, (drive, joint)):
            if apart(interval, bound) and not value.chosen:
                return "error" if bound is drive or value.certain else "warning"
        if interval.bounded and not inside(interval, drive):
            return "error" if value.certain and not value.chosen else "warning"
        if joint is not None and value.certain and not inside(interval, joint):
            return "warning"
        if alone and unit == POSITION and abs(interval.low) > TURN and math.radians(interval.low) in (joint or drive):
            return "warning"
        return None

    # Values that lead to a command

    def seeds(self) -> Iterator[tuple[Block, str, Value, tuple[Block, str, str]]]:
        """Yield (block, input, Value, (block, port, unit) to report) of values that lead to a command in one unit."""
        for (block, name), source in self.sources.items():
            unit = self.unit_of(block, name)
            if unit not in (POSITION, VELOCITY, TORQUE) or (block, name) not in self.wires or isinstance(block, Sink):
                continue
            if not isinstance(source, Signal):
                yield block, name, self.values(source)[0], (block, name, unit)
            elif source in self.leads:
                for value in self.own_values(source, unit):
                    yield block, name, value, (source.block, "", unit)

    def own_values(self, source: Signal, unit: str) -> Iterator[Value]:
        """Yield the Values that a block sets for all inputs: a source, a table, a limiter, a parameter in N·m."""
        if not source.block.inputs:
            yield from self.values(source)
            return
        if source.block.outputs[source.port].range is None:
            own = range_of(
                source.block, source.port, promised(source.block, **dict.fromkeys(source.block.inputs, EVERYTHING))
            )
            if own.bounded:
                yield Value(f"{source.path} can reach ", own, certain=False)
        for name, param in source.block.parameters.items():
            if unit == TORQUE and param.unit == unit and param.numeric and math.isfinite(getattr(source.block, name)):
                yield Value(f"{name} is ", Interval.point(float(getattr(source.block, name))), certain=False)

    def follow(self, block: Block, name: str, value: Value, start: tuple[Block, str, str]) -> None:
        """Propagate a Value along the connections and compare it where it ends."""
        whose, port, unit = start
        waiting = deque([(block, name, value.interval)])
        seen: set[tuple[Block, str]] = set()
        while waiting:
            block, name, interval = waiting.popleft()
            if (block, name) in seen:
                continue
            seen.add((block, name))
            if block in self.reaches:
                self.at_command({(block, name): None}, unit, value._replace(interval=interval), whose, port)
                continue
            if isinstance(block, (Device, Sink)):
                continue
            for onward in self.outputs_in(block, unit):
                if onward in self.leads:
                    passed = self.passed(block, name, onward, interval)
                    if passed is None:
                        self.at_command(self.leads[onward], unit, value._replace(interval=interval), whose, port)
                    else:
                        waiting.extend((*follower, passed) for follower in self.followers.get(onward, ()))

    def passed(self, block: Block, name: str, onward: Signal, interval: Interval) -> Interval | None:
        """Return the output interval of a block for an interval at one input, with the other inputs at 0.

        Returns the interval itself if the block passes it, and None if the block clips it.
        """

        def of(given: Interval) -> Interval:
            return range_of(block, onward.port, promised(block, **dict.fromkeys(block.inputs, ZERO) | {name: given}))

        made = of(interval)
        if interval in made or -interval in made:
            return interval
        return None if of(interval * Interval.point(10.0)) == made else made

    def at_command(self, commands: dict[Any, None], unit: str, value: Value, block: Block, port: str) -> None:
        """Check a value that reaches the commands of actuators.

        commands : (actuator, input) pairs, in order
        unit : unit of the value
        block, port : block and port that the value belongs to
        """
        for actuator, name in commands:
            reach = self.reach_of(actuator, unit)
            if (actuator.path, name) in self.unproved or unit == TORQUE and inside(value.interval, reach.drive):
                continue
            if unit == TORQUE:
                self.report_value(actuator, unit, value, block, port, reach.drive, reach.words, "warning")
            else:
                self.compare(actuator, unit, reach, [value], block, port, reach.drive, reach.joint)

    # Messages

    def report_value(
        self,
        actuator: Actuator,
        unit: str,
        value: Value,
        block: Block,
        name: str,
        limits: Interval,
        words: str,
        severity: str,
    ) -> None:
        """Report a value outside the limits of an actuator, once for each parameter or input and unit.

        block, name : block and parameter that the value belongs to
        words : what the limits are
        severity : "error" or "warning"
        """
        if (block, name, unit) in self.reported:
            return
        self.reported.add((block, name, unit))
        interval = value.interval
        number = interval.low if abs(interval.low) > abs(interval.high) else interval.high
        what = f"{number:g} {unit}" if is_point(interval) else f"{interval.low:g} to {interval.high:g} {unit}"
        bounds = f"{limits.low:.4g} to {limits.high:.4g} {unit}"
        if unit == TORQUE:
            hint = (
                f"set at most {limits.high:.4g} N·m. If a Gain scales the torque down, place the value before the Gain"
            )
        else:
            correction = f", or correct `range` of {actuator.path}" if words == "its range" else ""
            hint = for_degrees(number, unit, limits) or f"set {bounds}{correction}"
        problem = "is more than one turn of" if inside(interval, limits) else "is outside the limits of"
        where = self.wires[block, name].where if (block, name) in self.wires else None
        self.report(
            "TW026",
            f"{value.words}{what}, which {problem} {actuator.path}: {bounds} ({words})"
            if value.words
            else f"{what} {problem} {actuator.path}: {bounds} ({words})",
            block,
            name,
            where,
            hint,
            severity,
        )


def promised(block: Block, **inputs: Interval) -> dict[str, Interval] | Interval:
    """Return the output range of a block, {} if it states none or rejects the inputs."""
    try:
        stated = block.output_range(**inputs)
    except (ValueError, TypeError):  # a combination that does not occur: find_ranges checks those that do
        return {}
    return {} if stated is None or not are_ranges(stated) else stated


def inside(interval: Interval, bound: Interval) -> bool:
    """Return whether an interval lies inside a bound, up to rounding."""
    slack = SLACK * (bound.high - bound.low)
    return bound.low - slack <= interval.low and interval.high <= bound.high + slack


def apart(interval: Interval, bound: Interval) -> bool:
    """Return whether an interval and a bound have no number in common, up to rounding."""
    slack = SLACK * (bound.high - bound.low)
    return interval.high < bound.low - slack or interval.low > bound.high + slack


def is_point(interval: Interval) -> bool:
    """Return whether an interval is one number, up to rounding."""
    return interval.high - interval.low <= SLACK * abs(interval.high)
