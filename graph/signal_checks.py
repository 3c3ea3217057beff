"""Warnings of signals that are not what a block takes them for: a periodic value that jumps at the ends of its circle,
and a command whose limit lies behind the controller that integrates towards it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from graph.block import Sink, are_ranges, range_of
from graph.device import Device
from graph.interval import EVERYTHING, Interval
from graph.signal import Signal
from graph.upstream import followers_of

if TYPE_CHECKING:
    from graph.block import Block
    from graph.compilation import Compilation

LARGE = 1e9  # of an input, beyond what any limiter passes


def check_circles(compilation: Compilation) -> None:
    """Warn of a periodic value, such as a heading, at an input that must change smoothly."""
    starts = [
        Signal(block, name) for block in compilation.blocks for name, port in block.outputs.items() if port.circle
    ]
    followers = followers_of(compilation.sources) if starts else {}
    for start in starts:
        block, name = start.block, start.port
        low, high = block.outputs[name].circle
        for reader, input in jumps(start, followers):
            compilation.report(
                "TW033",
                f"{block.path}.{name} jumps between {low:.4g} and {high:.4g} {compilation.units[block, name]}, "
                "which are the same value, and each jump is treated as motion",
                reader,
                input,
                compilation.where(reader, input),
                "put Unwrap in front, filter its sine and cosine and take their Atan2, or use the angular velocity of "
                "the sensor",
                "warning",
            )


def jumps(start: Signal, followers: dict[Signal, list[tuple[Block, str]]]) -> Iterator[tuple[Block, str]]:
    """Yield (block, input) where a value that jumps reaches an input that must be smooth."""
    waiting, seen = deque([start]), {start}
    while waiting:
        for block, name in followers.get(waiting.popleft(), ()):
            if name in block.smooth:
                yield block, name
            elif block.passes_jumps:
                onward = [
                    signal for signal in (Signal(block, output) for output in block.outputs) if signal not in seen
                ]
                seen.update(onward)
                waiting.extend(onward)


def check_windup(compilation: Compilation) -> None:
    """Warn of a controller with an integral whose command is clipped behind it."""
    starts = [
        Signal(block, name)
        for block in compilation.blocks
        for name, tracking in block.winds_up.items()
        if not isinstance(compilation.sources[block, tracking], Signal)
    ]
    followers = followers_of(compilation.sources) if starts else {}
    for start in starts:
        block, name = start.block, start.port
        reach = compilation.ranges.get(start, EVERYTHING)
        for limiter, clipped in limiters(start, reach, followers):
            compilation.report(
                "TW034",
                f"its {name} can reach {reach}, and {limiter.path} passes {clipped}: beyond, the integral "
                "continues, and later holds the command at that limit",
                block,
                name,
                hint=f"give the limits to the controller, as in lower={clipped.low:.4g}, upper={clipped.high:.4g}, or "
                f"connect the limited command to its input {block.winds_up[name]}",
                severity="warning",
            )


def limiters(
    start: Signal, reach: Interval, followers: dict[Signal, list[tuple[Block, str]]]
) -> Iterator[tuple[Block, Interval]]:
    """Yield (limiter, Interval in units of the signal) of each limiter that clips a signal, also behind gains."""
    waiting, seen = deque([(start, reach, 1.0)]), {start}
    while waiting:
        signal, interval, gain = waiting.popleft()
        for block, name in followers.get(signal, ()):
            if isinstance(block, (Device, Sink)):
                continue
            for output in block.outputs:
                large, larger = (
                    output_interval_of(block, output, name, Interval(-size, size)) for size in (LARGE, 10.0 * LARGE)
                )
                if large is None or larger is None:
                    continue
                if large == larger:
                    if block.clips and large.bounded and interval not in large:
                        yield block, Interval(*sorted((large.low / gain, large.high / gain)))
                    continue
                scale = output_interval_of(block, output, name, Interval.point(1.0))
                onward = Signal(block, output)
                passed = output_interval_of(block, output, name, interval)
                if passed is not None and scale is not None and scale.low == scale.high != 0.0 and onward not in seen:
                    seen.add(onward)
                    waiting.append((onward, passed, gain * scale.low))


def output_interval_of(block: Block, output: str, name: str, interval: Interval) -> Interval | None:
    """Return the output interval of a block for an interval at one input, the others 0; None if it states none."""
    inputs: dict[str, Any] = {other: Interval.point(0.0) for other in block.inputs} | {name: interval}
    try:
        stated = block.output_range(**inputs)
    except Exception:
        return None
    return range_of(block, output, stated) if are_ranges(stated) else None
