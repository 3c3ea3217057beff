"""Detectors of heel strike: from ground contact, and from the motion of shank, thigh or knee."""

from __future__ import annotations

import math

from cext.kernels import gait_events as kernels
from graph import Block, Input, Memory, Output, Param


class _Events:
    shortest = Param(0.5, "s", "shortest stride; an event earlier after a strike is ignored", above=0.0)

    strike = Output("1", "true for one tick at each heel strike", dtype=bool)
    strides = Output("1", "number of heel strikes since the start", dtype=int)
    elapsed = Output("s", "time since the last heel strike")
    timing = Memory((math.inf, 1.1, math.inf, 0.0), "time since the strike, last stride, time to the strike, strikes")


class ContactEvents(_Events, Block):
    """Heel strike from the load under a foot: load = (force − zero) / (peak − zero) rises through `rising`.

    Zero and peak are the extremes of a 9-sample median over the last 1.5 to 3 s of steps, so drift, the scale of the
    sensor and lost samples, which read 0, have no effect. The force may have any scale; `smallest` is in its unit.

    Contact begins when the load rises through `rising`, or at the second sample if the load jumps by more than half of
    its range in the first 80 % of a stride. It ends 0.05 s after the load has fallen below `falling`. Contact is a heel
    strike if it follows 0.1 s and 0.6 of the longest recent time without contact, and the previous contact carried a
    load of at least 0.4: the feet of a seated wearer can touch the ground without a strike. Contact after a shorter
    time, or earlier than `shortest` after a strike, continues the previous one: a heel can press again before it leaves
    the ground.

    Limits: the first stride after the start sets the scale. After a jump of the zero by more than the threshold, events
    are detected again within 3 s. Shifting the weight from foot to foot and stepping in place or backwards make the
    same contacts as walking. Direct feedthrough; NaN and infinity pass and are not stored. (thresholds relative to the
    recent range: Catalfamo et al. 2008; median against lost samples: Tukey 1977)
    """

    rules = ("falling <= rising",)

    rising = Param(0.1, "1", "load at which contact begins", above=0.0, below=1.0)
    falling = Param(0.06, "1", "load below which contact ends", above=0.0, below=1.0)
    smallest = Param(20.0, "any", "smallest range of the force while walking, in its unit", above=0.0)

    force = Input("any", "vertical force, or pressure, under the foot")
    contact = Output("1", "true while the foot carries load", dtype=bool)
    load = Output("1", "force relative to zero and peak")
    recent = Memory((0.0,) * 9, "last samples")
    window = Memory(
        (math.inf, -math.inf, 0.0, math.inf, -math.inf, math.inf, -math.inf, 0.0, 0.0), "zero, peak, windows"
    )
    state = Memory((0.0, 0.0, 0.0, math.inf, 0.0, 0.0), "contact, times without load, and last loads")

    kernel = kernels.contact_events


class GyroEvents(_Events, Block):
    """Heel strike from the angular rate of a shank: the end of its forward swing.

    After a mid-swing peak above half the typical one, the rate falls through zero; the strike follows after the
    fraction `lead` of the last stride. The typical peak adapts to the wearer and decays with a time constant of 5 s. A
    swing is rejected while the mean of the cube of the rate, with the same time constant, is negative, as with a signal
    of opposite sign: the skewness of the rate is 0.3 to 1.4 in walking at 0.2 to 1.95 m/s. The rate is a median of
    three samples.

    Limits: level walking only. A bias of the gyroscope shifts the zero crossing. A leg that swings freely while the
    wearer is seated gives the same signal. Direct feedthrough; NaN and infinity pass and are not stored. (Aminian et
    al. 2002; Jasiewicz et al. 2006)
    """

    lead = Param(0.028, "1", "time from the zero crossing to the strike, as a fraction of a stride", min=0.0, max=0.2)
    smallest = Param(1.0, "rad/s", "smallest mid-swing peak", above=0.0)

    velocity = Input("rad/s", "sagittal angular rate of the shank, positive when it swings forward")
    peak = Memory((0.0, 0.0, 0.0), "typical peak, peak of this swing, and mean cube of the rate")
    latest = Memory((math.nan,) * 2, "last two samples")

    kernel = kernels.gyro_events


class ThighEvents(_Events, Block):
    """Heel strike from the angle of a thigh: `lead` of a stride after it rises through 70 % of its range in swing.

    The range adapts to the wearer, and shrinks after 2 s without an event; an event needs an angle below 30 % before.
    In the mean curves of adults from 0.85 to 1.96 m/s that level is passed at 72.4 to 73.7 % of the stride (Bovi et al.
    2011; 73.3 % in Pinzone et al. 2014), where the maximum of the angle is anywhere from 86 to 101 %. The angle is a
    median of three samples. Limits: level walking; a change of speed within the lead shifts the strike by as much; hip
    flexion of other activities has the same rise; with a signal of opposite sign strikes are half a stride late. Direct
    feedthrough; NaN and infinity pass and are not stored.
    """

    lead = Param(0.272, "1", "time from the level to the strike, as a fraction of a stride", min=0.0, max=0.5)
    smallest = Param(0.15, "rad", "smallest range", above=0.0)

    angle = Input("rad", "flexion of the thigh from vertical, or of the hip")
    extremes = Memory((math.inf, -math.inf, math.inf, -math.inf, 0.0, 0.0), "range in use, new range, armed, time")
    latest = Memory((math.nan,) * 2, "last two samples")

    kernel = kernels.thigh_events


class KneeEvents(_Events, Block):
    """Heel strike from the angle of a knee: a learned part of a stride after its extension in late swing slows down.

    The flexion in swing is a maximum after a rise by 70 % of the typical height, which adapts to the wearer, even to a
    stiff knee with 0.6 of the range or less. The event is where the angle has fallen by 60 % of that rise and the
    velocity to half of its peak: 4.4 to 8.3 % of a stride before heel strike in recorded adults at 0.6 to 1.9 m/s. The
    extension must reach a rate of 3.5 times its range per stride: that rate is 5 to 10 in walking, and 3.1 for a
    pendulum and in squats. Angle and velocity are medians of three samples.

    At heel strike the deceleration of the extension has ended: within 12 ms in both legs of three recorded adults. The
    time from the event to that end, 3 to 8.5 % of a stride, is learned from the mean velocity of the last ten strides.
    It replaces `lead` from the third on.

    Limits: a knee that flexes in stance by more than 0.6 of its flexion in swing is not followed. On stairs up, strikes
    are late by a third of a stride; with a signal of opposite sign, they are a quarter of a stride early, or missing.
    Direct feedthrough; NaN and infinity pass and are not stored. (terminal swing: Winter 1991)
    """

    lead = Param(0.06, "1", "time from the event to the strike until it is learned, in strides", min=0.0, max=0.2)
    smallest = Param(0.2, "rad", "smallest height of a swing", above=0.0)

    angle = Input("rad", "knee flexion")
    velocity = Input("rad/s", "knee flexion velocity")
    turns = Memory((1.0, math.nan, 0.0, 0.0, 0.0, 0.0), "direction, extreme, its age, typical and last height")
    extension = Memory((0.0, 0.0, 0.0, 0.0, math.inf), "extension after swing, and time between swings")
    latest = Memory((math.nan,) * 4, "last two angles and velocities")
    landing = Memory((0.0, 0.0, 22.0) + (0.0,) * 25, "mean velocity after the event, and the time to the strike")

    kernel = kernels.knee_events
