"""Python blocks compiled with Numba: the same numbers as in Python, without the GIL. Skipped where the extra is not
installed.
"""

import math
import random

import numpy as np
import pytest

from blocks.actuators import CubeMars
from blocks.logic import Compare
from blocks.mathematics import Gain, Sign
from blocks.recorders import CsvRecorder
from blocks.sources import Sine
from cext.memory.shared_state import RECORD_ROW, SharedState
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Block, Diagram, Input, Output, Param, compile, jit
from tests.blocks.running import player, run
from tests.graph.complaints import complaint
from tests.soaking import soaked

NUMBA = pytest.mark.skipif(not jit.available(), reason="needs Numba, the extra `jit`")


class Tracker(Block):
    """Follows with a dead band, counts its moves, and says which way it goes."""

    band = Param(0.3, "1", "dead band", min=0.0)
    gain = Param(0.7, "1", "share of the way in a tick")

    u = Input("any", "input")
    hold = Input("1", "whether to stand still", dtype=bool, default=False)
    y = Output("any", "followed")
    moves = Output("1", "moves so far", dtype=int)
    up = Output("1", "whether it rises", dtype=bool)

    def reset(self):
        self.value, self.count = 0.0, 0

    def step(self, u, hold, dt):
        before = self.value
        if hold:
            return before, self.count, False
        change = u - before
        if abs(change) > self.band:
            self.value += self.gain * change / (1.0 + dt) - math.sqrt(dt)
            self.count += 1
        return self.value, self.count, self.value > before


class Delay(Block):
    """The tick before."""

    jit = True
    u = Input("any", "input")
    y = Output("any", "before")

    def reset(self):
        self.held = 0.5

    def step(self):
        return self.held

    def update(self, u):
        self.held = u


def trace(kind, ticks=400):
    with Diagram("d", rate=100) as diagram:
        kind(name="block")(Sine(2.0, 3.0)()) if len(kind.inputs) == 1 else kind(name="block")(
            Sine(2.0, 3.0)(), hold=False
        )
        CsvRecorder()
    schedule = compile(diagram)
    shared = SharedState(1 << 20)
    assert Executor(Program(schedule), 100.0, shared=shared, virtual=True).run(ticks).status == "ok"
    return schedule, np.array([np.frombuffer(payload) for kind, payload in shared.drain() if kind == RECORD_ROW])


@NUMBA
@pytest.mark.parametrize("kind", soaked([Tracker, Delay], but=[0]))
def test_compiled_and_python_agree_bit_for_bit(kind):
    slow, expected = trace(type("InPython", (kind,), {"jit": False, "__doc__": "-"}))
    fast, found = trace(type("Compiled", (kind,), {"jit": True, "__doc__": "-"}))
    assert slow.gil_sections > 0 and fast.gil_sections == 0
    assert np.array_equal(found, expected) and len(found) == 400 and np.ptp(found[:, 2:]) > 0.5


class Truth(Block):
    """Number of a bool."""

    u = Input("1", "input", dtype=bool)
    y = Output("1", "1 if it is true")

    def step(self, u):
        return 1.0 if u else 0.0


class Whole(Block):
    """Number of an int, which only the update reads."""

    u = Input("1", "input", dtype=int)
    y = Output("1", "the number before")

    def reset(self):
        self.held = 0.0

    def step(self):
        return self.held

    def update(self, u):
        self.held = 1.0 * u


class Bounded(Block):
    """A number that should remain in its range."""

    u = Input("1", "input")
    y = Output("1", "the input", range=(-math.inf, np.float64(1.0)))

    def step(self, u):
        return u


class Count(Block):
    """Not a whole number."""

    u = Input("1", "input")
    y = Output("1", "the input", dtype=int)

    def step(self, u):
        return u


class Flag(Block):
    """NaN at the end."""

    u = Input("1", "input")
    y = Output("1", "whether it is not 0", dtype=bool)

    def step(self, u):
        return u


class Silent(Block):
    """Returns nothing above 1."""

    u = Input("1", "input")
    y = Output("1", "the input")

    def step(self, u):  # noqa: RET503  # returns nothing for other inputs
        if u <= 1.0:
            return u


class Raises(Block):
    """Accepts up to 1."""

    u = Input("1", "input")
    y = Output("1", "the input")

    def step(self, u):
        if u > 1.0:
            raise ValueError("too large")
        return u


class Place(Block):
    """One of two numbers."""

    u = Input("1", "place")
    y = Output("1", "number")

    def step(self, u):
        return (3.0, 5.0)[int(u)]


class Rounded(Block):
    """Sum of what converts to an int."""

    u = Input("1", "input")
    y = Output("1", "sum", dtype=int)

    def step(self, u):
        return int(u) + int(u > 0.0) + round(u) + math.floor(u) + math.ceil(u) + math.trunc(u)


@NUMBA
@pytest.mark.parametrize(
    "kind, last, text",
    soaked(
        [
            (Rounded, math.nan, "its step raised an exception. Remove `jit = True` to see which"),
            (Rounded, -math.inf, "its step raised an exception. Remove `jit = True` to see which"),
            (Raises, 2.0, "its step raised an exception. Remove `jit = True` to see which"),
            (Place, 2.0, "its step raised an exception. Remove `jit = True` to see which"),
            (Truth, math.nan, "u is NaN or infinite, which is neither an int nor a bool"),
            (Whole, math.nan, "u is NaN or infinite, which is neither an int nor a bool"),
            (Bounded, 1.5, "its step returned a value for y that is not a number in [-inf, 1]"),
            (Count, 0.5, "its step returned a value for y that is not a whole number"),
            (Count, math.inf, "its step returned a value for y that is not a whole number"),
            (Flag, math.nan, "its step returned a value for y that is not a bool"),
            (Silent, 1.5, "its step returned no value"),
        ],
        but=[0, 7],
    ),
)
def test_a_value_that_would_be_an_exception_in_python_ends_the_run(kind, last, text):
    compiled = type("Compiled", (kind,), {"jit": True, "__doc__": "-"})
    convert = {"float": Gain, "int": Sign, "bool": lambda: lambda u: Compare(">")(u, 0.5)}[kind.inputs["u"].dtype]
    with Diagram("d", rate=100) as diagram:
        block = compiled(name="block")
        block(convert()(player([0.0, 1.0, last])))
    schedule = compile(diagram)
    assert block.compiled
    outcome = Executor(Program(schedule), 100.0, virtual=True).run(5)
    status, _, number = outcome.status.rpartition(" ")
    assert (status, outcome.culprit, outcome.tick) == ("kernel status", "block", 2)
    assert block.fault_text(int(number)) == text


class Follower(Block):
    """First-order low-pass that starts at the measurement."""

    u = Input("any", "input")
    y = Output("any", "filtered")

    def prepare(self, dt):
        self.share = 10.0 * dt

    def reset(self):
        self.value = 0.0

    def settle(self, u):
        self.value = u

    def step(self, u):
        self.value += self.share * (u - self.value)
        return self.value


@NUMBA
def test_a_compiled_block_settles_when_its_robot_is_armed():
    with Diagram("robot", rate=200) as robot:
        knee = CubeMars("AK80-9", name="knee")
        knee(torque_command=0.0)
        for compiled in (True, False):
            kind = type("Compiled" if compiled else "InPython", (Follower,), {"jit": compiled, "__doc__": "-"})
            kind(name=f"follower{compiled:d}", every=2)(knee.position)
    with Diagram("holder", rate=200) as plant:
        robot["knee"].emulator()(position=0.8, velocity=0.0)
    recording = run(robot, 20, plant=plant)
    assert robot["follower1"].compiled and not robot["follower0"].compiled
    assert recording["follower1.y"] == pytest.approx(0.8, abs=1e-3)
    assert np.array_equal(recording["follower1.y"], recording["follower0.y"])


class Elementary(Block):
    """Functions of math."""

    jit = True
    u = Input("1", "input")
    a = Output("1", "sine")
    b = Output("1", "exponential")
    c = Output("1", "arctangent")

    def step(self, u):
        return math.sin(u), math.exp(u / 10.0), math.atan2(u, 1.5)


@NUMBA
def test_elementary_functions_are_within_two_units_in_the_last_place():
    block = Elementary()
    jit.compile_block(block)
    from cext.schedule.kernel_table import call_kernel
    from graph.arena_layout import KernelTable

    random.seed(3)
    for _ in range(2000):
        u = random.uniform(-30.0, 30.0)
        arena = np.array([0.0] * 8 + [u, 0.0, 0.0, 0.0])
        assert call_kernel(block.kernel, arena, KernelTable((8, 9, 10, 11), (1, 1, 1, 1))) == 0
        for value, exact in zip(arena[9:], (math.sin(u), math.exp(u / 10.0), math.atan2(u, 1.5))):
            assert abs(value - exact) <= 2 * math.ulp(exact)


class Lister(Block):
    """Keeps a list."""

    jit = True
    u = Input("1", "input")
    y = Output("1", "length")

    def reset(self):
        self.seen = []

    def step(self, u):
        self.seen.append(u)
        return len(self.seen)


@NUMBA
def test_a_step_that_cannot_be_compiled_is_reported_before_the_run():
    with Diagram("d", rate=100) as diagram:
        Lister()(1.0)
    found = complaint(diagram)
    assert found.code == "TW017" and "self.seen" in found.message and found.path == "lister"


class Keyed(Block):
    """Calls what Numba does not know."""

    jit = True
    u = Input("1", "input")
    y = Output("1", "number")

    def step(self, u):
        return random.SystemRandom().random() * u


@NUMBA
def test_the_message_names_what_numba_does_not_support():
    with Diagram("d", rate=100) as diagram:
        Keyed()(1.0)
    assert "SystemRandom" in complaint(diagram).message


def test_without_numba_the_block_runs_in_python_with_a_warning(monkeypatch):
    monkeypatch.setattr(jit, "available", lambda: False)
    with Diagram("d", rate=100) as diagram:
        Delay()(1.0)
    schedule = compile(diagram)
    assert [w.code for w in schedule.warnings if w.code == "TW023"] == ["TW023"] and schedule.gil_sections == 2
