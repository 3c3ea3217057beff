"""Arithmetic on signals."""

from cext.kernels import mathematics as kernels
from graph import Block, Input, Memory, Output, Param
from graph.units import canonical, multiply


class Gain(Block):
    """Multiplies by a constant: y = gain · u. Direct feedthrough; NaN passes."""

    gain = Param(1.0, "any", "factor")
    unit = Param("1", "1", "unit of the factor; the output has the product of both units")

    u = Input("any", "input", shape=...)
    y = Output("any", "gain · u", shape=...)

    kernel = kernels.gain

    def configure(self):
        self.unit = canonical(self.unit)

    def output_units(self, u):
        return {"y": multiply(u, self.unit)}

    def output_range(self, u):
        return self.span("gain") * u


class Sum(Block):
    """Adds and subtracts any number of signals: y = ± u1 ± u2 .... Direct feedthrough; NaN passes."""

    signs = Param("++", "1", "one + or - for each input")

    y = Output("any", "the sum", shape=...)
    weights = Memory(1.0, "+1 or -1 for each input")

    kernel = kernels.sum

    def configure(self):
        if not self.signs or set(self.signs) - {"+", "-"}:
            raise ValueError(f"signs is one + or - for each input, as in '+-', not {self.signs!r}")
        self.inputs = {f"u{i}": Input("any", f"input {i}", shape=...).named(f"u{i}") for i in range(1, len(self.signs) + 1)}
        self.weights = [1.0 if sign == "+" else -1.0 for sign in self.signs]

    def output_range(self, **inputs):
        first, *rest = (u if sign == "+" else -u for u, sign in zip(inputs.values(), self.signs))
        for interval in rest:
            first = first + interval
        return first


class Product(Block):
    """Multiplies two signals: y = a · b. Direct feedthrough; NaN passes."""

    a = Input("any", "first factor", shape=...)
    b = Input("any", "second factor", shape=...)
    y = Output("any", "a · b", shape=...)

    kernel = kernels.product

    def output_units(self, a, b):
        return {"y": multiply(a, b)}

    def output_range(self, a, b):
        return a * b

