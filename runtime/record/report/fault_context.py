"""State before a fault: the newest ticks, and the last command and feedback of each actuator."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from graph.device import actuators_of
from graph.signal import Signal

if TYPE_CHECKING:
    from graph.block import Block
    from graph.diagram import Diagram
    from runtime.record.report.run_result import RunResult

TABLE_SIGNAL_LIMIT = 8  # signals in the table of the newest ticks


def ticks(result: RunResult, block: Block | None) -> list[str]:
    """Return a table of the signals at a block over the newest ticks, ending with the fault.

    Without a block, the table has the signals of all actuators.
    """
    near = [path for path in dict.fromkeys(nearby(result.diagram, block)) if path in result.schedule.signals]
    lines = newest_ticks(result, near[:TABLE_SIGNAL_LIMIT])
    return ["ticks before the fault:", *lines] if lines else []


def inputs_and_outputs(result: RunResult, block: Block | None, width: int) -> list[str]:
    """Return tables of the signals at the inputs and at the outputs of a block, as many of the newest ticks as fit.

    Without a block, the tables have the commands and the feedback of all actuators. width : characters of a line
    """
    blocks = [block] if block is not None else actuators_of(result.diagram)
    lines: list[str] = []
    for each in blocks:
        sources = [wire.source for wire in result.diagram.wires if wire.block is each]
        groups = {
            "inputs": [source.path for source in sources if isinstance(source, Signal)],
            "outputs": [Signal(each, name).path for name in each.outputs],
        }
        for name, paths in groups.items():
            table = newest_ticks(result, paths, width)
            lines += [f"{name} of {each.path}:", *table] if table else []
    return lines


def newest_ticks(result: RunResult, paths: Sequence[str], width: int | None = None) -> list[str]:
    """Return a table of recorded signals over the newest ticks, ending with a fault.

    width : characters of a line, which leave room for fewer ticks; None for all ticks
    """
    schedule, rows = result.schedule, result.newest
    columns = {column.path: index for index, column in enumerate(schedule.recorded)}
    kept = [path for path in paths if path in columns]
    if not rows or not kept:
        return []
    failed = result.outcome.tick > rows[-1][0]
    header = ["tick", *(f"{row[0]:g}" for row in rows), *([f"{result.outcome.tick} (fault)"] if failed else [])]
    table = [header]
    for path in kept:
        values = [row[2 + columns[path]] for row in rows]
        if failed:
            values.append(result.control.final[schedule.signals[path].slot])
        unit = schedule.signals[path].unit
        table.append([path + (f" in {unit}" if unit not in ("1", "any") else ""), *map(_number, values)])
    lines = align_columns(table)
    while width is not None and max(map(len, lines)) > width and len(table[0]) > 2:
        for row in table:
            del row[1]
        lines = align_columns(table)
    return lines


def malformed_frames(result: RunResult, block: Any) -> str:
    """Return the malformed frames with a device's ID as text, '' for none."""
    malformed = result.control.reports.malformed.get(block.path)
    return block.malformed_in_words(*malformed) if malformed else ""


def instead(result: RunResult, block: Any) -> str:
    """Return what a device that did not reply to arming sent instead, as text, '' for nothing."""
    if block.path in result.control.reports.unzeroed:
        position = result.control.final[result.schedule.signals[f"{block.path}.position"].slot]
        return (
            f"it replies, but its zero was not set: it reads {position:.3f} rad. Keep the joint at rest during arming; "
            "if it was at rest, the drive does not set its zero"
        )
    return block.unready_in_words() if block.path in result.control.reports.unready else malformed_frames(result, block)


def nearby(diagram: Diagram, block: Block | None) -> Iterator[str]:
    """Yield the paths of a block's scalar inputs and outputs; without a block, those of every actuator."""
    blocks = [block] if block is not None else actuators_of(diagram)
    for each in blocks:
        yield from (
            wire.source.path for wire in diagram.wires if wire.block is each and isinstance(wire.source, Signal)
        )
    for each in blocks:
        yield from (
            Signal(each, name).path for name in each.outputs if block is not None or name in ("position", "torque")
        )


def actuators(result: RunResult) -> list[str]:
    """Return each actuator's state, last command and last feedback, a line each."""
    lines = []
    schedule, values, inputs = result.schedule, result.control.final, result.control.inputs
    for block in actuators_of(result.diagram):
        outputs: dict[str, Any] = {
            name: values[schedule.signals[Signal(block, name).path].slot] for name in block.outputs
        }
        sent = {
            name: value
            for name in block.sent_outputs
            if (value := outputs.pop(name)) is not None and name.endswith("_sent")
        }
        wired = {wire.port for wire in result.diagram.wires if wire.block is block}
        asked = {name: value for name, value in inputs(block.path).items() if name in wired}
        command = [_values_text(block.inputs, asked, "_command"), _values_text(block.outputs, sent)]
        feedback = {
            name: value
            for name, value in outputs.items()
            if name not in ("fault", "age", "active") and not absent(name, value)
        }
        lines += [
            f"{block.path}: {state_text(block, outputs, result)}",
            f"  command   {'; '.join(filter(None, command))}",
            f"  feedback  {_values_text(block.outputs, feedback)}",
        ]
    return lines


def _values_text(ports: Mapping[str, Any], values: dict[str, float], suffix: str = "") -> str:
    return ", ".join(
        f"{name.removesuffix(suffix).replace('_', ' ')} {_number(value)} {ports[name].unit}"
        for name, value in values.items()
    )


def absent(name: str, value: float) -> bool:
    """Return whether the replies of a drive do not contain a value."""
    return name == "temperature" and value != value


def state_text(block: Any, feedback: dict[str, float], result: RunResult) -> str:
    """Return an actuator's state as text. feedback : {output: value}"""
    words = []
    if block.path in result.outcome.unanswered:
        return instead(result, block) or "never replied"
    if not feedback.get("active", 1.0):
        words.append("taken out")
    if feedback.get("fault"):
        words.append(f"fault: {block.fault_in_words(int(feedback['fault']))}")
    age = feedback.get("age", 0.0)
    if block.timeout and age > block.timeout:
        words.append(f"no reply for {age * 1e3:.0f} ms")
    else:
        words.append(f"last reply {age * 1e3:.1f} ms before")
    words.append("stop NOT confirmed" if block.path in result.outcome.unconfirmed else "stop confirmed")
    return ", ".join(words)


def _number(value: float) -> str:
    return format(value, ".4g") if math.isfinite(value) else str(float(value))


def align_columns(table: Sequence[list[str]]) -> list[str]:
    """Return rows of cells as lines with aligned columns, numbers to the right."""
    widths = [max(len(row[place]) for row in table) for place in range(len(table[0]))]
    numeric = {place for place in range(1, len(widths)) if all(_is_number(row[place]) for row in table[1:])}
    return [
        "  "
        + "  ".join(
            cell.rjust(width) if place in numeric else cell.ljust(width)
            for place, (cell, width) in enumerate(zip(row, widths))
        ).rstrip()
        for row in table
    ]


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
