"""Lost frames and common causes before a fault: commands without a reply, and other devices that are silent too."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from graph import Device
from graph.signal import Signal
from runtime.host.console.styles import count

if TYPE_CHECKING:
    from runtime.record.report.run_result import RunResult

LOST_FRACTION_MINIMUM = 0.02  # of the commands, from which the fault may result from lost frames
LOST_REPLIES_MINIMUM = 3
NAMES_LIMIT = 3  # devices in a text
CONSEQUENCES = {"silent": "", "not following": ", perhaps also the one that enables the drive"}


def also_silent(result: RunResult) -> str:
    """Return text such as '; 7 other devices are silent as well ...' for a silent device, '' if no other one is.

    A device counts from half of its timeout on.
    """
    if result.outcome.status != "silent" or result.failed_in_plant:
        return ""
    others = [
        block.path
        for block in result.diagram
        if isinstance(block, Device)
        and block.path != result.outcome.culprit
        and "age" in block.outputs
        and result.control.final[result.schedule.signals[Signal(block, "age").path].slot] > 0.5 * block.timeout > 0.0
    ]
    if not others:
        return ""
    verb = "is" if len(others) == 1 else "are"
    return (
        f"; {count(len(others), 'other device')} {verb} silent as well ({', '.join(others[:NAMES_LIMIT])}"
        f"{', ...' if len(others) > NAMES_LIMIT else ''}): check what they share, such as a hub, a supply or the load "
        "of the computer"
    )


def before_fault(result: RunResult) -> str:
    """Return text such as '; 240 of its 813 commands had no reply ...' for a fault that lost frames may explain.

    The text is empty for any other fault. The commands within the timeout of a silent device do not count.
    """
    outcome = result.outcome
    block = result.diagram.blocks.get(outcome.culprit or "")
    if outcome.status not in CONSEQUENCES or result.failed_in_plant or not isinstance(block, Device):
        return ""
    patience = min(block.timeout, getattr(block, "restart_time", 0.0) or block.timeout)
    errors = result.statistics.get("frames", {}).get("errors", 0)
    reported = f"; the CAN controllers reported {count(errors, 'error frame')}" if errors else ""
    silence = math.ceil(patience * result.schedule.rate) if outcome.status == "silent" else 0
    commands = outcome.tick - silence
    lost = result.control.reports.missed.get(block.path, 0) - silence
    if lost < max(LOST_REPLIES_MINIMUM, LOST_FRACTION_MINIMUM * commands):
        return f"{reported}: check wiring, termination and bitrate of bus {block.bus}" if reported else ""
    return (
        f"{reported}; {lost} of its {commands} commands before had no reply by the next one: frames are lost on bus "
        f"{block.bus}{CONSEQUENCES[outcome.status]}. Check wiring, termination, adapter and load of the bus"
    )
