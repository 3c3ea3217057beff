"""The steps of commissioning a drive or an inertial sensor, in their order, and what they need."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from blocks.sensors.insole import Insole
from graph import Actuator
from runtime.setup.commissioning.guided import (
    buttons,
    by_hand,
    driven,
    dynamics,
    encoder,
    home,
    insoles,
    law,
    passive,
    sensors,
    stops,
)
from runtime.setup.commissioning.guided.bench import BUTTONS, Lost, Result, Unmeasured

if TYPE_CHECKING:
    from collections.abc import Callable

    from runtime.setup.commissioning.guided.bench import Bench, Given

NOTHING = "nothing moves: only disable frames are sent"
NO_MOTOR = "you move; no motor is enabled"
BY_HAND = "you move the joint; its motor is off"
LEVER = "the motor turns the lever, by 30° at most; keep clear, with the power switch in your hand"
SWINGS = "the motor swings the joint, then turns it back and forth; keep clear, with the power switch in your hand"
ERROR_FRAMES = 3  # during a step, above which a bus has a fault; a plug that is moved causes one or two
HOMING = "the motor turns the joint to its stop and back; keep clear, with the power switch in your hand"


@dataclass(frozen=True)
class Step:
    """One step.

    does : what it does; moves : what could move; carry_out : (Bench, block, Given) -> Result
    driven : whether it enables the motor, which every finding before prevents
    vital : whether a finding ends the commissioning of the device
    on_request : whether it is carried out only if --only names it
    """

    name: str
    does: str
    moves: str
    carry_out: Callable[[Bench, Any, Given], Result]
    driven: bool = False
    vital: bool = False
    on_request: bool = False

    def of(self, bench: Bench, block: Any, given: Given) -> Result:
        """Carry out the step. A drive that no longer responds, and error frames meanwhile, are findings."""
        before = bench.errors(block.bus)
        result = self.attempt(bench, block, given, again=self.driven)
        errors = bench.errors(block.bus) - before
        if errors > ERROR_FRAMES and not result.findings:
            result.find(
                "bus errors",
                f"{errors} error frames on {block.bus} during this step: check termination, shield and a common "
                "ground, also while motors draw current",
            )
        return result

    def attempt(self, bench: Bench, block: Any, given: Given, again: bool) -> Result:
        """Carry out the step. again : whether to repeat it once if the drive is silent meanwhile, and then responds"""
        try:
            return self.carry_out(bench, block, given)
        except Unmeasured as reason:
            return Result([str(reason)], done=False)
        except Lost as lost:
            repeat = partial(self.attempt, bench, block, given, again=False) if again else None
            return passive.after_silence(bench, block, str(lost), repeat)


STEPS = (
    Step("identity", "protocol, ids, firmware", NOTHING, passive.identity, vital=True),
    Step("bus", "errors of the bus, replies and their time", NOTHING, passive.bus),
    Step("state", "errors and noise at rest", NOTHING, passive.state),
    Step("zero", "silence after its zero is set", NOTHING, passive.zero),
    Step("pose", "zero of the joint", BY_HAND, encoder.pose),
    Step("turn", "direction, encoded ranges and wraps", BY_HAND, by_hand.turn),
    Step("motion", "range of the joint", BY_HAND, by_hand.motion),
    Step("torque", "direction and scale of the torque", LEVER, driven.torque, driven=True),
    Step("law", "encoded ranges of stiffness and damping", LEVER, law.law, driven=True),
    Step("silence", "its own stop when frames stop", LEVER, driven.silence, driven=True),
    Step("stops", "time to no torque after each way to end a run", LEVER, stops.stops, driven=True, on_request=True),
    Step("supply", "supply voltage without and with load", LEVER, stops.supply, driven=True, on_request=True),
    Step("dynamics", "friction, inertia and feel", SWINGS, dynamics.dynamics, driven=True, on_request=True),
    Step("home", "place of a stop", HOMING, home.home, driven=True, on_request=True),
)
SENSOR_STEPS = (
    Step("rest", "rate, drop-outs, noise and bias", NO_MOTOR, sensors.rest),
    Step("bend", "its segment, its axes and its strap", NO_MOTOR, sensors.bend),
)

INSOLE_STEPS = (Step("load", "its side, its force, its direction and lost frames", NO_MOTOR, insoles.load),)
BUTTON_STEPS = (Step("press", "pressed and released", NO_MOTOR, buttons.press),)


def steps_of(block: Any) -> tuple[Step, ...]:
    """Return the steps of a device."""
    if isinstance(block, BUTTONS):
        return BUTTON_STEPS
    return STEPS if isinstance(block, Actuator) else INSOLE_STEPS if isinstance(block, Insole) else SENSOR_STEPS
