"""Common parts of actuators with their own driver board, in every mode of the drive."""

from __future__ import annotations

from numbers import Real
from typing import Any

from blocks.actuators.pose import Pose
from blocks.actuators.ranges import Gear
from blocks.actuators.sources import Sourced
from blocks.actuators.watch import Watched
from graph import Interval, Output, Param, Winding
from graph.reach import Reach


class Drive(Watched, Pose, Gear):
    """Model, address, torque limit and feedback of an actuator.

    A family defines `find`, which returns a model by its name, and the native encode and decode.
    """

    positional: tuple[str, ...] | None = ("model", "bus", "can_id", "limit")
    hardware: tuple[str, ...] = ("can_id", "invert", "offset", "range", "wake_shift", "known_pose", "reference")

    model = Param("", "1", "model in the vendor's spelling", required=True, dtype=str)
    bus = Param("can", "1", "logical name of its CAN bus", dtype=str)
    can_id = Param(1, "1", "CAN id set in the drive", min=1, max=255, fixed=True)
    limit = Param(
        "rated",
        "N·m",
        "largest torque command at the joint: rated, peak, or a number up to the peak torque",
        dtype=object,
    )
    stop_time = Param(
        1.0, "s", "duration of the damping in the safe stop", above=0.0, max=5.0, fixed=True, kernel=False
    )

    position = Output("rad", "joint angle θ")
    velocity = Output("rad/s", "joint velocity ω")
    torque = Output("N·m", "torque of the drive, from its current")
    temperature = Output("°C", "temperature of the drive")
    fault = Output("1", "error code of the drive, 0 for none", dtype=int)
    age = Output("s", "time since the command that the newest reply answers")
    rms_torque = Output("N·m", "root mean square of the torque over `rms_window`", kernel=False)

    find: Any  # function of a name that returns a model
    parameters: dict[str, Param[Any]]
    caps: Any  # of graph.Actuator

    def find_limit(self) -> float:
        """Return the torque limit, N·m at the joint: rated, peak or a number, within the encoded range."""
        spec, ratio = self.spec, self.gear_ratio
        if spec.rated is None:
            return self.given_limit()
        named = {"rated": spec.rated * ratio, "peak": spec.peak * ratio}
        if isinstance(self.limit, str):
            if self.limit not in named:
                raise ValueError(f"limit must be 'rated', 'peak' or a torque in N·m, got {self.limit!r}")
            return min(named[self.limit], self.wire[4])
        if isinstance(self.limit, bool) or not isinstance(self.limit, Real):
            raise ValueError(f"limit must be 'rated', 'peak' or a torque in N·m, got {self.limit!r}")
        limit = float(self.limit)
        if not 0.0 < limit <= named["peak"]:
            behind = "" if ratio == 1.0 else f" behind a gear of {ratio:g}"
            raise ValueError(
                f"limit must be above 0 and at most the peak torque of {spec.name}{behind}, {named['peak']:g} N·m, "
                f"got {limit:g} N·m"
            )
        return min(limit, self.wire[4])

    @property
    def capped_limit(self) -> float:
        """Torque limit within the caps of the diagram, N·m at the joint."""
        return self.torque_limit if self.caps is None else min(self.torque_limit, self.caps.torque)

    def given_limit(self) -> float:
        """Return the limit of a model without published ratings: a number within the drive's range."""
        limit = self.limit
        if isinstance(limit, (str, bool)) or not isinstance(limit, Real):
            raise ValueError(
                f"rated and peak torque of {self.spec.name} are not published: pass limit= in N·m, got {self.limit!r}"
            )
        if not 0.0 < float(limit) <= self.wire[4]:
            raise ValueError(
                f"limit must be above 0 and within the range of {self.spec.name}, {self.wire[4]:g} "
                f"N·m, got {self.limit:g}"
            )
        return float(limit)

    def reach(self) -> dict[str, Reach]:
        """Return the range of setpoints as graph.reach.Reach: of the drive, and of the joint if `range` is set."""
        position, name = self.wire[0] + abs(self.offset), self.spec.name
        peak = self.wire[4] if self.spec.peak is None else min(self.spec.peak * self.gear_ratio, self.wire[4])
        return {
            "position": Reach(
                Interval(-position, position), f"command range of {name}", Interval(*self.range) if self.range else None
            ),
            "velocity": Reach(Interval(-self.wire[1], self.wire[1]), f"command range of {name}"),
            "torque": Reach(Interval(-peak, peak), f"peak torque of {name}"),
        }

    limit_columns: tuple[str, ...] = ("rated", "peak")  # of the model, on which the torque limit rests

    def assumptions(self) -> list[tuple[str, str]]:
        """Return (number, reason) of each assumed number on which the torque limit rests, unless a parameter has it."""
        own = self.parameters
        columns = [name for name in self.limit_columns if not (name in own and getattr(self, name))]
        return list(self.spec.assumed(*columns).items()) if isinstance(self.spec, Sourced) else []

    def winding(self) -> Winding:
        """Return the currents of the motor at the torque limit."""
        return winding_of(self.spec, self.gear_ratio, self.torque_limit)


def winding_of(spec: Any, gear_ratio: float, limit: float | None) -> Winding:
    """Return the Winding of a model.

    gear_ratio : ratio of the external gear; limit : N·m at the joint, None if the command does not bound the torque

    The current per torque is the largest of the published ratios, at the rated and at the peak torque: the torque of a
    motor that saturates rises less than its current.
    """
    points = ((spec.rated, spec.rated_current), (spec.peak, spec.peak_current))
    ratios = [current / torque for torque, current in points if torque and current]
    if not ratios and spec.torque_constant:
        ratios = [1.0 / spec.torque_constant]
    current = spec.peak_current
    if limit is not None:
        current = max(ratios) * limit / gear_ratio if ratios else None
    rated = None if spec.rated is None else spec.rated * gear_ratio
    supply, note = getattr(spec, "supply", ()), getattr(spec, "supply_note", "")
    return Winding(limit, current, rated, spec.rated_current, spec.peak_current, supply, note)
