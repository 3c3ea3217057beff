"""Caveats: reasons why the torque of an actuator may exceed its limit, although its commands are proved."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from msgspec import Struct

from graph.device import Actuator

if TYPE_CHECKING:
    from graph.device import Device
    from graph.device_data import Deviation, TorqueBound

ACCEPT = "on a rig, arming requires --accept {}"


class Caveat(Struct, frozen=True):
    """A reason why the torque of an actuator may exceed its limit. On a rig, the operator must accept it.

    path : path of the actuator; setting : parameter that causes it; words : reason, as text
    deviates : whether it is a setting that differs from the table of the model, and not a mode
    factor : torque at the joint over the commanded torque if the table of the model is correct; None if unknown
    """

    path: str
    setting: str
    words: str
    deviates: bool
    factor: float | None = None

    @property
    def name(self) -> str:
        """Name under which it is accepted, such as 'left/knee.wire_torque'."""
        return f"{self.path}.{self.setting}"


def check_torque(compilation: Any) -> None:
    """Find the caveats of every actuator, and warn of them and of assumptions.

    Caveats are settings that differ from the table of the model, and modes whose command does not bound the torque.
    """
    for block in compilation.blocks:
        if not isinstance(block, Actuator):
            continue
        for deviation in compilation.attempt(block, block.deviations) or ():
            if not deviation.safe:
                _warn_of_deviation(compilation, block, deviation)
        for number, reason in compilation.attempt(block, block.assumptions) or ():
            compilation.report(
                "TW035",
                f"its limit rests on {number}, which is assumed: {reason}",
                block,
                hint="compare one torque with a load cell before the robot is worn",
                severity="warning",
            )
        bound = compilation.torque_bounds.get(block.path)
        if bound is not None and bound.kind in ("drive", "none"):
            _warn_of_mode(compilation, block, bound)


def _warn_of_deviation(compilation: Any, block: Actuator, deviation: Deviation) -> None:
    name = deviation.parameter
    caveat = Caveat(block.path, name, in_words(block, deviation), True, deviation.factor)
    compilation.caveats.append(caveat)
    where = block.set_from.get(name, ("",))[0] or "the diagram"
    compilation.report(
        "TW028",
        caveat.words,
        block,
        hint=f"correct or remove it in {where}, or verify it on this unit; {ACCEPT.format(caveat.name)}",
        severity="warning",
    )


def _warn_of_mode(compilation: Any, block: Actuator, bound: TorqueBound) -> None:
    reason = f": {bound.holds}" if bound.kind == "none" and bound.holds else ""
    caveat = Caveat(block.path, bound.setting, bound.limit_in_words() + reason, False)
    compilation.caveats.append(caveat)
    compilation.report(
        "TW029",
        caveat.words,
        block,
        hint=f"command a torque or a current instead; {ACCEPT.format(caveat.name)}",
        severity="warning",
    )


def in_words(block: Device, deviation: Deviation) -> str:
    """Return a Deviation of an actuator as text, with the source of its value if that is not the diagram."""
    source = block.set_from.get(deviation.parameter, ("",))[0]
    return (
        f"{deviation.parameter} = {quantity(deviation.value, deviation.unit)}{f' ({source})' * bool(source)}, but "
        f"{quantity(deviation.table, deviation.unit)} in {deviation.source}: {deviation.effect}"
    )


def quantity(value: Any, unit: str) -> str:
    """Return a value as text, with its unit if it is a number."""
    if isinstance(value, float):
        return f"{value:.6g}" + f" {unit}" * (unit != "1")
    return str(value)
