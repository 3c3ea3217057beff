"""Plays arrays into a block on the executor, as fast as it goes, and gives back what came out: a million ticks take a
second.
"""

import numpy as np

from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Block, Diagram, Input, Output, compile


def source(values, unit="any", dtype=float):
    """A block that gives values[tick], numbers or vectors."""
    values = np.asarray(values)
    rows = values.tolist() if values.ndim == 1 else values

    class Played(Block):
        """Plays numbers."""

        y = Output(unit, "what is played", shape=values.shape[1:], dtype=dtype)

        def step(self, tick):
            return rows[tick]

    return Played()()


def taker(signal, shape, ticks):
    """An array that fills with the signal's values."""
    taken = np.full((ticks, *shape), np.nan)

    class Taker(Block):
        """Keeps what it gets."""

        u = Input("any", "what is kept", shape=shape)

        def step(self, u, tick):
            taken[tick] = u

    Taker()(signal)
    return taken


def play(make, rate=200.0, /, **inputs):
    """Outputs, arrays over the ticks by name, of the block that `make` makes. inputs: arrays over the ticks, by
    name.
    """
    ticks = len(next(iter(inputs.values())))
    with Diagram("played", rate=rate) as diagram:
        block = make()
        wires = {
            name: source(values, block.inputs[name].unit, block.inputs[name].dtype) for name, values in inputs.items()
        }
        signals = block(**wires)
        signals = [signals] if len(block.outputs) == 1 else list(signals)
        free = next((np.shape(inputs[n])[1:] for n, p in block.inputs.items() if p.shape is ... and n in inputs), ())
        outputs = {
            name: taker(signal, free if port.shape is ... else port.shape, ticks)
            for (name, port), signal in zip(block.outputs.items(), signals)
        }
    Executor(Program(compile(diagram)), rate).spin(ticks)
    return outputs


def made(kind, *values, rate=200.0, **parameters):
    """A block that knows its sampling period, to be stepped by hand."""
    with Diagram("made", rate=rate):
        return kind(*values, **parameters)


def settle(block, **inputs):
    """What arming does to a block: it starts from these inputs."""
    block.scratch.load((), inputs, block.inputs)
    if block.settle_kernel is not None:
        block.scratch.call(block.settle_kernel)
