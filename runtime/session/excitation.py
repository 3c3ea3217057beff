"""Loops through drives, measured in a simulation: an excitation is added to the signal at an input."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from graph import Block, Input, Output
from graph.compiler import examine
from graph.diagram import Wire
from graph.interval import EVERYTHING, Interval
from graph.signal import Signal
from runtime.host.errors import BadInput
from runtime.robot.loading.file import build_plant
from runtime.session.simulate import simulate

if TYPE_CHECKING:
    from graph import Diagram
    from runtime.robot.loading.diagram_file import DiagramFile

PERIOD = 10.0  # s of the excitation, whose frequencies are multiples of its inverse
TONES = 60  # at most, between the lowest and the highest frequency
LOWEST, HIGHEST = 0.2, 0.4  # frequencies: in Hz, and as a share of the rate
START = 10.0  # s of the run before the excitation
SHARE = 0.25  # of the range of the signal that is the size of the excitation


class Excitation(Block):
    """Sum of sines that is added to a signal: y = u + d, within the range of u.

    Its two signals are kept. The range of y is that of u, so that a proved limit of a command stays proved.
    """

    u = Input("any", "signal")
    y = Output("any", "signal with the excitation")

    amplitude = 0.0
    start = 0
    tones: Any = ()
    low, high = -math.inf, math.inf

    def output_range(self, u: Interval) -> Interval:
        return u

    def reset(self) -> None:
        self.kept: list[tuple[float, float]] = []

    def step(self, u: float, tick: int) -> float:
        d = self.amplitude * self.tones[(tick - self.start) % len(self.tones)] if tick >= self.start else 0.0
        y = min(max(u + d, self.low), self.high) if u == u else u
        self.kept.append((u, y))
        return y


def measure(
    file: DiagramFile, robot: Diagram, name: str, at: float, amplitude: float | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Measure L at an input of a robot, from the input to minus the signal that is connected there.

    Three runs in simulation: without excitation, with it, and with half of it in other phases. Both signals at the
    input have their difference from the first run, over one period after the transient of another. While a wearer
    walks, each sine also responds at frequencies around it, at a distance of the stride's, where other sines are; with
    other phases, they add up to another sum. The robot is changed.

    at : time in s at which the excitation begins, 0 for START
    amplitude : largest value of the excitation, by default a share of the range of the signal

    Returns (frequencies in Hz, L as the mean of both runs, the error of 1 + L as a share of it: their difference).
    Raises BadInput.
    """
    wire = next(wire for wire in robot.wires if f"{wire.block.path}.{wire.port}" == name)
    within = examine(robot).ranges.get(wire.source, EVERYTHING)
    with robot:
        excitation = Excitation(name="loop_excitation")
    excitation.low, excitation.high = within.low, within.high
    robot.wires = [
        *(other for other in robot.wires if other is not wire),
        Wire(wire.source, excitation, "u", wire.where),
        Wire(Signal(excitation, "y"), wire.block, wire.port, wire.where),
    ]
    plant = build_plant(file, robot) if file.has_plant else None
    ticks = round(PERIOD * robot.rate)
    numbers = np.unique(np.round(np.geomspace(LOWEST * PERIOD, HIGHEST * robot.rate * PERIOD, TONES)).astype(int))
    low_peak = -np.pi * np.arange(len(numbers)) ** 2 / len(numbers)  # Schroeder 1970
    random = 2.0 * np.pi * np.random.default_rng(0).uniform(size=len(numbers))
    excitation.start = round((at or START) * robot.rate)

    def spectra(size: float, phases: np.ndarray) -> np.ndarray:
        tones = np.cos(2.0 * np.pi * np.outer(np.arange(ticks) / ticks, numbers) + phases).sum(axis=1)
        excitation.amplitude, excitation.tones = size, (tones / np.abs(tones).max()).tolist()
        trial = simulate(robot, (excitation.start + 2 * ticks) / robot.rate, plant=plant)
        if trial.fault is not None:
            raise BadInput(f"the run with an excitation of {size:g} at {name} ended: {trial.fault['report'][0]}")
        return np.fft.rfft(np.array(excitation.kept[-ticks:]), axis=0)[numbers]

    still = spectra(0.0, low_peak)
    size = amplitude or SHARE * min(-excitation.low, excitation.high)
    if not 0.0 < size < math.inf:
        raise BadInput(
            f"the signal at {name} has no range around 0, of which the excitation is a share: pass --amplitude"
        )
    both = spectra(size, low_peak) - still, spectra(size / 2.0, random) - still
    loops = [-each[:, 0] / each[:, 1] for each in both]
    mean = (loops[0] + loops[1]) / 2.0
    return numbers / PERIOD, mean, np.abs((loops[0] - loops[1]) / (1.0 + mean))
