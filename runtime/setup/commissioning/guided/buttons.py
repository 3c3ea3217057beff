"""Step of an emergency-stop button: it ends a run when it is pressed, and only then. No motor is enabled."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from graph import Diagram
from runtime.setup.commissioning.guided.bench import Bench, Given, Result, ask
from runtime.setup.commissioning.guided.driven import OF_COMPUTER, failed, run_on_rig
from runtime.setup.commissioning.guided.sensors import copied

if TYPE_CHECKING:
    from runtime.session.result import Result as RunResult

RELEASED_TIME, PRESS_TIME = 2.0, 8.0  # s
RATE = 200.0  # Hz
PRESSED = "e-stop"  # status of a run that a button has ended


def press(bench: Bench, block: Any, given: Given) -> Result:
    """Compare a button with its block: released, pressed, and released again."""
    ask(f"Release {block.path}, then press Enter")
    released = run_of(bench, block, RELEASED_TIME)
    if released.outcome.faulted:
        return press_of(block, released, None, None)
    ask(f"Press Enter. Once it is running, press {block.path} within 5 s, and keep it pressed")
    pressed = run_of(bench, block, PRESS_TIME)
    ask(f"Release {block.path} again, then press Enter")
    return press_of(block, released, pressed, run_of(bench, block, RELEASED_TIME))


def run_of(bench: Bench, block: Any, seconds: float) -> RunResult:
    """Run a diagram with one button, and nothing that moves."""
    with Diagram("button", rate=RATE) as diagram:
        copied(block)
    return run_on_rig(bench, diagram, math.ceil(seconds * RATE))


def press_of(block: Any, released: RunResult, pressed: RunResult | None, again: RunResult | None) -> Result:
    """Compare the ends of the runs with what the operator did. pressed, again : None if the first run has failed"""
    result = Result()
    for run in (released, pressed, again):
        if run is not None and run.outcome.status in OF_COMPUTER:
            return failed(result, block, run)
    outcome = released.outcome
    if outcome.status == PRESSED:
        result.find("pressed", "it reads as pressed while it is released: check contact, wiring and polarity")
    elif outcome.faulted or pressed is None or again is None:
        result.find("silent", f"it sends nothing, or not in order ({outcome.status}): check its power, bus and id")
    elif not pressed.outcome.faulted:
        result.find("no stop", f"the run continued for {PRESS_TIME:g} s although it was pressed: do not use this robot")
    elif pressed.outcome.status != PRESSED:
        result.find("lost when pressed", f"the run ended by {pressed.outcome.status}: it stops sending when pressed")
    elif again.outcome.faulted:
        result.find("not released", "it still stops the run after it was released: it sticks")
    else:
        result.says.append("ends a run when it is pressed, and not while it is released")
    return result
