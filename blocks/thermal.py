"""Thermal model of a motor, for derating and for drives that report no temperature."""

from __future__ import annotations

import math
from typing import Any

from blocks.families import find_model
from cext.kernels import thermal as kernels
from graph import Block, Input, Interval, Memory, Output, Param
from graph.interval import EVERYTHING

COPPER = 0.00393  # 1/K, temperature coefficient of the resistance of copper at 25 °C
RISE = 75.0  # K above ambient, assumed winding temperature in steady state at the rated torque


class ThermalModel(Block):
    """Two-node thermal model of winding and case.

        C_w dT_w/dt = P - (T_w - T_c) / R_wc
        C_c dT_c/dt = (T_w - T_c) / R_wc - (T_c - T_a) / R_ca

    P = loss · τ² · (1 + 0.00393 (T_w - 25 °C)) is the copper loss. Backward Euler, stable for any period; dt is the
    actual time since the previous tick. No direct feedthrough of the torque. Both nodes start at `start`, or at the
    ambient temperature. NaN passes and is not held.

    `loss` is optional: by default it follows from `rated`, the continuous torque, which is assumed to heat the winding
    to 75 K above ambient; and `rated` follows from `actuator`. The default resistances and capacities were measured on
    an outrunner of this size without a fan (J. Schuchmann's test of the Dephy ActPack, in Open-Source Leg's thermal
    model). Measure your motor before you use its full thermal limit.
    """

    models_heat = True

    actuator = Param("", "1", "actuator model that determines the rated torque")
    rated = Param(None, "N·m", "rated (continuous) torque", above=0.0, fixed=True)
    loss = Param(
        None,
        "W/N²/m²",
        "copper loss at 25 °C for a torque of 1 N·m: R / k² with the torque constant k at the joint",
        min=0.0,
        fixed=True,
    )
    winding_capacity = Param(16.3, "J/K", "heat capacity C_w of the winding", above=0.0)
    winding_resistance = Param(1.07, "K/W", "thermal resistance R_wc, winding to case", above=0.0, fixed=True)
    case_capacity = Param(512.0, "J/K", "heat capacity C_c of the case", above=0.0)
    case_resistance = Param(1.94, "K/W", "thermal resistance R_ca, case to ambient", above=0.0, fixed=True)
    start = Param(
        None,
        "°C",
        "initial temperature of both nodes; the ambient temperature by default",
        min=-50.0,
        max=200.0,
        fixed=True,
    )

    torque = Input("N·m", "measured joint torque")
    ambient = Input("°C", "ambient temperature T_a", default=25.0)
    winding = Output("°C", "winding temperature T_w")
    case = Output("°C", "case temperature T_c")
    heat = Memory(0.0, "effective loss")
    held = Memory((0.0, 0.0), "torque and ambient temperature of the previous tick")
    state = Memory((math.nan, math.nan), "temperatures T_w and T_c")
    begun = Memory(0.0, "1 after the first tick")

    kernel = kernels.two_nodes
    update_kernel = kernels.two_nodes_next
    feedthrough = ("ambient",)
    examples = ({"rated": 9.0}, {"rated": 4.0, "start": 60.0}, {"loss": 0.0})

    def configure(self) -> None:
        rated = find_model(self.actuator)[1].rated if self.actuator and self.rated is None else self.rated
        if self.loss is None and rated is None:
            raise ValueError("loss: set `actuator`, `rated` or `loss`")
        self.heat = (
            self.loss
            if self.loss is not None
            else loss_of_rating(rated, self.winding_resistance + self.case_resistance)
        )
        self.state = [math.nan if self.start is None else self.start] * 2

    def output_range(self, torque: Interval, ambient: Interval) -> Interval:
        temperature = ambient if self.start is None else ambient | Interval.point(self.start)
        size = abs(torque).high
        resistance = (self.span("winding_resistance") + self.span("case_resistance")).high
        # K, for a constant resistance of copper
        rise = self.heat * size * size * resistance * (1.0 + 1e-12) if self.heat else 0.0
        runaway = COPPER * rise
        if self.dt is None or not temperature.bounded or not runaway < 1.0 - 1e-9 or temperature.low < -200.0:
            return EVERYTHING
        # Steady-state winding temperature at the largest torque; the case remains cooler.
        hottest = (temperature.high + rise * (1.0 - 25.0 * COPPER)) / (1.0 - runaway) if rise else temperature.high
        steps = (
            resistance * (self.span("winding_capacity") + self.span("case_capacity")).high / self.dt / (1.0 - runaway)
        )
        # of each step, until it has decayed
        rounding = 1e-14 * (1.0 + steps) * max(abs(hottest), abs(temperature.low))
        return Interval(temperature.low - rounding, max(hottest, temperature.high) + rounding)


def loss_of_rating(rated: Any, resistance: Any) -> float:
    """Return the loss in W/(N·m)² at 25 °C of a motor that heats by RISE at its rated torque.

    rated : N·m; resistance : K/W, from winding to ambient
    """
    return RISE / (resistance * rated * rated * (1.0 + COPPER * RISE))
