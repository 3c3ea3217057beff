"""An infinity never becomes a finite number: what clips turns it into NaN, which is a fault at the actuator."""

import math
import random

import numpy as np
import pytest

from blocks import discrete, filters, limiters, mathematics, tables, windows
from blocks.actuators import CubeMars
from blocks.controllers import PID
from graph import Device, Diagram
from graph.block import Sink
from graph.conformance import Drive
from graph.signal import Signal
from runtime.robot.loading.catalog import libraries
from tests.blocks.examples import EXAMPLES
from tests.blocks.running import player
from tests.cext.rigs import Rig, plant_of
from tests.soaking import soaked

KINDS = [
    kind
    for kind in libraries()[0].homes
    if not issubclass(kind, (Device, Sink)) and kind.kernel is not None and kind.inputs
]
TICKS = 4  # in which an infinite input must show: every delay of the examples is shorter

# What may turn an infinite input into finite outputs, and why.
DECISIONS = {
    "Compare": "inf > 1 is true: a comparison of infinities is well defined, and its result is a decision, not a "
    "quantity"
}


def cases():
    for kind in KINDS:
        default = EXAMPLES[kind.__name__] if kind.__name__ == "InverseDynamics" else ({},)
        for number, parameters in enumerate(getattr(kind, "examples", default)):
            yield pytest.param(kind, dict(parameters), id=f"{kind.__name__}-{number}" if number else kind.__name__)


def outputs_after(kind, parameters, seed, name, element, value):
    """All float outputs of some ticks, the first of which has `value` in one element of an input."""
    drive = Drive(kind, parameters, seed)
    floats = [port for port, declared in drive.block.outputs.items() if declared.dtype != "bool"]
    found = []
    for tick in range(5 + TICKS):
        inputs = drive.draw()
        if tick == 5:
            flat = np.array(inputs[name], dtype=float)
            flat.reshape(-1)[element] = value
            inputs[name] = flat if flat.shape else float(flat)
        outputs = drive.step(inputs)
        if tick >= 5:
            found += [np.ravel(np.asarray(outputs[port], dtype=float)) for port in floats]
    return np.concatenate(found) if found else np.empty(0)


@pytest.mark.parametrize("kind, parameters", list(cases()))
@pytest.mark.parametrize("value", soaked([math.inf, -math.inf], but=[0]))
def test_an_infinite_input_makes_every_dependent_output_non_finite(kind, parameters, value):
    for seed in range(6):
        block = Drive(kind, parameters, seed).block
        for name, port in block.inputs.items():
            if port.dtype == "bool":
                continue
            given = np.size(Drive(kind, parameters, seed).draw()[name])
            for element in range(given):
                found = outputs_after(kind, parameters, seed, name, element, value)
                if np.all(np.isfinite(found)) and kind.__name__ not in DECISIONS:
                    others = [
                        outputs_after(kind, parameters, seed, name, element, other)
                        for other in (1.0, -2.5, 700.0, -1e5)
                    ]
                    assert all(np.array_equal(found, other) for other in others), f"{name} = {value} gives {found}"


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind.__name__ in DECISIONS])
def test_logic_outputs_are_bool(kind):
    assert all(port.dtype == "bool" for port in kind.outputs.values())


@pytest.mark.parametrize(
    "make",
    [
        lambda: limiters.SlewRate(rate=100.0),
        lambda: limiters.TorqueLimiter(limit=9.0, slew=200.0),
        lambda: limiters.RMSTorqueLimiter(limit=5.0),
        lambda: filters.Exponential(time_constant=0.1),
        lambda: filters.Median(samples=3),
        lambda: windows.MovingMaximum(window=0.015),
        lambda: PID(kp=2.0, ki=1.0, kd=0.1, lower=-9.0, upper=9.0),
    ],
)
def test_infinity_leaves_same_state_as_nan(make):
    """No memory keeps it: a state that was infinite would be a wrong finite number later on."""

    def play(value):
        with Diagram("after", rate=200):
            block = make()
        values = [1.0, 2.0, value, 1.5, 1.0, 0.5, 0.0, 0.5]
        names = list(block.inputs)
        return np.array(
            [block.step(**{names[0]: u, **({"measurement": 0.0} if "measurement" in names else {})}) for u in values],
            dtype=float,
        )

    for value in (math.inf, -math.inf):
        assert np.array_equal(play(value)[3:], play(math.nan)[3:], equal_nan=True)
        assert not math.isfinite(play(value)[2])


def played(diagram, ticks):
    """The outcome of a run against emulated drives, and the Rig with what was recorded."""
    rig = Rig(diagram, plant_of(diagram, substeps=1))
    return rig.run(ticks, fade=0.0), rig


def test_a_division_by_zero_in_front_of_a_torque_limiter_is_a_fault_and_no_torque():
    with Diagram("division", rate=200) as diagram:
        quotient = mathematics.Divide(name="divide")(player([1.0] * 20, "N·m"), player([1.0] * 10 + [0.0] * 10, "1"))
        CubeMars("AK80-9", name="knee")(torque_command=limiters.TorqueLimiter(limit=9.0, name="limiter")(quotient))
    outcome, rig = played(diagram, 20)
    assert (outcome.status, outcome.culprit, outcome.tick) == ("not finite", "knee", 10)
    assert rig["limiter.limited"].max() <= 1.0 and np.abs(rig["knee.torque_sent"]).max() <= 1.0


def test_a_python_block_that_overflows_is_a_fault_and_no_torque():
    with Diagram("overflow", rate=200) as diagram:
        torque = player([1.0] * 10 + [1e308 * 10], "N·m")
        CubeMars("AK80-9", name="knee")(torque_command=limiters.TorqueLimiter(limit=9.0, name="limiter")(torque))
    outcome, rig = played(diagram, 20)
    assert (outcome.status, outcome.tick) == ("not finite", 10) and np.abs(rig["knee.torque_sent"]).max() <= 1.0


# Random diagrams

EXTREMES = (math.inf, -math.inf, math.nan, 1e308, -1e308, 5e-324, -5e-324, 0.0)
ONE = (
    lambda: mathematics.Gain(-1.7),
    lambda: limiters.Saturation(lower=-3.0, upper=4.0),
    lambda: limiters.SlewRate(rate=50.0),
    lambda: limiters.DeadZone(lower=-0.2, upper=0.1),
    mathematics.Abs,
    mathematics.Round,
    lambda: lambda u: mathematics.Polynomial((1.0, 0.0))(mathematics.Sign()(u)),
    lambda: mathematics.Polynomial((0.5, 0.0, 1.0)),
    lambda: filters.Exponential(time_constant=0.02),
    lambda: filters.Median(samples=3),
    lambda: windows.MovingAverage(window=0.02),
    lambda: windows.MovingMaximum(window=0.02),
    lambda: windows.MovingMinimum(window=0.02),
    lambda: windows.MovingRMS(window=0.02),
    lambda: discrete.Derivative(time_constant=0.05),
    discrete.UnitDelay,
    lambda: tables.LookupTable1D(breakpoints=(-1.0, 0.0, 2.0), values=(0.5, -1.0, 2.0)),
    lambda: filters.Butterworth(cutoff=20.0),
    lambda: limiters.SoftStart(duration=0.02),
)
TWO = (
    mathematics.Sum,
    mathematics.Product,
    mathematics.Divide,
    mathematics.Min,
    mathematics.Max,
    lambda: PID(kp=2.0, ki=5.0, kd=0.01, lower=-5.0, upper=5.0),
)


def random_diagram(seed, ticks):
    chance = random.Random(seed)
    with Diagram("random", rate=200) as diagram:
        signals = []
        for _ in range(2):
            values = [chance.uniform(-2.0, 2.0) for _ in range(ticks)]
            if chance.random() < 0.7:
                values[chance.randrange(5, ticks)] = chance.choice(EXTREMES)
            signals.append(player(values))
        for _ in range(chance.randrange(2, 9)):
            if chance.random() < 0.6:
                signals.append(chance.choice(ONE)()(chance.choice(signals)))
            else:
                signals.append(chance.choice(TWO)()(chance.choice(signals), chance.choice(signals)))
        limited = limiters.TorqueLimiter(limit=5.0, slew=chance.choice((100.0, math.inf)), name="limiter")(signals[-1])
        CubeMars("AK80-9", name="knee")(torque_command=limited)
    return diagram


def examine(seed, ticks=40):
    """Run one random diagram; return its outcome and how many signals were not finite in all ticks, the one of the
    fault included.
    """
    diagram = random_diagram(seed, ticks)
    outcome, rig = played(diagram, ticks)
    schedule, failed = rig.schedule, outcome.status != "ok"

    def values(signal):
        return np.append(rig[signal.path], [rig.control.final[schedule.signals[signal.path].slot]] if failed else [])

    assert np.all(np.abs(rig["limiter.limited"]) <= 5.0) and np.all(
        np.abs(rig["knee.torque_sent"]) <= 5.0 + 36.0 / 4095
    ), seed
    assert not failed or (outcome.status, outcome.culprit) == ("not finite", "knee"), seed
    spoilt_signals = 0
    for wire in diagram.wires:
        block, source = wire.block, wire.source
        if not isinstance(source, Signal) or isinstance(block, (Device, Sink)):
            continue
        spoilt = ~np.isfinite(values(source))
        shown = ~np.isfinite(values(Signal(block, next(iter(block.outputs)))))
        if isinstance(block, discrete.UnitDelay):
            spoilt, shown = spoilt[:-1], shown[1:]
        assert np.all(shown[spoilt]), f"seed {seed}: {block.path} hides what {source.path} is"
        spoilt_signals += int(spoilt.sum())
    return outcome, spoilt_signals


def test_in_random_diagrams_a_command_comes_from_finite_values_or_is_a_fault():
    found = [examine(seed) for seed in range(40)]
    assert sum(outcome.status != "ok" for outcome, _ in found) > 10 and sum(count for _, count in found) > 50
