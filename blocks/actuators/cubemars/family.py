"""CubeMars AK drives with boards of every generation, as a device family."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from blocks.actuators.cubemars import frames, models, models_v3, queries, set_up
from blocks.actuators.cubemars.emulator import EmulatedCubeMars
from blocks.actuators.cubemars.mit import CubeMars
from blocks.actuators.cubemars.servo import CubeMarsServo
from blocks.actuators.cubemars.v3 import CubeMarsV3
from blocks.actuators.queries import MIT_PURPOSE, commanded_in_mit_mode, disable_in_mit_mode
from blocks.actuators.ranges import unit_of
from blocks.limiters import Saturation
from blocks.sources import TimeTable
from graph.dialogue import Rejected
from graph.family import Benchmark, Drive, Family, Query, StopQuery, Table

if TYPE_CHECKING:
    from blocks.actuators.cubemars.models import Model
    from graph.dialogue import Dialogue
    from graph.family import Answer, Request


def servo_settings(movement: Any, target: Any, speed: Any, rise: Any) -> Any:
    """Return parameters of a CubeMarsServo: the drive's own loop, no faster than needed."""
    if movement == "velocity":
        return {"mode": "velocity", "velocity_limit": max(abs(target), 1e-3)}
    if movement == "position":
        return {"mode": "position_velocity", "velocity_limit": speed, "acceleration": speed / rise}
    return {"mode": "current"}


def wire_servo(joint: Any, movement: Any, target: Any, wave: Any) -> None:
    """Command the drive's own loop. A torque is a current, by the model's constant."""
    if movement == "torque":
        values = [value / joint.scales[2] for value in wave["values"]]
        limit = joint.command_limits()["current_command"].high
        current = TimeTable(times=wave["times"], values=values, unit="A", name="target")()
        joint(current_command=Saturation(lower=-limit, upper=limit)(current))
    elif movement == "velocity":
        joint(velocity_command=TimeTable(**wave, unit="rad/s", name="target")())
    else:
        joint(position_command=target)


class CubeMarsFamily(Family):
    """Device family of CubeMars drives, in MIT mode, servo mode and with firmware 3."""

    name = "CubeMars"
    drives = (
        Drive(CubeMarsV3, models_v3.find),
        Drive(CubeMars, models.find, endings=("mit",)),
        Drive(
            CubeMarsServo,
            models_v3.find_in_servo_mode,
            "servo",
            "a CubeMars in servo mode: a velocity or a position does not bound its torque",
            bounded=("torque",),
            settings=servo_settings,
            wire=wire_servo,
        ),
    )
    tables = (
        Table("CubeMars, boards V1 and V2", "CubeMars in MIT mode, CubeMarsServo in servo mode", models.MODELS),
        Table("CubeMars, boards V3.0", "CubeMarsV3 in force control, CubeMarsServo in servo mode", models_v3.MODELS),
    )
    queries = (
        Query(queries.disable_v3, queries.V3_PURPOSE, queries.all_reports),
        Query(disable_in_mit_mode, MIT_PURPOSE, queries.states),
    )
    vendor_program = set_up.VENDOR_PROGRAM
    configure_note = "On a CubeMars, only the zero can be set; --save stores it if the drive is in servo mode."
    benchmark = Benchmark(CubeMars, EmulatedCubeMars, {"model": "AK80-9"})

    def reports(self, received: Sequence[tuple[int, bool, bytes]]) -> dict[int, Answer]:
        return queries.reports(received)

    def commanded(self, identifier: int, extended: bool, data: bytes) -> int | None:
        found = queries.commanded(identifier, extended, data)
        return commanded_in_mit_mode(identifier, extended, data) if found is None else found

    def stop_queries(self, can_id: int, model: Model | None = None) -> tuple[StopQuery, StopQuery, StopQuery]:
        read = queries.status_of(can_id, model)
        return (
            StopQuery(None, read),
            StopQuery(disable_in_mit_mode(can_id), partial(queries.state, can_id=can_id, model=model)),
            StopQuery(queries.disable_v3(can_id), read),
        )

    def stop_query(self, block: Any) -> StopQuery:
        read = queries.status_of(block.can_id, block.spec)
        if isinstance(block, CubeMarsV3):
            return StopQuery(queries.disable_v3(block.can_id), read)
        if isinstance(block, CubeMarsServo):  # has no other disable, and reports periodically
            return StopQuery(frames.amperes(frames.CURRENT, 0.0, block.can_id), read)
        return self.stop_queries(block.can_id, unit_of(block))[1]

    def check(self, request: Request) -> None:
        refused = request.other_than("--zero", "--save")
        if refused:
            raise Rejected(f"{refused[0]}: {set_up.VENDOR_PROGRAM}")

    def set_up(self, request: Request) -> Dialogue:
        return set_up.set_up(request)


FAMILY = CubeMarsFamily()
