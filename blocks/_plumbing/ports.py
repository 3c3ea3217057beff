"""Ports and parameters that blocks of several rooms declare alike."""

import math

from graph import Input, units


def several(count, unit="any", dtype=float):
    """Inputs u1, u2, ... of any shape, for a block to set as its `inputs` when it is configured."""
    return {f"u{i}": Input(unit, f"input {i}", shape=..., dtype=dtype).named(f"u{i}") for i in range(1, count + 1)}


class UnitOfOutput:
    """For blocks whose parameter `unit` says the unit of their output y."""

    def configure(self):
        self.unit = units.canonical(self.unit)

    def output_units(self, **inputs):
        return {"y": self.unit}


def finite_numbers(name, values):
    """A tuple of at least one finite float. ValueError if it is not."""
    try:
        found = tuple(float(value) for value in values)
    except TypeError:
        found = ()
    if not found or not all(map(math.isfinite, found)):
        raise ValueError(f"{name} must be finite numbers, at least one, got {values!r}")
    return found
