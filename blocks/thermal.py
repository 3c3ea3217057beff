"""How hot a motor gets: a model of two nodes, for derating and for drives that report no temperature of their own."""

import math

from blocks.families import find_model
from cext.kernels import thermal as kernels
from graph import Block, Input, Interval, Memory, Output, Param
from graph.interval import EVERYTHING

COPPER = 0.00393  # 1/K, by which the resistance of copper grows from its value at 25 °C
RISE = 75.0  # K above ambient that the winding is taken to reach at the rated torque, held for ever


class ThermalModel(Block):
    """Temperatures of winding and case: C_w dT_w/dt = P - (T_w - T_c) / R_wc, C_c dT_c/dt = (T_w - T_c) / R_wc - (T_c -
    T_a) / R_ca.

    P = loss · τ² · (1 + 0.00393 (T_w - 25 °C)), the heat of the copper. Backward Euler, so that any period is stable;
    dt is the true time since the tick before. No direct feedthrough of the torque. Both nodes start at `start`, or at
    the ambient temperature. NaN passes and is not held.

    `loss` may be left out: it follows from `rated`, the torque the motor can hold for ever, taken to bring the winding
    75 K above ambient; and `rated` from `actuator`, the name of a model. The resistances and capacities are those that
    were measured on an outrunner of this size, without a fan (J. Schuchmann's test of the Dephy ActPack, in Open-Source
    Leg's thermal model); measure your own motor where its limit is to be used in full.
    """

    models_heat = True

    actuator = Param("", "1", "model of an actuator, for its rated torque")
    rated = Param(None, "N·m", "torque that can be held for ever", above=0.0, fixed=True)
    loss = Param(
        None,
        "W/N²/m²",
        "heat of the winding at 25 °C for a torque of 1 N·m: R / k², k the torque constant at the joint",
        min=0.0,
        fixed=True,
    )
    winding_capacity = Param(16.3, "J/K", "C_w", above=0.0)
    winding_resistance = Param(1.07, "K/W", "R_wc, winding to case", above=0.0, fixed=True)
    case_capacity = Param(512.0, "J/K", "C_c", above=0.0)
    case_resistance = Param(1.94, "K/W", "R_ca, case to ambient", above=0.0, fixed=True)
    start = Param(
        None,
        "°C",
        "temperature of both nodes at the start; the ambient's if left out",
        min=-50.0,
        max=200.0,
        fixed=True,
    )

    torque = Input("N·m", "of the joint, as measured")
    ambient = Input("°C", "T_a", default=25.0)
    winding = Output("°C", "T_w")
    case = Output("°C", "T_c")
    heat = Memory(0.0, "the loss that is used")
    held = Memory((0.0, 0.0), "torque and ambient temperature of the tick before")
    state = Memory((math.nan, math.nan), "T_w and T_c")
    begun = Memory(0.0, "whether there was a tick before")

    kernel = kernels.two_nodes
    update_kernel = kernels.two_nodes_next
    feedthrough = ("ambient",)
    examples = ({"rated": 9.0}, {"rated": 4.0, "start": 60.0}, {"loss": 0.0})

    def configure(self):
        rated = find_model(self.actuator)[1].rated if self.actuator and self.rated is None else self.rated
        if self.loss is None and rated is None:
            raise ValueError("loss: name an actuator, or give its rated torque or its loss")
        self.heat = (
            self.loss
            if self.loss is not None
            else loss_of_rating(rated, self.winding_resistance + self.case_resistance)
        )
        self.state = [math.nan if self.start is None else self.start] * 2

    def output_range(self, torque, ambient):
        temperature = ambient if self.start is None else ambient | Interval.point(self.start)
        size = abs(torque).high
        resistance = (self.span("winding_resistance") + self.span("case_resistance")).high
        # K, were copper not to change
        rise = self.heat * size * size * resistance * (1.0 + 1e-12) if self.heat else 0.0
        runaway = COPPER * rise
        if self.dt is None or not temperature.bounded or not runaway < 1.0 - 1e-9 or temperature.low < -200.0:
            return EVERYTHING
        # Where the heat of the largest torque, held for ever, would bring the winding; the case stays cooler.
        hottest = (temperature.high + rise * (1.0 - 25.0 * COPPER)) / (1.0 - runaway) if rise else temperature.high
        steps = (
            resistance * (self.span("winding_capacity") + self.span("case_capacity")).high / self.dt / (1.0 - runaway)
        )
        # of each step, for as long as it is felt
        rounding = 1e-14 * (1.0 + steps) * max(abs(hottest), abs(temperature.low))
        return Interval(temperature.low - rounding, max(hottest, temperature.high) + rounding)


def loss_of_rating(rated, resistance):
    """W/(N·m)² at 25 °C of a motor that reaches RISE above 25 °C at its rated torque; resistance in K/W from winding to
    ambient.
    """
    return RISE / (resistance * rated * rated * (1.0 + COPPER * RISE))
