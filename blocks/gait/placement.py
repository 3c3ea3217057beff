"""Sensors on the legs that are exchanged, turned or have slipped, before torque relies on them."""

from __future__ import annotations

import math

from cext.kernels import gait_placement as kernels
from graph import Block, Input, Memory, Output, Param


class SensorPlacement(Block):
    """Fault of sensors that are exchanged between left and right, upside down or turned by 90°.

    agreement = correlation of (left − right) of the sensors with (left − right) of a reference, in means over 0.6 s: 1
    for a hip drive and the inertial sensors of the thighs, −1 if these are exchanged. The run ends with a fault that
    names the sensors after 0.2 s (exchanged) or 0.4 s in which, and while the legs have moved for 0.6 s and `enable` is
    true,

        exchanged    agreement < `least`, and neither sensor has a correlation above 0.3 with the reference of its leg
        upside down  correlation of a sensor with that < −0.3
        turned       variance of a sensor below 0.06 of that of the other leg, whose reference moves alike

    A thigh moves with its hip drive in any motion. In walking only, a foot moves with its shank, and a shank is
    `opposite` to its knee drive, as thigh and shank are to the load on the foot: connect `enable` to the `walking` of a
    GaitState. With `one_leg`, leave the inputs of the right leg unconnected, and compare the difference of the rates of
    thigh and shank with the knee drive, which are the same: let `least` be 0.8.

    Exchanged ids of drives stay so. With an `averaging` of a few seconds, only exchanged sensors are a fault, if the
    mean agreement since the first comparison, or over this time, is below `least`: a turn in a walk is none.

    After 0.5 s of comparison, samples count only while `enable` is true, and are compared 1 s after it has become true:
    a stand and the step that ends it do not count. With strides of 1.1 to 3 s, these times grow in proportion.

    Limits: which of sensors and references are exchanged does not show; two sensors that are both upside down count as
    exchanged. Direct feedthrough; NaN and infinity give NaN and are not stored.
    """

    sensors = Param("sensors", "1", 'name of the sensors in the fault, such as "thigh IMUs"', dtype=str)
    reference = Param("reference", "1", 'name of the references, such as "hip drives"', dtype=str)
    opposite = Param(
        False, "1", "true if sensor and reference move in opposite directions", dtype=bool, fixed=True, kernel=False
    )
    one_leg = Param(False, "1", "true to compare the sensors of one leg", dtype=bool, fixed=True, kernel=False)
    least = Param(-0.1, "1", "agreement below which sensors are exchanged", min=-1.0, max=1.0, fixed=True)
    averaging = Param(
        0.0, "s", "time of comparison over which the agreement is averaged", min=0.0, max=60.0, fixed=True
    )

    left_reference = Input("any", "signal of the left leg that is known to be of the left leg")
    right_reference = Input("any", "the same of the right leg", default=0.0)
    left = Input("any", "signal of the left sensor")
    right = Input("any", "signal of the right sensor", default=0.0)
    enable = Input("1", "false suspends the comparison", dtype=bool, default=True)
    agreement = Output("1", "correlation of sensors and references, left less right")
    sign = Memory(1.0, "sign of the correlation")
    moments = Memory((0.0,) * 23, "moments of sensors and references, times of motion and of disagreement")

    kernel = kernels.placement
    free_units = ("left_reference", "right_reference")

    def configure(self) -> None:
        self.sign = -1.0 if self.opposite else 1.0

    def fault_text(self, status: int) -> str:
        """Return which sensors are misplaced, and what to do."""
        side = ("left", "right")[status % 2 == 0]
        if self.one_leg:
            return (
                f"the {self.sensors} do not move as the {self.reference}: they are exchanged, or one is turned. "
                "Exchange them, mount it as in the diagram, or set invert of the drive"
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
    is less than `least` times that of the upper one, and `enable` is true: connect the `walking` of a GaitState. After
    0.5 s of comparison, samples count only while it is true, and are compared 1 s after it has become true. Samples in
    which no segment turns faster than 0.3 rad/s do not count: the step that ends a stand turns one thigh alone. With
    one leg, leave the inputs of the right one unconnected. They are compared from 1.25 s of motion on. A leg of which
    neither variance is a quarter of the larger one of the other leg has not swung, as in a turn, and is not compared.
    The shank below a stiff knee, with 0.3 to 0.6 of its range, turns more slowly than its thigh: the ratio is then at
    least 0.56. If the sensors are exchanged, it varies from 0.2 to 0.7 within a stride. NaN and infinity are not
    stored.
    """

    upper = Param("thigh IMU", "1", "name of the sensors on the upper segments in the fault", dtype=str)
    lower = Param("shank IMU", "1", "name of the sensors on the lower segments in the fault", dtype=str)
    least = Param(0.85, "1", "smallest variance of the lower rate over that of the upper one", above=0.0, max=1.0)

    left_upper = Input("rad/s", "rate of the upper segment of the left leg")
    right_upper = Input("rad/s", "the same of the right leg", default=0.0)
    left_lower = Input("rad/s", "rate of the lower segment of the left leg")
    right_lower = Input("rad/s", "the same of the right leg", default=0.0)
    enable = Input("1", "false suspends the comparison", dtype=bool, default=True)
    moments = Memory((0.0,) * 12, "means and mean squares of the rates, time of the wrong order")

    kernel = kernels.segment_order

    def fault_text(self, status: int) -> str:
        """Return which sensors are misplaced, and what to do."""
        side = ("left", "right")[status - 64]
        return (
            f"the {self.upper} of the {side} leg turns faster than its {self.lower}: they are exchanged, or one is "
            "turned or on the other leg. Exchange them, or their serial numbers in the diagram"
        )


class SegmentPosture(Block):
    """Fault of an inertial sensor that is turned about the axis of flexion, or has slipped.

    In walking, the mean pitches of a segment of both legs differ by a few degrees, and by more in a turn and a stop.
    The run ends with a fault that names the sensor after 1 s in which, while `enable` is true (connect the `walking` of
    a GaitState),

        turned       left and right differ by more than `difference`
        both turned  a pitch is outside `lowest` to `highest`
        slipped      the difference has changed by more than `slip` from its mean over the last 30 s of walking, of at
                     least 5 s

    or after 0.2 s if the posture of the last 30 s of walking is that of a turned sensor as well. Means have two stages
    of 0.6 s each. After 0.5 s of comparison, a pause of 0.3 s starts them again, and they are compared after 3 s and
    2.3 strides. A stride is the time between two instants at which a pitch rises above its mean; with strides of 1.1 to
    3 s, the time constants grow in proportion. From 1 s on, samples in which no pitch changes by more than 0.3 rad/s do
    not count, as in a stand. With one sensor, compare it with a `reference`: the flexion from two sensors with a drive,
    or the pitch of the pelvis with 0. Limits: stairs that are climbed with one leg first, and a gait that is more
    asymmetric than `difference`, are faults. NaN and infinity are not stored.
    """

    rules = ("lowest < highest",)

    sensors = Param("thigh IMU", "1", "name of the sensor of each leg in the fault", dtype=str)
    reference = Param("", "1", "name of the reference instead of the other leg", dtype=str)
    lowest = Param(-math.pi, "rad", "lowest mean pitch in walking")
    highest = Param(math.pi, "rad", "highest mean pitch in walking")
    difference = Param(0.26, "rad", "largest difference of left and right", above=0.0)
    slip = Param(0.18, "rad", "largest change of the difference", above=0.0)

    left = Input("rad", "pitch of the segment of the left leg, or angle of the sensor")
    right = Input("rad", "the same of the right leg, or of the reference", default=0.0)
    enable = Input("1", "false suspends the comparison", dtype=bool, default=True)
    means = Memory((0.0,) * 19, "means of the pitches, times, strides, and the pitches one tick before")

    kernel = kernels.segment_posture

    def fault_text(self, status: int) -> str:
        """Return which sensor is turned, and what to do."""
        case, right = divmod(status - 64, 2)
        sensor = self.sensors if self.reference else f"{self.sensors} of the {('left', 'right')[right]} leg"
        other = self.reference or "that of the other leg"
        low, high, difference, slip = (
            f"{math.degrees(value):.0f}°" for value in (self.lowest, self.highest, self.difference, self.slip)
        )
        return (
            f"the {sensor} has a mean pitch outside {low} to {high} in walking: it is turned about the axis of flexion",
            f"the {sensor} differs from {other} by more than {difference} in the mean: it is turned about the axis of "
            "flexion, or its zero is wrong",
            f"the {sensor} has slipped by more than {slip} against {other} in walking",
        )[case] + ". Mount it as in the diagram"
