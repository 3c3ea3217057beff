"""Whatever goes wrong in a block or at a command ends in the safe stop within its tick, and never in a frame."""

import ctypes
import math
import sys

import pytest

from blocks.actuators import CubeMars, EmulatedCubeMars
from blocks.filters import Butterworth
from blocks.limiters import Saturation, SlewRate, TorqueLimiter
from blocks.mathematics import Gain, Product, Sum
from cext.kernels import mathematics as kernels
from graph import Block, Diagram, Input, Kernel, Output, compile
from tests.cext.rigs import Rig, ends_in_the_safe_stop, one_drive, plant_of


class At(Block):
    """Calls a function at one tick, and gives what it returns; 1 N·m at every other."""

    y = Output("N·m")

    def __init__(self, tick, action, **options):
        self.when, self.action = tick, action
        super().__init__(**options)

    def step(self, tick):
        return self.action() if tick == self.when else 1.0


class TornAngle(Block):
    """An angle that is torn after a while."""

    angle = Output("rad")

    def step(self, t):
        if t > 0.2:
            raise ValueError("torn")
        return 0.1


def raises(error):
    def action():
        raise error

    return action


def test_a_nan_fade_in_share_is_a_fault():
    @ctypes.CFUNCTYPE(ctypes.c_int, ctypes.POINTER(ctypes.c_double), ctypes.c_void_p, ctypes.c_void_p)
    def rogue(arena, slots, sizes):
        arena[6] = math.nan if arena[1] == 5.0 else arena[6]
        return 0

    class Rogue(Block):
        """A kernel that writes where it has no business."""

        kernel = Kernel(rogue, "")

    rig = one_drive(lambda knee: (Rogue(), 1.0)[1])
    outcome = rig.run(20)
    assert (outcome.status, outcome.culprit, outcome.tick) == ("out of limits", "knee", 5) and len(rig.commands()) == 5


@pytest.mark.hazard("H8a")
@pytest.mark.parametrize("tick", [0, 1, 30])
@pytest.mark.parametrize(
    "error",
    [
        ValueError("no"),
        KeyboardInterrupt(),
        SystemExit(3),
        MemoryError(),
        StopIteration(),
        RecursionError(),
        AssertionError(),
        ZeroDivisionError(),
    ],
)
def test_any_python_exception_triggers_safe_stop_within_tick(error, tick):
    rig = one_drive(lambda knee: TorqueLimiter(limit=5.0)(At(tick, raises(error), name="culprit").y))
    outcome = rig.run(100)
    assert (outcome.status, outcome.culprit, outcome.tick, outcome.error) == (
        "exception",
        "culprit",
        tick,
        error,
    ) and outcome.faulted
    assert ends_in_the_safe_stop(rig) and len(rig.commands()) == tick and rig.statistics()["ticks"] == tick
    assert rig.tick.tolist() == list(range(tick))


def test_sys_exit_in_a_block_is_an_exception_of_that_block():
    rig = one_drive(lambda knee: TorqueLimiter(limit=5.0)(At(3, lambda: sys.exit("enough")).y))
    outcome = rig.run(10)
    assert outcome.status == "exception" and isinstance(outcome.error, SystemExit) and outcome.error.code == "enough"


def test_exception_in_update_is_reported():
    class Updates(Block):
        """Fails when it remembers."""

        u = Input("N·m")
        y = Output("N·m", range=(-1.0, 1.0))

        def step(self):
            return 0.5

        def update(self, u, tick):
            if tick == 4:
                raise OSError("disk")

    rig = one_drive(lambda knee: Updates(name="updates")(knee.torque))
    outcome = rig.run(10)
    assert (outcome.status, outcome.culprit, outcome.tick) == ("exception", "updates", 4) and isinstance(
        outcome.error, OSError
    )
    assert ends_in_the_safe_stop(rig) and len(rig.commands()) == 5  # the update comes after the frames of its tick


def test_exception_while_arming_is_reported_without_commands_sent():
    class Settles(Block):
        """Fails to find its steady state."""

        u = Input("N·m")
        y = Output("N·m", range=(-1.0, 1.0))

        def settle(self, u):
            raise RuntimeError("unsettled")

        def step(self, u):
            return 0.0

    rig = one_drive(lambda knee: Settles(name="settles")(knee.torque))
    outcome = rig.run(10)
    assert (outcome.status, outcome.culprit, outcome.tick) == ("exception", "settles", -1) and rig.commands() == []
    assert ends_in_the_safe_stop(rig)


def test_an_exception_in_the_plant_ends_the_run_and_names_its_block():
    with Diagram("robot", rate=200) as robot:
        CubeMars("AK10-9-V2.0", can_id=1, name="knee")(torque_command=1.0)
    with Diagram("plant", rate=400) as plant:
        EmulatedCubeMars.of(robot["knee"], name="knee")(position=TornAngle(name="wearer").angle, velocity=0.0)
    outcome = Rig(robot, plant).run(100)
    assert outcome.status == "exception" and outcome.culprit == "wearer" and str(outcome.error) == "torn"


BETWEEN = {
    "nothing but a limiter": lambda u: TorqueLimiter(limit=9.0)(u),
    "a limiter with slew": lambda u: TorqueLimiter(limit=9.0, slew=50.0)(u),
    "a saturation": lambda u: Saturation(-9.0, 9.0)(u),
    "a slew rate": lambda u: TorqueLimiter(limit=9.0)(SlewRate(50.0)(u)),
    "a gain": lambda u: Gain(0.5)(Saturation(-9.0, 9.0)(u)),
    "a gain of zero": lambda u: TorqueLimiter(limit=9.0)(Gain(0.0)(u)),
    "a sum": lambda u: Sum("+-")(Saturation(-4.0, 4.0)(u), 1.0),
    "a product": lambda u: TorqueLimiter(limit=9.0)(Product()(u, 0.0)),
    "a filter": lambda u: TorqueLimiter(limit=9.0)(Butterworth(cutoff=20.0)(u)),
}


@pytest.mark.hazard("H2a")
@pytest.mark.parametrize("between", BETWEEN)
def test_a_nan_torque_command_is_a_fault_without_a_frame(between):
    rig = one_drive(lambda knee: BETWEEN[between](At(20, lambda: math.nan).y))
    outcome = rig.run(100)
    assert (outcome.status, outcome.culprit, outcome.tick) == ("not finite", "knee", 20)
    assert ends_in_the_safe_stop(rig) and len(rig.commands()) == 20 and rig.statistics()["ticks"] == 20


@pytest.mark.hazard("H2a")
@pytest.mark.parametrize("between", BETWEEN)
@pytest.mark.parametrize("value", [math.inf, -math.inf])
def test_an_infinity_is_a_fault_after_any_limiter(between, value):
    rig = one_drive(lambda knee: BETWEEN[between](At(20, lambda: value).y))
    outcome = rig.run(100)
    assert outcome.status == "not finite" and 20 <= outcome.tick <= 22 and ends_in_the_safe_stop(rig)
    limit = 9.0 * 1.01
    assert all(abs(torque) <= limit for torque in rig["knee.torque_sent"])


@pytest.mark.parametrize("value", [1e308, -1e308])
def test_the_largest_value_after_a_limiter_is_its_limit(value):
    rig = one_drive(lambda knee: TorqueLimiter(limit=9.0, slew=math.inf)(At(20, lambda: value).y))
    assert rig.run(40, fade=0.0).status == "ok"
    assert abs(rig["knee.torque_sent"][20]) == pytest.approx(9.0, abs=2 * 65.0 / 4095)
    assert rig["knee.torque_sent"][21] == pytest.approx(1.0, abs=2 * 65.0 / 4095)


@pytest.mark.hazard("H1b")
@pytest.mark.parametrize(
    "value, status",
    [(math.nan, "not finite"), (math.inf, "not finite"), (18.1, "out of limits"), (-1e300, "out of limits")],
)
def test_a_native_output_outside_its_range_is_stopped_at_the_actuator(value, status):
    class Liar(Block):
        """Declares an output range of one newton metre."""

        gain = Gain.parameters["gain"]
        u = Input("any")
        y = Output("any", range=(-1.0, 1.0))
        kernel = kernels.gain

    rig = one_drive(lambda knee: Liar(1.0)(At(20, lambda: value).y))
    outcome = rig.run(100)
    assert (outcome.status, outcome.culprit, outcome.tick) == (status, "knee", 20)
    assert ends_in_the_safe_stop(rig) and len(rig.commands()) == 20


@pytest.mark.hazard("H2c")
def test_one_rejected_command_blocks_all_frames_of_the_tick():
    with Diagram("robot", rate=200) as robot:
        CubeMars("AK10-9-V2.0", can_id=1, name="good")(torque_command=1.0)
        CubeMars("AK10-9-V2.0", can_id=2, name="bad")(
            torque_command=TorqueLimiter(limit=5.0)(At(6, lambda: math.nan).y)
        )
    rig = Rig(robot, plant_of(robot))
    outcome = rig.run(50)
    assert (outcome.culprit, outcome.tick) == ("bad", 6) and len(rig.commands(1)) == len(rig.commands(2)) == 6
    assert ends_in_the_safe_stop(rig, 1) and ends_in_the_safe_stop(rig, 2)


def test_outcome_describes_state_before_safe_stop_replies():
    with Diagram("robot", rate=200) as robot:
        CubeMars("AK10-9-V2.0", can_id=1, name="knee", safe_stop="damp", stop_time=0.2)(torque_command=2.0)
    plant = plant_of(robot)
    rig = Rig(robot, plant)
    assert rig.run(60, fade=0.0).status == "ok"
    slot = rig.schedule.signals["knee.position"].slot
    assert rig.control.final[slot] == rig["knee.position"][-1] != rig.control.values[slot]
    limb = compile(plant).signals["knee_limb.position"].slot
    assert (
        abs(rig.plant.final[limb] - rig["knee.position"][-1])
        < 0.05
        < 0.15
        < rig.plant.values[limb] - rig.plant.final[limb]
    )
