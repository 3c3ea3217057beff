"""Comparison of sensors on both legs with a reference, before torque relies on them."""

from __future__ import annotations

from cext.kernels import gait_placement as kernels
from graph import Block, Input, Memory, Output, Param


class SensorPlacement(Block):
    """Fault of sensors that are exchanged between left and right, upside down or turned by 90°.

    agreement = correlation of (left − right) of the sensors with (left − right) of a reference, in means over 0.6 s: 1
    for a hip drive and the inertial sensors of the thighs, −1 if these are exchanged. The run ends with a fault that
    names the sensors after 0.2 s in which, and while the legs have moved for 0.6 s and `enable` is true,

        exchanged    agreement < −0.1, and neither sensor has a correlation above 0.3 with the reference of its leg
        upside down  correlation of a sensor with that < −0.3
        turned       variance of a sensor below 0.06 of that of the other leg, whose reference moves alike

    A thigh moves with its hip drive in any motion. In walking only, a foot moves with its shank, and a shank is
    `opposite` to its knee drive, as thigh and shank are to the load on the foot: connect `enable` to the `walking` of a
    GaitState. With `one_leg`, leave the inputs of the right leg unconnected, and compare the difference of the rates of
    thigh and shank with the knee drive: it is reversed if these sensors are exchanged, or the shank is upside down.

    Limits: which of sensors and references are exchanged does not show; two sensors that are both upside down count as
    exchanged. Direct feedthrough; NaN and infinity give NaN and are not stored.
    """

    sensors = Param("sensors", "1", 'name of the sensors in the fault, such as "thigh IMUs"', dtype=str)
    reference = Param("reference", "1", 'name of the references, such as "hip drives"', dtype=str)
    opposite = Param(
        False, "1", "true if sensor and reference move in opposite directions", dtype=bool, fixed=True, kernel=False
    )

    one_leg = Param(False, "1", "true to compare the sensors of one leg", dtype=bool, fixed=True, kernel=False)

    left_reference = Input("any", "signal of the left leg that is known to be of the left leg")
    right_reference = Input("any", "the same of the right leg", default=0.0)
    left = Input("any", "signal of the left sensor")
    right = Input("any", "signal of the right sensor", default=0.0)
    enable = Input("1", "false suspends the comparison", dtype=bool, default=True)
    agreement = Output("1", "correlation of sensors and references, left less right")
    sign = Memory(1.0, "sign of the correlation")
    moments = Memory((0.0,) * 16, "moments of sensors and references, times of motion and of disagreement")

    kernel = kernels.placement
    free_units = ("left_reference", "right_reference")

    def configure(self) -> None:
        self.sign = -1.0 if self.opposite else 1.0

    def fault_text(self, status: int) -> str:
        """Return which sensors are misplaced, and what to do."""
        side = ("left", "right")[status % 2 == 0]
        if self.one_leg:
            return (
                f"the {self.sensors} do not move as the {self.reference}: they are exchanged, or one is upside down. "
                "Exchange them, turn it the right way up, or set invert of the drive"
            )
        if status == 64:
            return (
                f"the {self.sensors} of left and right are exchanged, or the {self.reference}: they follow the "
                "other leg. Exchange them, or their serial numbers or IDs in the diagram"
            )
        if status in (65, 66):
            return f"the {side} one of the {self.sensors} moves against the {self.reference}: turn it the right way up"
        return (
            f"the {side} one of the {self.sensors} does not move with the {self.reference}: turn it as in the diagram"
        )


class SegmentOrder(Block):
    """Fault of inertial sensors of one leg that are exchanged between two of its segments.

    In walking, a lower segment turns faster. In means over 1 s, the variance of the rate of a shank is at least 1.38
    times that of the thigh, and that of a foot 1.34 times that of the shank, in three recorded adults and in walkers
    from 0.5 to 1.9 m/s. The run ends with a fault that names the sensors after 0.2 s in which that of the lower segment
    is less than 0.85 times that of the upper one, and `enable` is true: connect the `walking` of a GaitState. With one
    leg, leave the inputs of the right one unconnected. Limits: a knee or ankle that is locked is just within the limit.
    NaN and infinity are not stored.
    """

    upper = Param("thigh IMU", "1", "name of the sensors on the upper segments in the fault", dtype=str)
    lower = Param("shank IMU", "1", "name of the sensors on the lower segments in the fault", dtype=str)

    left_upper = Input("rad/s", "rate of the upper segment of the left leg")
    right_upper = Input("rad/s", "the same of the right leg", default=0.0)
    left_lower = Input("rad/s", "rate of the lower segment of the left leg")
    right_lower = Input("rad/s", "the same of the right leg", default=0.0)
    enable = Input("1", "false suspends the comparison", dtype=bool, default=True)
    moments = Memory((0.0,) * 9, "means and mean squares of the rates, time of the wrong order")

    kernel = kernels.segment_order

    def fault_text(self, status: int) -> str:
        """Return which sensors are misplaced, and what to do."""
        side = ("left", "right")[status - 64]
        return (
            f"the {self.upper} of the {side} leg turns faster than its {self.lower}: they are exchanged, or one is "
            "turned or on the other leg. Exchange them, or their serial numbers in the diagram"
        )
