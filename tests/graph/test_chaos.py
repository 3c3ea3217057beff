"""Whatever is wired to whatever: a diagram compiles and runs, or is refused with diagnostics that name lines. Nothing
else ever comes out.
"""

import math

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from blocks.actuators import CubeMars
from blocks.controllers import GaitPhase, Impedance, TorqueProfile
from blocks.discrete import UnitDelay
from blocks.filters import Butterworth
from blocks.limiters import Saturation, SlewRate, TorqueLimiter
from blocks.mathematics import Gain, Product, Sum
from blocks.recorders import CsvRecorder
from blocks.sources import Sine, StepSource
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Block, Diagram, DiagramError, Input, Output, compile, subsystem
from graph.diagnostics import CODES


class Vector(Block):
    """Numbers, vectors, whole numbers and truths."""

    u = Input("any", shape=(3,))
    n = Input("1", dtype=int, default=2)
    on = Input("1", dtype=bool, default=True)
    y = Output("rad", shape=(3,))
    norm = Output("1")
    many = Output("1", dtype=int)
    ok = Output("1", dtype=bool)

    def step(self, u, n, on):
        return u, float(np.sum(u)), n, on


class Late(Block):
    """No feedthrough."""

    u = Input("any")
    y = Output("any")

    def reset(self):
        self.held = 0.0

    def step(self):
        return self.held

    def update(self, u):
        self.held = u


KINDS = [
    Gain,
    Product,
    UnitDelay,
    Saturation,
    SlewRate,
    Impedance,
    GaitPhase,
    TorqueProfile,
    Sine,
    StepSource,
    Vector,
    Late,
    CsvRecorder,
    lambda: Gain(2.0, unit="N·m/rad"),
    lambda: Sum("+-"),
    lambda: Butterworth(cutoff=5.0),
    lambda: TorqueLimiter(limit=5.0),
    lambda: CubeMars("AK80-9", can_id=1),
    lambda: CubeMars("AK80-9", can_id=2),
    lambda: Gain(every=2),
    lambda: UnitDelay(every=3),
]
CONSTANTS = [0.0, 1, True, -2.5, math.nan, math.inf, [1.0, 2.0, 3.0], [1.0], np.zeros((3, 1)), 1e308]


@settings(suppress_health_check=[HealthCheck.too_slow])
@given(st.data())
def test_a_random_diagram_compiles_and_runs_or_is_rejected_with_reason(data):
    made = data.draw(st.lists(st.sampled_from(range(len(KINDS))), min_size=1, max_size=12))
    with Diagram("chaos", rate=100) as diagram:
        with subsystem("half", every=data.draw(st.sampled_from([1, 1, 2]))):
            blocks = [KINDS[number]() for number in made[: len(made) // 2]]
        blocks += [KINDS[number]() for number in made[len(made) // 2 :]]
        signals = [getattr(block, name) for block in blocks for name in block.outputs]
        sources = st.sampled_from(range(len(signals) + len(CONSTANTS)))
        for block in blocks:
            for name in block.inputs:
                for _ in range(data.draw(st.sampled_from([1, 1, 1, 1, 1, 1, 0, 2]))):
                    number = data.draw(sources)
                    block(**{name: signals[number] if number < len(signals) else CONSTANTS[number - len(signals)]})
    try:
        schedule = compile(diagram)
    except DiagramError as error:
        assert error.diagnostics and len(set(error.diagnostics)) == len(error.diagnostics)
        assert all(
            d.code in CODES and d.path and d.where is not None and d.where.file == __file__ for d in error.diagnostics
        )
        return
    if schedule.devices:
        return
    outcome = Executor(Program(schedule), 100.0, virtual=True).run(6)
    assert outcome.status in ("ok", "exception") and (
        outcome.status == "ok" or isinstance(outcome.error, (ArithmeticError, ValueError))
    )
