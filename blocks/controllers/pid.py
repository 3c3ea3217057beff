"""P, PI, PD and PID controllers, in parallel form. (Åström and Hägglund, Advanced PID Control, 2006, chapter 3)

The derivative is filtered, of the measurement alone by default, so that a step in the reference gives no kick;
set-point weights b and c say how much of the reference the proportional and the derivative part see. `unit` is that of
the command; gains have units to match.
"""

import math

from cext.kernels import pid as kernels
from graph import Block, Input, Interval, Memory, Output, Param
from graph.interval import EVERYTHING
from graph.units import ANY, canonical


class _Controller(Block):
    def configure(self):
        self.unit = canonical(self.unit)
        if self.unit != ANY:
            self.outputs = {"command": Output(self.unit, "what is asked of the drive", shape=...).named("command")}
            if "manual_command" in self.inputs:
                by_hand = Input(self.unit, "command while `manual` is true", shape=..., default=0.0).named(
                    "manual_command"
                )
                self.inputs = self.inputs | {"manual_command": by_hand}


class P(_Controller):
    """Proportional control: u = kp (r - y). Direct feedthrough; NaN passes."""

    kp = Param(1.0, "any", "proportional gain")
    unit = Param("any", "1", "unit of the command; that of the reference if left out")

    reference = Input("any", "set point r", shape=...)
    measurement = Input("any", "process value y", shape=...)
    command = Output("any", "what is asked of the drive", shape=...)

    kernel = kernels.p

    def output_range(self, reference, measurement):
        return self.span("kp") * (reference - measurement)


class PD(_Controller):
    """Proportional and derivative control: u = kp (b r - y) + kd d(c r - y)/dt, the derivative filtered by 1 /
    (filter_time s + 1).

    Backward differences. Direct feedthrough. The derivative starts at 0, so nothing kicks. NaN passes, infinity becomes
    NaN, neither is held.
    """

    kp = Param(1.0, "any", "proportional gain")
    kd = Param(0.0, "any", "derivative gain")
    filter_time = Param(0.0, "s", "time constant of the derivative's filter", min=0.0)
    b = Param(1.0, "1", "set-point weight of the proportional part", min=0.0)
    c = Param(0.0, "1", "set-point weight of the derivative part", min=0.0)
    unit = Param("any", "1", "unit of the command; that of the reference if left out")

    reference = Input("any", "set point r", shape=...)
    measurement = Input("any", "process value y", shape=...)
    command = Output("any", "what is asked of the drive", shape=...)
    follower = Memory(math.nan, "what the derivative's filter has reached")

    kernel = kernels.pd

    def prepare(self, dt):
        self.follower = [math.nan] * self.width

    def output_range(self, reference, measurement):
        w = self.span("c") * reference - measurement
        if self.dt is None or not w.bounded:
            return EVERYTHING
        # The filter stays among its inputs, so a slope is at most their spread over filter_time + dt; and what rounding
        # adds.
        slope = (w.high - w.low) / (self.span("filter_time").low + self.dt) + 1e-14 * max(-w.low, w.high) / self.dt
        return self.span("kp") * (self.span("b") * reference - measurement) + self.span("kd") * Interval(-slope, slope)


class _Integrating(_Controller):
    def configure(self):
        super().configure()
        if self.lower > self.upper:
            raise ValueError(f"lower, {self.lower:g}, is above upper, {self.upper:g}")
        self.clamps = float(self.anti_windup == "clamping")

    def output_range(self, **inputs):
        return self.span("lower") | self.span("upper")


class PI(_Integrating):
    """Proportional and integral control inside limits: u = clip(kp (b r - y) + I), I += dt ki (r - y).

    Against windup, at a limit: "clamping" lets the integral wait unless it leads away from the limit;
    "back-calculation" leads it back by dt / tracking_time of what was clipped. While `manual` is true the command is
    `manual_command`, clipped, and the integral follows it: the way back has no bump. Direct feedthrough. I starts at 0.
    NaN passes, infinity becomes NaN, neither is held.
    """

    kp = Param(1.0, "any", "proportional gain")
    ki = Param(0.0, "any", "integral gain: kp / Ti")
    b = Param(1.0, "1", "set-point weight of the proportional part", min=0.0)
    lower = Param(-math.inf, "any", "smallest command")
    upper = Param(math.inf, "any", "largest command")
    anti_windup = Param("clamping", "1", "what the integral does at a limit", choices=("clamping", "back-calculation"))
    tracking_time = Param(None, "s", "of the back-calculation; Ti = kp / ki if left out", above=0.0)
    unit = Param("any", "1", "unit of the command; that of the reference if left out")

    reference = Input("any", "set point r", shape=...)
    measurement = Input("any", "process value y", shape=...)
    manual = Input("1", "whether the command is given by hand", dtype=bool, default=False)
    manual_command = Input("any", "command while `manual` is true", shape=..., default=0.0)
    command = Output("any", "what is asked of the drive", shape=...)
    clamps = Memory(1.0, "whether it clamps")
    integral = Memory(0.0, "I")

    kernel = kernels.pi

    def prepare(self, dt):
        self.integral = [0.0] * self.width


class PID(_Integrating):
    """Control inside limits: u = clip(kp (b r - y) + I + kd d(c r - y)/dt), I += dt ki (r - y), the derivative
    filtered.

    Backward differences. Against windup, at a limit: "clamping" lets the integral wait unless it leads away from the
    limit; "back-calculation" leads it back by dt / tracking_time of what was clipped. While `manual` is true the
    command is `manual_command`, clipped, and the integral follows it: the way back has no bump. Direct feedthrough. I
    and the derivative start at 0. NaN passes, infinity becomes NaN, neither is held.
    """

    kp = Param(1.0, "any", "proportional gain")
    ki = Param(0.0, "any", "integral gain: kp / Ti")
    kd = Param(0.0, "any", "derivative gain: kp Td")
    filter_time = Param(0.0, "s", "time constant of the derivative's filter: Td / N", min=0.0)
    b = Param(1.0, "1", "set-point weight of the proportional part", min=0.0)
    c = Param(0.0, "1", "set-point weight of the derivative part", min=0.0)
    lower = Param(-math.inf, "any", "smallest command")
    upper = Param(math.inf, "any", "largest command")
    anti_windup = Param("clamping", "1", "what the integral does at a limit", choices=("clamping", "back-calculation"))
    tracking_time = Param(None, "s", "of the back-calculation; √(Ti Td) if left out, or Ti without kd", above=0.0)
    unit = Param("any", "1", "unit of the command; that of the reference if left out")

    reference = Input("any", "set point r", shape=...)
    measurement = Input("any", "process value y", shape=...)
    manual = Input("1", "whether the command is given by hand", dtype=bool, default=False)
    manual_command = Input("any", "command while `manual` is true", shape=..., default=0.0)
    command = Output("any", "what is asked of the drive", shape=...)
    clamps = Memory(1.0, "whether it clamps")
    integral = Memory(0.0, "I")
    follower = Memory(math.nan, "what the derivative's filter has reached")

    kernel = kernels.pid

    def prepare(self, dt):
        self.integral, self.follower = [0.0] * self.width, [math.nan] * self.width
