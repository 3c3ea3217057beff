"""P, PI, PD and PID controllers, in parallel form. (Åström and Hägglund, Advanced PID Control, 2006, chapter 3)

The derivative is filtered. By default it acts on the measurement alone, which avoids a derivative kick at a step of the
reference. The set-point weights b and c scale the reference in the proportional and the derivative part. `unit` is the
unit of the command; the gains have matching units.
"""

from __future__ import annotations

import math

from cext.kernels import pid as kernels
from graph import Block, Input, Interval, Memory, Output, Param
from graph.interval import EVERYTHING
from graph.units import ANY, canonical


class _Controller(Block):
    kp = Param(1.0, "any", "proportional gain")

    reference = Input("any", "set point r", shape=...)
    measurement = Input("any", "process value y", shape=...)
    command = Output("any", "control signal u", shape=...)

    abstract = True

    def configure(self):
        self.unit = canonical(self.unit)
        if self.unit != ANY:
            self.outputs = {"command": self.outputs["command"].with_unit(self.unit)}


class P(_Controller):
    """Proportional control: u = kp (r - y).

    Direct feedthrough. NaN passes.
    """

    unit = Param("any", "1", "unit of the command; the unit of the reference by default")

    kernel = kernels.p

    def output_range(self, reference: Interval, measurement: Interval) -> Interval:
        return self.span("kp") * (reference - measurement)


class PD(_Controller):
    """Proportional and derivative control: u = kp (b r - y) + kd d(c r - y)/dt.

    A filter 1 / (filter_time s + 1) smooths the derivative. Backward differences. Direct feedthrough. The derivative
    starts at 0, without an initial transient. NaN passes, infinity becomes NaN; neither is stored.
    """

    kd = Param(0.0, "any", "derivative gain")
    filter_time = Param(0.0, "s", "time constant of the derivative filter", min=0.0)
    b = Param(1.0, "1", "set-point weight of the proportional part", min=0.0)
    c = Param(0.0, "1", "set-point weight of the derivative part", min=0.0)
    unit = Param("any", "1", "unit of the command; the unit of the reference by default")

    follower = Memory(math.nan, "state of the derivative filter")

    kernel = kernels.pd

    def prepare(self, dt: float) -> None:
        self.follower = [math.nan] * self.width

    def output_range(self, reference: Interval, measurement: Interval) -> Interval:
        w = self.span("c") * reference - measurement
        if self.dt is None or not w.bounded:
            return EVERYTHING
        # The filter stays within the range of its inputs, so the slope is at most that range over filter_time + dt,
        # plus rounding.
        slope = (w.high - w.low) / (self.span("filter_time").low + self.dt) + 1e-14 * max(-w.low, w.high) / self.dt
        return self.span("kp") * (self.span("b") * reference - measurement) + self.span("kd") * Interval(-slope, slope)


class PID(_Controller):
    """PID control with limits: u = clip(kp (b r - y) + I + kd d(c r - y)/dt), I += dt ki (r - y).

    A filter smooths the derivative. Backward differences. Anti-windup at a limit: "clamping" stops the integral unless
    it moves away from the limit; "back-calculation" reduces it by dt / tracking_time times the clipped part. With
    `applied`, such as the output of a limiter behind the controller, I += dt / tracking_time (applied - u) besides.
    While `manual` is true the command is `manual_command`, clipped, and the integral follows it, for a bumpless
    transfer. Direct feedthrough, but of `applied`. I and the derivative start at 0. NaN passes, infinity becomes NaN;
    neither is stored.
    """

    rules = ("lower <= upper",)
    held_within = {"command": ("lower", "upper")}

    ki = Param(0.0, "any", "integral gain: kp / Ti")
    kd = Param(0.0, "any", "derivative gain: kp Td")
    filter_time = Param(0.0, "s", "time constant of the derivative filter: Td / N", min=0.0)
    b = Param(1.0, "1", "set-point weight of the proportional part", min=0.0)
    c = Param(0.0, "1", "set-point weight of the derivative part", min=0.0)
    lower = Param(-math.inf, "any", "smallest command")
    upper = Param(math.inf, "any", "largest command")
    anti_windup = Param("clamping", "1", "method against windup at a limit", choices=("clamping", "back-calculation"))
    tracking_time = Param(
        None, "s", "time constant of the back-calculation; default √(Ti Td), or Ti without kd", above=0.0
    )
    unit = Param("any", "1", "unit of the command; the unit of the reference by default")

    manual = Input("1", "whether `manual_command` replaces the control law", dtype=bool, default=False)
    manual_command = Input("any", "command while `manual` is true", shape=..., default=0.0)
    applied = Input("any", "command as it is applied behind the controller; NaN: unknown", shape=..., default=math.nan)
    clamps = Memory(1.0, "1: clamping; 0: back-calculation")
    integral = Memory(0.0, "integral part I")
    follower = Memory(math.nan, "state of the derivative filter")
    spoiled = Memory(0.0, "`applied` of the previous tick if it was infinite")

    feedthrough = ("reference", "measurement", "manual", "manual_command")
    kernel = kernels.pid
    update_kernel = kernels.tracking

    def configure(self) -> None:
        super().configure()
        if self.unit != ANY:
            self.inputs = self.inputs | {
                "manual_command": self.inputs["manual_command"].with_unit(self.unit),
                "applied": self.inputs["applied"].with_unit(self.unit),
            }
        self.clamps = float(self.anti_windup == "clamping")
        self.winds_up = {"command": "applied"} if self.ki else {}
        self.smooth = ("reference", "measurement") if self.kd else ()

    def prepare(self, dt: float) -> None:
        self.integral, self.follower = [0.0] * self.width, [math.nan] * self.width
        self.spoiled = [0.0] * self.width

    def output_range(self, **inputs: Interval) -> Interval:
        return self.span("lower") | self.span("upper")


class PI(PID):
    """PI control with limits: u = clip(kp (b r - y) + I), I += dt ki (r - y). A PID without a derivative.

    Anti-windup at a limit: "clamping" stops the integral unless it moves away from the limit; "back-calculation"
    reduces it by dt / tracking_time times the clipped part. With `applied`, such as the output of a limiter behind the
    controller, I += dt / tracking_time (applied - u) besides. While `manual` is true the command is `manual_command`,
    clipped, and the integral follows it, for a bumpless transfer. Direct feedthrough, but of `applied`. I starts at 0.
    NaN passes, infinity becomes NaN; neither is stored.
    """

    filter_time = c = follower = None
    kd = Memory(0.0, "no derivative")
    tracking_time = Param(None, "s", "time constant of the back-calculation; default Ti = kp / ki", above=0.0)

    kernel = kernels.pi

    def prepare(self, dt: float) -> None:
        self.integral, self.spoiled = [0.0] * self.width, [0.0] * self.width
