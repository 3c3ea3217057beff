"""Gear between motor and joint, and the ranges that a drive's frames encode."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from blocks.actuators.sources import ASSUMED, Sourced, with_ranges
from graph import Param

RANGES = ("position", "velocity", "stiffness", "damping", "torque")


class Gear:
    """Parameter of a gear between motor and joint."""

    gear_ratio = Param(
        1.0, "1", "ratio of a gear behind the actuator: motor angle over joint angle", above=0.0, max=1000.0, fixed=True
    )


class Ranges(Gear):
    """Parameters of the gear, and of encoded ranges that differ from the table of the model."""

    ranges = Param(
        "",
        "1",
        "name of the encoded ranges that this unit has, if the sources of its model disagree",
        dtype=str,
        kernel=False,
    )
    wire_position = Param(
        0.0,
        "rad",
        "half the encoded range of position, if the firmware differs from the table of the model; 0: the table's",
        min=0.0,
        fixed=True,
    )
    wire_velocity = Param(0.0, "rad/s", "half the encoded range of velocity; 0: the table's", min=0.0, fixed=True)
    wire_stiffness = Param(0.0, "N·m/rad", "largest encoded stiffness; 0: the table's", min=0.0, fixed=True)
    wire_damping = Param(0.0, "N·m·s/rad", "largest encoded damping; 0: the table's", min=0.0, fixed=True)
    wire_torque = Param(0.0, "N·m", "half the encoded range of torque; 0: the table's", min=0.0, fixed=True)

    def at_joint(self, spec: Any) -> tuple[float, ...]:
        """Return the five half ranges of a model, converted to the joint, so that kernels do not depend on the gear."""
        spec = with_ranges(spec, self.ranges)
        own = [getattr(self, f"wire_{name}") or getattr(spec, f"wire_{name}") for name in RANGES]
        return tuple(x * scale for x, scale in zip(own, joint_scales(self.gear_ratio)))

    def need_ranges(self, spec: Any) -> None:
        """Raise ValueError for a model with ranges that no source states and this block does not."""
        missing = [
            f"wire_{name}"
            for name in RANGES
            if isinstance(spec, Sourced)
            and spec.source(f"wire_{name}").kind == ASSUMED
            and not getattr(self, f"wire_{name}")
        ]
        if missing:
            raise ValueError(
                f"no source states {', '.join(missing)} of {spec.name}, so the meaning of its codes is unknown: use "
                "servo mode, which needs none of them, or pass those that were measured on this unit"
            )


def joint_scales(gear_ratio: float) -> tuple[float, ...]:
    """Return the factors that convert the five half ranges of a motor to the joint behind a gear."""
    return 1.0 / gear_ratio, 1.0 / gear_ratio, gear_ratio**2, gear_ratio**2, gear_ratio


def unit_of(block: Any) -> Any:
    """Return the model of a block with the encoded ranges of its unit, where they differ from the table."""
    own = {f"wire_{name}": getattr(block, f"wire_{name}") for name in RANGES}
    return replace(with_ranges(block.spec, block.ranges), **{name: value for name, value in own.items() if value})
