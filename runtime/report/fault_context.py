"""What a fault leaves for whoever has to mend it: the last ticks before it, and each actuator: what it was asked, what
it said.
"""

import math

from graph import Actuator
from graph.signal import Signal

MOST = 8  # signals of the last ticks


def ticks(result, block):
    """Lines: the signals at a block over the last ticks, with the one that failed at the end. Of the actuators where it
    is no block's fault.

    result : runtime.session.run.Result
    """
    schedule, rows = result.schedule, result.newest
    near = [path for path in dict.fromkeys(nearby(result.diagram, block)) if path in schedule.signals][:MOST]
    columns = {column.path: index for index, column in enumerate(schedule.recorded)}
    kept = [path for path in near if path in columns]
    if not rows or not kept:
        return []
    failed = result.outcome.tick > rows[-1][0]
    header = ["tick", *(f"{row[0]:g}" for row in rows), *([f"{result.outcome.tick}, the fault"] if failed else [])]
    table = [header]
    for path in kept:
        values = [row[2 + columns[path]] for row in rows]
        if failed:
            values.append(result.control.final[schedule.signals[path].slot])
        unit = schedule.signals[path].unit
        table.append([path + (f" in {unit}" if unit not in ("1", "any") else ""), *map(number, values)])
    return ["the last ticks before it:", *aligned(table)]


def rejected(result, block):
    """Frames of a device's own id that it could not read, in words; '' for none."""
    found = result.control.malformed.get(block.path)
    return block.malformed_in_words(*found) if found else ""


def instead(result, block):
    """What a device did that has not answered arming, in words; '' for nothing."""
    return block.unready_in_words() if block.path in result.control.unready else rejected(result, block)


def nearby(diagram, block):
    """Paths of the scalar signals that a block takes and gives; of what is asked of every actuator and heard from it if
    there is no block.
    """
    wanted = [block] if block is not None else [each for each in diagram if isinstance(each, Actuator)]
    for each in wanted:
        yield from (
            wire.source.path for wire in diagram.wires if wire.block is each and isinstance(wire.source, Signal)
        )
    for each in wanted:
        yield from (
            Signal(each, name).path for name in each.outputs if block is not None or name in ("position", "torque")
        )


def actuators(result):
    """Lines: what each actuator was asked last, what it said last, and what that means."""
    table = [["actuator", "asked", "heard", "meaning"]]
    schedule, values, inputs = result.schedule, result.control.final, result.control.inputs
    for block in result.diagram:
        if not isinstance(block, Actuator):
            continue
        outputs = {name: values[schedule.signals[Signal(block, name).path].slot] for name in block.outputs}
        sent = {
            name: value
            for name in block.sent_outputs
            if (value := outputs.pop(name)) is not None and name.endswith("_sent")
        }
        wired = {wire.port for wire in result.diagram.wires if wire.block is block}
        asked = {name: value for name, value in inputs(block.path).items() if name in wired}
        table.append(
            [
                block.path,
                spelled(block.inputs, asked, "_command")
                + "".join(f"; {text}" for text in [spelled(block.outputs, sent)] if text),
                spelled(
                    block.outputs,
                    {
                        name: value
                        for name, value in outputs.items()
                        if name not in ("fault", "age") and not absent(name, value)
                    },
                ),
                meaning(block, outputs, result),
            ]
        )
    return aligned(table) if len(table) > 1 else []


def spelled(ports, values, suffix=""):
    return ", ".join(
        f"{name.removesuffix(suffix).replace('_', ' ')} {number(value)} {ports[name].unit}"
        for name, value in values.items()
    )


def absent(name, value):
    """Whether a drive's replies carry no such thing."""
    return name == "temperature" and value != value


def meaning(block, heard, result):
    """What an actuator's state says, in words."""
    words = []
    if block.path in result.outcome.unanswered:
        return instead(result, block) or "it never answered"
    if heard.get("fault"):
        words.append(f"fault: {block.fault_in_words(int(heard['fault']))}")
    age = heard.get("age", 0.0)
    if block.timeout and age > block.timeout:
        words.append(f"silent for {age * 1e3:.0f} ms")
    else:
        words.append(f"heard {age * 1e3:.1f} ms before")
    words.append("stop NOT confirmed" if block.path in result.outcome.unconfirmed else "stop confirmed")
    return ", ".join(words)


def number(value):
    return format(value, ".4g") if math.isfinite(value) else str(float(value))


def aligned(table):
    """Rows of cells as lines, each column as wide as its widest cell; numbers to the right."""
    widths = [max(len(row[place]) for row in table if place < len(row)) for place in range(max(map(len, table)))]
    numeric = {
        place for place in range(1, len(widths)) if all(is_number(row[place]) for row in table[1:] if place < len(row))
    }
    return [
        "  "
        + "  ".join(
            cell.rjust(width) if place in numeric else cell.ljust(width)
            for place, (cell, width) in enumerate(zip(row, widths))
        ).rstrip()
        for row in table
    ]


def is_number(cell):
    try:
        float(cell)
    except ValueError:
        return False
    return True
