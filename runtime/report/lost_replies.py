"""Frames lost before a fault of an actuator: its commands without a reply."""

from __future__ import annotations

from typing import TYPE_CHECKING

from graph import Device

if TYPE_CHECKING:
    from runtime.report.run_result import RunResult

LOST_FRACTION_MINIMUM = 0.02  # of the commands, from which the fault may result from lost frames
LOST_REPLIES_MINIMUM = 3
CONSEQUENCES = {"silent": "", "not following": ", perhaps also the one that enables the drive"}


def before_fault(result: RunResult) -> str:
    """Return text such as '; 240 of its 813 commands had no reply ...' for a fault that lost frames may explain.

    The text is empty for any other fault. The commands within the timeout of a silent device do not count.
    """
    outcome = result.outcome
    block = result.diagram.blocks.get(outcome.culprit or "")
    if outcome.status not in CONSEQUENCES or result.failed_in_plant or not isinstance(block, Device):
        return ""
    silence = round(block.timeout * result.schedule.rate) if outcome.status == "silent" else 0
    commands = outcome.tick - silence
    lost = result.control.reports.missed.get(block.path, 0) - silence
    if lost < max(LOST_REPLIES_MINIMUM, LOST_FRACTION_MINIMUM * commands):
        return ""
    return (
        f"; {lost} of its {commands} commands before had no reply by the next one: frames are lost on bus "
        f"{block.bus}{CONSEQUENCES[outcome.status]}. Check wiring, termination, adapter and load of the bus"
    )
