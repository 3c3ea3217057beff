"""A native block computes by hand as it does in a diagram."""

import ctypes
import math

import numpy as np
import pytest

from blocks.actuators import CubeMars
from blocks.controllers import GaitPhase, Impedance
from blocks.discrete import UnitDelay
from blocks.filters import Butterworth
from blocks.limiters import SlewRate, TorqueLimiter
from blocks.mathematics import Gain, Product, Sum
from blocks.sources import Sine
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Block, Diagram, Input, Kernel, Output, compile


def test_inputs_are_given_by_position_name_or_default():
    impedance = Impedance(stiffness=10.0, damping=1.0)
    assert impedance.step(0.5, 1.0) == impedance.step(velocity=1.0, position=0.5) == -6.0
    assert impedance.step(0.5, 1.0, equilibrium=0.5) == -1.0


def test_an_input_without_a_value_is_missed():
    with pytest.raises(TypeError, match="Impedance takes position, velocity, equilibrium, .*: velocity has no value"):
        Impedance().step(0.5)
    with pytest.raises(TypeError, match="Gain takes u"):
        Gain().step(1.0, 2.0)
    with pytest.raises(TypeError, match="Gain takes u"):
        Gain().step(w=1.0)


def test_a_parameter_changed_by_hand_counts_at_the_next_step():
    gain = Gain(2.0)
    assert gain.step(1.0) == 2.0
    gain.gain = 3.0
    assert gain.step(1.0) == 3.0


def test_vectors_are_passed_as_separate_arrays():
    gain = Gain(2.0)
    first = gain.step([1.0, 2.0, 3.0])
    second = gain.step(np.zeros(3))
    assert first.tolist() == [2.0, 4.0, 6.0] and second.tolist() == [0.0, 0.0, 0.0]
    assert Sum("+-").step(1.0, [1.0, 2.0]).tolist() == [0.0, -1.0]
    assert Product().step([[1.0, 2.0], [3.0, 4.0]], np.full((2, 2), 2.0)).tolist() == [[2.0, 4.0], [6.0, 8.0]]


def test_an_output_cannot_change_its_shape_before_the_next_reset():
    gain = Gain(2.0)
    gain.step([1.0, 2.0])
    with pytest.raises(ValueError):
        gain.step([1.0, 2.0, 3.0])
    gain.reset()
    assert gain.step([1.0, 2.0, 3.0]).tolist() == [2.0, 4.0, 6.0]


def test_reset_restores_the_initial_state_of_a_native_block():
    with Diagram("d", rate=100):
        filter = Butterworth(cutoff=5.0)
    first = [filter.step(1.0) for _ in range(5)]
    filter.reset()
    assert [filter.step(1.0) for _ in range(5)] == first and first[0] < first[-1]


def test_a_block_without_a_sampling_period_is_reported():
    with pytest.raises(TypeError, match="butterworth needs a sampling period"):
        Butterworth(cutoff=5.0).step(1.0)


def test_outputs_come_in_their_types():
    phase, walking, stride_time, strides, _ = GaitPhase().step(0.0, 0.0)
    assert (
        (phase, walking, stride_time, strides) == (0.0, False, 0.0, 0)
        and type(walking) is bool
        and type(strides) is int
    )


def test_a_block_returns_nan_for_nan():
    assert math.isnan(Gain().step(math.nan)) and math.isnan(TorqueLimiter(limit=1.0).step(math.nan))


def test_a_delay_moves_at_its_update():
    delay = UnitDelay(initial=5.0)
    assert delay.step(1.0) == 5.0 == delay.step(2.0)
    delay.update(3.0)
    assert delay.step(0.0) == 3.0


def test_devices_and_blocks_without_a_step_cannot_be_stepped():
    class Idle(Block):
        """No step."""

        u = Input("1")
        y = Output("1")

    for block in (Idle(), CubeMars("AK80-9")):
        with pytest.raises(TypeError, match="cannot be stepped"):
            block.step(1.0)


def test_a_kernel_that_refuses_is_reported():
    @ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p)
    def refuses(arena, slots, sizes):
        return 70

    class Refuses(Block):
        """Refuses."""

        y = Output("1")
        kernel = Kernel(refuses, "y")

    with pytest.raises(ArithmeticError, match="the kernel of refuses returned status 70"):
        Refuses().step()


def test_stepping_and_running_give_identical_bits():
    with Diagram("d", rate=125) as diagram:
        sine = Sine(amplitude=2.0, frequency=3.0, name="sine")
        SlewRate(7.0, name="slew")(Butterworth(order=3, cutoff=11.0, name="filter")(sine.y))
    schedule = compile(diagram)
    by_hand = []
    for _tick in range(50):
        u = diagram["sine"].step()
        by_hand.append((u, diagram["filter"].step(u)))
    program = Program(schedule)
    for ticks in (1, 2, 10, 50):
        Executor(program, 125.0, virtual=True).run(ticks)
        now = [program.values[schedule.signals[path].slot] for path in ("sine.y", "filter.y")]
        assert tuple(now) == by_hand[ticks - 1]
